"""What tells one version of a message type from another: the hash that ROS 2 gives it (REP 2016, "RIHS01"). Pure.

The hash is made from the names, kinds and order of the fields, also of those inside, so two programs whose messages of
one name differ have different hashes. `micropython/msbot/type_hash.py` makes the same ones.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import IntEnum
from itertools import zip_longest

from msbot.part.messages.message import Message, fields_of
from msbot_xrce.lazy import dataclass

HASH_OCTETS = 8
"""So many of its 32 octets travel, and are shown."""
NO_FUNCTION = bytes(HASH_OCTETS)
"""Told in place of a hash: the program has no function at a port that serves."""
PREFIX = "RIHS01_"
PACKAGE = "msbot_msgs"
"""The ROS 2 package that types without one are in."""
MOST_DEPTH = 8
"""Types within types that are looked at; what a stranger says may go round in a circle."""

Fields = Sequence[tuple[str, str]]
"""Name and kind (`float32`, `text<=32`, `uint16[<=64]`, `Pose`) of each field, in the order of the wire; of an enum its
names in small letters and their numbers."""
FieldsOf = Callable[[str], Fields | None]
"""The fields of a type by its name; None: it is not known."""

_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9, "float32": 10,
    "float64": 11, "bool": 15, "text": 17,
}  # fmt: skip
"""The numbers of `type_description_interfaces/msg/FieldType`."""
_NESTED, _BOUNDED_TEXT, _ARRAY, _BOUNDED, _UNBOUNDED = 1, 21, 48, 96, 144
_KIND = re.compile(r"(?P<base>[^\[\]<>=]+)(<=(?P<octets>\d+))?(\[(?P<bound><=)?(?P<count>\d*)\])?")


def described_types(message_class: type[Message]) -> dict[str, Fields] | None:
    """The fields of a class, and of all classes inside it, by type; its own come first.

    None: there are lists of lists in it, and such classes are not compared.
    """
    found: dict[str, Fields] = {}
    waiting: list[type] = [message_class]
    while waiting:
        cls = waiting.pop(0)
        if issubclass(cls, IntEnum):
            found.setdefault(cls.__name__, [(member.name.lower(), str(int(member))) for member in cls])
        elif issubclass(cls, Message) and cls.type_name not in found:
            fields = fields_of(cls)
            if not all(field.codec.kind for field in fields):
                return None
            found[cls.type_name] = [(field.name, field.codec.kind) for field in fields]
            waiting += [field.codec.inside for field in fields if field.codec.inside is not None]
    return found


def type_hash(type_name: str, fields: Iterable[tuple[str, str]], inner: FieldsOf = lambda _: None) -> bytes:
    """The first octets of the hash of a type.

    Args:
        type_name: its name in the data space.
        fields: as `described_types` has them.
        inner: finds the fields of the types inside.
    """
    return whole_hash(type_name, fields, inner)[:HASH_OCTETS]


def whole_hash(type_name: str, fields: Iterable[tuple[str, str]], inner: FieldsOf = lambda _: None) -> bytes:
    """All octets of the hash of a type, as ROS 2 tells it; see `type_hash`."""
    inside: dict[str, Fields] = {}
    described = [_field(name, kind, inside) for name, kind in fields]
    others: dict[str, list[object]] = {}
    while waiting := [name for name in inside if name not in others]:
        for name in waiting:
            others[name] = [_field(field, kind, inside) for field, kind in inner(name) or ()]
    referenced = [{"type_name": _ros_name(name), "fields": one} for name, one in others.items()]
    whole = {
        "type_description": {"type_name": _ros_name(type_name), "fields": described},
        "referenced_type_descriptions": sorted(referenced, key=lambda one: str(one["type_name"])),
    }
    return hashlib.sha256(json.dumps(whole).encode()).digest()


def _ros_name(type_name: str) -> str:
    words = [word for word in type_name.split("::") if word]
    is_ros = len(words) == 4 and words[2] == "dds_"
    return f"{words[0]}/{words[1]}/{words[3].removesuffix('_')}" if is_ros else f"{PACKAGE}/msg/{type_name}"


def _field(name: str, kind: str, inside: dict[str, Fields]) -> object:
    """One field as the hash has it; a name of an enum is a uint32 with its number as capacity."""
    if kind.isdecimal():
        return _typed(name, _IDS["uint32"], int(kind), 0, "")
    match = _KIND.fullmatch(kind)
    if match is None:  # a stranger's word for a kind
        return _typed(name, 0, 0, 0, kind)
    base, count = match["base"], int(match["count"] or 0)
    octets = int(match["octets"] or 0)
    number = _IDS.get(base, _NESTED) if not octets else _BOUNDED_TEXT
    if "[" in kind:
        number += _BOUNDED if match["bound"] else _ARRAY if match["count"] else _UNBOUNDED
    if base not in _IDS:
        inside.setdefault(base, ())
    return _typed(name, number, count, octets, "" if base in _IDS else _ros_name(base))


def _typed(name: str, number: int, count: int, octets: int, nested: str) -> object:
    told = {"type_id": number, "capacity": count, "string_capacity": octets, "nested_type_name": nested}
    return {"name": name, "type": told}


def hash_words(octets: bytes) -> str:
    """A hash as people see it: its beginning."""
    return f"{PREFIX}{octets.hex()}..."


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """Where two types differ first."""

    place: int
    """Of the field, from 0; of a field with other fields inside, its own place."""
    theirs: str
    """`uint16 index`, `uint16 x in pose`; empty: it is missing."""
    ours: str


def first_difference(
    theirs: Fields,
    ours: Fields,
    their_types: FieldsOf = lambda _: None,
    our_types: FieldsOf = lambda _: None,
    depth: int = MOST_DEPTH,
) -> FieldDifference | None:
    """The first field that differs, also inside others; None: none does."""
    for place, (one, other) in enumerate(zip_longest(theirs, ours)):
        if one != other:
            return FieldDifference(place, _words(one), _words(other))
        match = _KIND.fullmatch(one[1])
        base = "" if match is None else match["base"]
        mine, yours = our_types(base), their_types(base)
        if depth and base not in _IDS and mine is not None and yours is not None:
            found = first_difference(yours, mine, their_types, our_types, depth - 1)
            if found is not None:
                return FieldDifference(place, _within(found.theirs, one[0]), _within(found.ours, one[0]))
    return None


def _words(field: tuple[str, str] | None) -> str:
    if field is None:
        return ""
    name, kind = field
    return f"{name} = {kind}" if kind.isdecimal() else f"{kind} {name}"


def _within(words: str, name: str) -> str:
    return f"{words} in {name}" if words else ""


# The fields of some types in one text, as a part tells them when a hash differs: `TYPE name kind name kind`, a line for
# each type. A name has no blank in it.


def fields_text(types: Mapping[str, Fields]) -> str:
    """Types as a text."""
    lines = (" ".join([name, *(word for field in fields for word in field)]) for name, fields in types.items())
    return "".join(f"{line}\n" for line in lines)


def read_fields(text: str) -> dict[str, Fields]:
    """The types in a text; lines that make no sense are left out."""
    found: dict[str, Fields] = {}
    for line in text.splitlines():
        name, *words = line.split(" ")
        if name and words and not len(words) % 2 and line.isprintable():
            found[name] = list(zip(words[::2], words[1::2], strict=True))
    return found
