"""What an interface file says: structs, enums and constants, whichever language it was written in."""

from __future__ import annotations

from dataclasses import field
from typing import TypeAlias

from msbot_agent.text.sentence import printable
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

Name: TypeAlias = tuple[str, ...]
"""A scoped name: `("geometry_msgs", "msg", "Twist")`."""
Value: TypeAlias = bool | int | float | str
"""What a constant or a default may be."""

LARGEST_ARRAY = 1 << 16
"""Largest number of elements in an array, and largest bound: more than any message of a robot needs."""


@dataclass(frozen=True, slots=True)
class SourceLocation:
    """Where something is in a file."""

    file: str
    line: int
    column: int

    def error(self, words: str) -> ConfigError:
        """An error that names this place; what it quotes of the file does not control the terminal."""
        return ConfigError(f"{self.file}:{self.line}:{self.column}: {printable(words)}")


@dataclass(frozen=True, slots=True)
class Basic:
    """A number or a boolean, by its name in Python: `uint8`, `float32`, `bool`."""

    word: str


@dataclass(frozen=True, slots=True)
class StringType:
    """A string; `bound` is its largest number of characters, None = unlimited."""

    bound: int | None = None


@dataclass(frozen=True, slots=True)
class Sequence:
    """A list of any length, or at most `bound` elements."""

    element: Type
    bound: int | None = None


@dataclass(frozen=True, slots=True)
class Array:
    """Exactly `length` elements."""

    element: Type
    length: int


@dataclass(frozen=True, slots=True)
class Reference:
    """Another struct or enum, by its full name."""

    name: Name


Type: TypeAlias = Basic | StringType | Sequence | Array | Reference

BASICS = ("bool", "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64")


@dataclass(frozen=True, slots=True)
class Member:
    """One field of a struct."""

    name: str
    type: Type
    comment: str = ""
    default: Value | list[Value] | None = None


@dataclass(frozen=True, slots=True)
class Constant:
    """A named value."""

    name: Name
    type: Type
    value: Value
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Struct:
    """A message, or part of one."""

    name: Name
    members: tuple[Member, ...]
    comment: str = ""
    constants: tuple[Constant, ...] = ()
    """Constants that belong to it, as in ROS."""
    is_ros: bool = False
    """Whether its type name in the data space follows ROS 2: `std_msgs::msg::dds_::String_`."""

    @property
    def type_name(self) -> str:
        """Its name in the data space."""
        if self.is_ros:
            return "::".join((*self.name[:-1], "dds_", f"{self.name[-1]}_"))
        return "::".join(self.name)


@dataclass(frozen=True, slots=True)
class Enum:
    """Named numbers."""

    name: Name
    members: tuple[tuple[str, int], ...]
    comment: str = ""


@dataclass(slots=True)
class Definitions:
    """Everything that was read, in an order that defines each name before its use."""

    structs: dict[Name, Struct] = field(default_factory=dict)
    enums: dict[Name, Enum] = field(default_factory=dict)
    constants: dict[Name, Constant] = field(default_factory=dict)
    order: list[Name] = field(default_factory=list)
    """Structs and enums."""

    def add(self, one: Struct | Enum | Constant, place: SourceLocation) -> None:
        """Add a definition.

        Raises:
            ConfigError: its name is taken.
        """
        if one.name in self.structs or one.name in self.enums or one.name in self.constants:
            raise place.error(f"{'::'.join(one.name)} is defined twice")
        match one:
            case Struct():
                self.structs[one.name] = one
                self.order.append(one.name)
            case Enum():
                self.enums[one.name] = one
                self.order.append(one.name)
            case Constant():
                self.constants[one.name] = one

    def needed_by(self, name: Name) -> set[Name]:
        """A type and all types inside it."""
        found: set[Name] = set()
        waiting = [name]
        while waiting:
            one = waiting.pop()
            if one not in found:
                found.add(one)
                struct = self.structs.get(one)
                waiting += [] if struct is None else [used for member in struct.members for used in _used(member.type)]
        return found


def _used(kind: Type) -> list[Name]:
    match kind:
        case Reference(name):
            return [name]
        case Sequence(element) | Array(element):
            return _used(element)
        case _:
            return []
