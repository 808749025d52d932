"""What the fields of a message type hold: simple kinds, texts of limited length, enums, lists, and other messages.

The notation is that of ROS 2's `.msg` files: `uint16[<=64]` is a list of at most 64, `float32[3]` one of exactly 3,
`text<=32` a text of at most 32 octets, `Pose` a message inside. On the wire all of it is classic CDR.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import field
from enum import Enum

from msbot_agent.toml.problems import toml_value_in_words
from msbot_agent.toml.table import Scalar
from msbot_xrce.lazy import dataclass


class FieldKind(Enum):
    """What a field of a message holds; the values are the words of a library file."""

    BOOL = "bool"
    UINT8 = "uint8"
    UINT16 = "uint16"
    UINT32 = "uint32"
    UINT64 = "uint64"
    INT8 = "int8"
    INT16 = "int16"
    INT32 = "int32"
    INT64 = "int64"
    FLOAT32 = "float32"
    FLOAT64 = "float64"
    TEXT = "text"

    @property
    def word(self) -> str:
        """The kind as a library file writes it."""
        return self.value

    @property
    def is_whole(self) -> bool:
        """Whether it is a whole number of limited size."""
        return "int" in self.value

    @property
    def size_bytes(self) -> int:
        """Octets of such a field; for a text, those of the shortest one."""
        if self is FieldKind.BOOL:
            return 1
        if self is FieldKind.TEXT:
            return 5
        return int(self.value.lstrip("uintfloa")) // 8

    @property
    def limits(self) -> tuple[int, int]:
        """Lowest and highest value of a whole number."""
        bits = int(self.value.lstrip("uint"))
        return (0, (1 << bits) - 1) if self.value[0] == "u" else (-(1 << (bits - 1)), (1 << (bits - 1)) - 1)

    @property
    def zero(self) -> Scalar:
        """The value of a field that nobody set."""
        match self:
            case FieldKind.BOOL:
                return False
            case FieldKind.TEXT:
                return ""
            case FieldKind.FLOAT32 | FieldKind.FLOAT64:
                return 0.0
            case _:
                return 0

    def fault(self, value: object) -> str | None:
        """Why a field cannot have this value; None when it can."""
        match self:
            case FieldKind.BOOL:
                right, words = isinstance(value, bool), "true or false"
            case FieldKind.TEXT:
                right, words = isinstance(value, str), "text in quotes"
            case FieldKind.FLOAT32 | FieldKind.FLOAT64:
                right, words = isinstance(value, int | float) and not isinstance(value, bool), "a number"
            case _:
                least, most = self.limits
                right = isinstance(value, int) and not isinstance(value, bool) and least <= value <= most
                words = f"a whole number from {least} to {most}"
        return None if right else f"must be {words}; it is {toml_value_in_words(value)}"


@dataclass(frozen=True, slots=True)
class BoundedText:
    """A text of limited length."""

    most: int
    """Octets of its UTF-8."""

    @property
    def word(self) -> str:
        """As a library file writes it."""
        return f"text<={self.most}"

    @property
    def is_whole(self) -> bool:
        """See `FieldKind`."""
        return False

    @property
    def zero(self) -> Scalar:
        """See `FieldKind`."""
        return ""

    def fault(self, value: object) -> str | None:
        """See `FieldKind`."""
        if isinstance(value, str) and len(value.encode(errors="replace")) > self.most:
            return f"must be text of at most {self.most} bytes; it has {len(value.encode(errors='replace'))}"
        return FieldKind.TEXT.fault(value)


@dataclass(frozen=True, slots=True)
class EnumType:
    """One of several names; on the wire its number, from 0, in 4 octets."""

    name: str
    names: tuple[str, ...]

    @property
    def word(self) -> str:
        """As a library file writes it."""
        return self.name

    @property
    def is_whole(self) -> bool:
        """See `FieldKind`."""
        return False

    @property
    def zero(self) -> Scalar:
        """See `FieldKind`."""
        return self.names[0]

    def fault(self, value: object) -> str | None:
        """See `FieldKind`."""
        if value in self.names:
            return None
        known = ", ".join(f'"{name}"' for name in self.names)
        return f"must be one of {known}; it is {toml_value_in_words(value)}"


@dataclass(frozen=True, slots=True)
class ListType:
    """A list: a fixed array, or a bounded sequence. Wherever one value is expected, it is a JSON text."""

    element: FieldKind | BoundedText | EnumType | MessageType
    most: int
    is_fixed: bool = False
    """Whether it always has so many elements."""

    @property
    def word(self) -> str:
        """As a library file writes it."""
        return f"{self.element.word}[{'' if self.is_fixed else '<='}{self.most}]"

    @property
    def is_whole(self) -> bool:
        """See `FieldKind`."""
        return False

    @property
    def zero(self) -> Scalar:
        """See `FieldKind`."""
        return json.dumps([_zero_of(self.element)] * self.most) if self.is_fixed else "[]"

    def fault(self, value: object) -> str | None:
        """See `FieldKind`."""
        if isinstance(value, str):
            try:
                value = json.loads(value)
            except (ValueError, RecursionError):
                return f"must be a list such as [1, 2, 3]; it is {toml_value_in_words(value)}"
        if not isinstance(value, list):
            return f"must be a list; it is {toml_value_in_words(value)}"
        if len(value) > self.most or (self.is_fixed and len(value) < self.most):
            return f"must have {'' if self.is_fixed else 'at most '}{self.most} elements; it has {len(value)}"
        faults = ((place, fault_of(self.element, one)) for place, one in enumerate(value))
        return next((f"[{place}] {words}" for place, words in faults if words), None)


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message by its fields."""

    name: str
    fields: Mapping[str, FieldType]
    """In the order of the wire."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of fields, where they have one; of fields inside others with the way to them, `pose.x`."""
    description: str = ""
    source: str = ""
    """The file it was read from."""

    @property
    def word(self) -> str:
        """As a library file writes it."""
        return self.name

    @property
    def leaves(self) -> Mapping[str, LeafType]:
        """What holds one value: fields, and those inside messages with the way to them (`pose.x`)."""
        found: dict[str, LeafType] = {}
        for name, kind in self.fields.items():
            if isinstance(kind, MessageType):
                found |= {f"{name}.{way}": one for way, one in kind.leaves.items()}
            else:
                found[name] = kind
        return found

    @property
    def size_bytes(self) -> int | None:
        """Octets of a message as CDR; None when it contains a text or a list whose length varies."""
        return None if _varies(self) else _end_of(self, 0)

    @property
    def most_bytes(self) -> int:
        """Octets of the longest message as CDR; texts without a limit count as empty."""
        return _end_of(self, 0)

    def described(self) -> dict[str, tuple[tuple[str, str], ...]]:
        """Names and kinds of the fields, by type: what the type hash is made of. Each type stands before those inside.

        Of an enum these are its names in small letters, and their numbers.
        """
        found = {self.name: tuple((name, kind.word) for name, kind in self.fields.items())}
        for kind in self.fields.values():
            inside = kind.element if isinstance(kind, ListType) else kind
            if isinstance(inside, MessageType):
                found = {
                    name: one for name, one in found.items() if name not in inside.described()
                } | inside.described()
            elif isinstance(inside, EnumType):
                found.pop(inside.name, None)
                found[inside.name] = tuple((name.lower(), str(number)) for number, name in enumerate(inside.names))
        return found

    def same_as(self, other: MessageType) -> bool:
        """Whether both have the same fields in the same order, and so are the same type on the wire."""
        return list(self.described().items()) == list(other.described().items())


_FAR = 1 << 16
"""Octets beyond which nobody counts on: no message is that long."""

LeafType = FieldKind | BoundedText | EnumType | ListType
"""What holds one value where people and files write it."""
FieldType = LeafType | MessageType


def fault_of(kind: FieldType, value: object) -> str | None:
    """Why a field cannot have this value, which may be a list or a table; None when it can."""
    if not isinstance(kind, MessageType):
        return kind.fault(value)
    if isinstance(value, list) and len(value) == len(kind.fields):
        value = dict(zip(kind.fields, value, strict=True))
    if not isinstance(value, dict):
        return f"must have the fields {', '.join(kind.fields)}; it is {toml_value_in_words(value)}"
    for name, one in value.items():
        if name not in kind.fields:
            return f'has no field "{name}"; it has {", ".join(kind.fields)}'
        if words := fault_of(kind.fields[name], one):
            return f"{name} {words}"
    if missing := [name for name in kind.fields if name not in value]:
        return f"has no value for {', '.join(missing)}; it needs {', '.join(kind.fields)}"
    return None


def _zero_of(kind: FieldKind | BoundedText | EnumType | MessageType) -> object:
    if isinstance(kind, MessageType):
        zeros = []
        for one in kind.fields.values():
            zero = _zero_of(one) if not isinstance(one, ListType) else json.loads(str(one.zero))
            zeros.append(zero)
        return zeros
    return kind.zero


def _varies(kind: FieldType) -> bool:
    if isinstance(kind, ListType):
        return not kind.is_fixed or _varies(kind.element)
    if isinstance(kind, MessageType):
        return any(map(_varies, kind.fields.values()))
    return kind is FieldKind.TEXT or isinstance(kind, BoundedText)


def _end_of(kind: FieldType, start: int) -> int:
    """Where the longest value ends that begins at `start`: each number is at a multiple of its own size."""
    match kind:
        case MessageType():
            for one in kind.fields.values():
                start = _end_of(one, start)
            return start
        case ListType():
            start = start if kind.is_fixed else _after(start, 4)
            if isinstance(kind.element, FieldKind) and kind.element is not FieldKind.TEXT:
                size = kind.element.size_bytes
                return _after(start, size) + (kind.most - 1) * size if kind.most else start
            for _ in range(kind.most):
                start = _end_of(kind.element, start)
                if start > _FAR:
                    break
            return start
        case EnumType():
            return _after(start, 4)
        case BoundedText():
            return _after(start, 4) + kind.most + 1
        case FieldKind.TEXT:
            return _after(start, 4) + 1
        case _:
            return _after(start, kind.size_bytes)


def _after(start: int, size: int) -> int:
    return start + -start % size + size
