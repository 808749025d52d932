"""What tells one version of a message type from another: the hash that ROS 2 gives it (REP 2016, "RIHS01"). Pure.

The hash is made from the names, kinds and order of the fields, so two programs whose messages of one name differ have
different hashes. `micropython/msbot/types.py` makes the same ones.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from itertools import zip_longest

from msbot.part.messages.message import Message, fields_of

HASH_OCTETS = 8
"""So many of its 32 octets travel, and are shown."""
PREFIX = "RIHS01_"
PACKAGE = "msbot_msgs"
"""The ROS 2 package that types without one are in."""

Fields = Sequence[tuple[str, str]]
"""Name and kind (`float32`, `text`) of each field, in the order of the wire."""

_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9, "float32": 10,
    "float64": 11, "bool": 15, "text": 17,
}  # fmt: skip
"""The numbers of `type_description_interfaces/msg/FieldType`; bounds of texts are not told apart."""


def described_fields(message_class: type[Message]) -> Fields | None:
    """The fields of a class; None: one is no number, bool or text, and such classes are not compared."""
    found = [
        (field.name, "text" if field.codec.word.partition(" ")[0] == "str" else field.codec.word)
        for field in fields_of(message_class)
    ]
    return found if all(kind in _IDS for _, kind in found) else None


def type_hash(type_name: str, fields: Iterable[tuple[str, str]]) -> bytes:
    """The first octets of the hash of a type.

    Args:
        type_name: its name in the data space.
        fields: as `described_fields` has them.
    """
    words = [word for word in type_name.split("::") if word]
    is_ros = len(words) == 4 and words[2] == "dds_"
    name = f"{words[0]}/{words[1]}/{words[3].removesuffix('_')}" if is_ros else f"{PACKAGE}/msg/{type_name}"
    described = [
        {
            "name": field,
            "type": {"type_id": _IDS[kind], "capacity": 0, "string_capacity": 0, "nested_type_name": ""},
        }
        for field, kind in fields
    ]
    whole = {"type_description": {"type_name": name, "fields": described}, "referenced_type_descriptions": []}
    return hashlib.sha256(json.dumps(whole).encode()).digest()[:HASH_OCTETS]


def hash_words(octets: bytes) -> str:
    """A hash as people see it: its beginning."""
    return f"{PREFIX}{octets.hex()}..."


def first_difference(theirs: Fields, ours: Fields) -> int | None:
    """The place of the first field that differs; None: none does."""
    pairs = zip_longest(theirs, ours)
    return next((place for place, (one, other) in enumerate(pairs) if one != other), None)


# The fields of some types in one text, as a part tells them when a hash differs: `TYPE name kind name kind`, a line for
# each type. A name has no blank in it.


def fields_text(types: Iterable[tuple[str, Fields]]) -> str:
    """Types as a text."""
    return "".join(f"{' '.join([name, *(word for field in fields for word in field)])}\n" for name, fields in types)


def read_fields(text: str) -> dict[str, Fields]:
    """The types in a text; lines that make no sense are left out."""
    found: dict[str, Fields] = {}
    for line in text.splitlines():
        name, *words = line.split(" ")
        if name and words and not len(words) % 2 and line.isprintable():
            found[name] = list(zip(words[::2], words[1::2], strict=True))
    return found
