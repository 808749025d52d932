"""Message classes as ROS 2 interface definitions, which readers of MCAP files understand without MsBOT."""

from __future__ import annotations

import re
from enum import IntEnum
from typing import Annotated, ClassVar, Final, get_args, get_origin, get_type_hints

from msbot.part import Message
from msbot.part.messages.wire_types import AtMost, Exactly, Number, Octets

PACKAGE: Final = "msbot_msgs"
"""The ROS 2 package that types without one are in."""
ENCODING: Final = "ros2msg"
_RULE: Final = "=" * 80
_FOREIGN: Final = re.compile(r"[^A-Za-z0-9]+")
_CAPITAL: Final = re.compile(r"(?<=[a-z0-9])([A-Z])")


def ros_name(type_name: str) -> str:
    """The name of a type as ROS 2 writes it: `std_msgs::msg::dds_::Float32_` is `std_msgs/msg/Float32`."""
    words = [word for word in type_name.split("::") if word]
    if len(words) == 4 and words[2] == "dds_":
        return f"{words[0]}/{words[1]}/{words[3].removesuffix('_')}"
    pieces = [piece for word in words for piece in _FOREIGN.split(word) if piece]
    name = "".join(piece[:1].upper() + piece[1:] for piece in pieces)
    return f"{PACKAGE}/msg/{name if name[:1].isalpha() else f'Type{name}'}"


def ros_topic(topic: str) -> str:
    """The name of a topic as ROS 2 allows it: words of letters, digits and single underscores, `/` between them."""
    words = (_FOREIGN.sub("_", word) for word in topic.split("/") if word)
    return "".join(f"/{'_' if word[0].isdigit() else ''}{word}" for word in words) or "/_"


def ros_definition(cls: type[Message]) -> str:
    """The fields of a class, and those of all classes inside it, as one text."""
    inside: dict[type[Message], None] = {}
    parts = [_lines(cls, inside)]
    done: set[type[Message]] = set()
    while waiting := [other for other in inside if other not in done]:
        for other in waiting:
            done.add(other)
            parts.append(f"{_RULE}\nMSG: {_short(other)}\n{_lines(other, inside)}")
    return "\n".join(parts)


def _short(cls: type[Message]) -> str:
    package, _, name = ros_name(cls.type_name).split("/")
    return f"{package}/{name}"


def _lines(cls: type[Message], inside: dict[type[Message], None]) -> str:
    hints = get_type_hints(cls, include_extras=True)
    fields = {name: kind for name, kind in hints.items() if get_origin(kind) is not ClassVar}
    names = _field_names(list(fields))
    return "\n".join(f"{_word(kind, inside)} {name}" for name, kind in zip(names, fields.values(), strict=True))


def _field_names(names: list[str]) -> list[str]:
    """The names as ROS 2 allows them: small letters, digits and single underscores between them."""
    allowed: list[str] = []
    for name in names:
        pieces = [piece for piece in _FOREIGN.split(_CAPITAL.sub(r"_\1", name).lower()) if piece]
        shown = "_".join(pieces)
        shown = shown if shown[:1].isalpha() else f"field_{shown}".rstrip("_")
        while shown in allowed:
            shown += "x"
        allowed.append(shown)
    return allowed


def _word(annotation: object, inside: dict[type[Message], None]) -> str:
    base: object = annotation
    marks: list[object] = []
    if get_origin(annotation) is Annotated:
        base, *marks = get_args(annotation)
    match next((mark for mark in marks if isinstance(mark, Number | Octets | AtMost | Exactly)), None):
        case Number(word):
            return word
        case Octets(length):
            return f"uint8[{length}]"
        case Exactly(length):
            return f"{_word(get_args(base)[0], inside)}[{length}]"
        case AtMost(length) if base is str:
            return f"string<={length}"
        case AtMost(length):
            element = "uint8" if base is bytes else _word(get_args(base)[0], inside)
            return f"{element}[<={length}]"
    return _plain(base, inside)


def _plain(base: object, inside: dict[type[Message], None]) -> str:
    if get_origin(base) is list:
        return f"{_word(get_args(base)[0], inside)}[]"
    if isinstance(base, type) and issubclass(base, Message):
        inside.setdefault(base)
        return _short(base)
    if isinstance(base, type) and issubclass(base, IntEnum):
        return "uint32"  # an enum of IDL has 32 bits in CDR; ROS 2 has none
    return {bool: "bool", str: "string", bytes: "uint8[]"}[base]  # type: ignore[index]  # no other has a form on the wire
