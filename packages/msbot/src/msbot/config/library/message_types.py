"""Message types by name: MsBOT's standard ones and those that a library file declares.

A library names the type of each port; this file says what that name means: the fields in the order of the wire. The
classes that a Python program uses for the standard types are in `msbot.part.messages.standard`; a test keeps the two
identical.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from enum import Enum
from functools import cache
from importlib.resources import files

from msbot_agent.toml.document import carried_document
from msbot_agent.toml.problems import Problems, toml_value_in_words
from msbot_agent.toml.table import Scalar, Table
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

    def fault(self, value: Scalar) -> str | None:
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
class MessageType:
    """A message by its fields."""

    name: str
    fields: Mapping[str, FieldKind]
    """In the order of the wire."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of fields, where they have one."""
    description: str = ""
    source: str = ""
    """The file it was read from."""

    @property
    def size_bytes(self) -> int | None:
        """Octets of a message as CDR; None when it contains a text, whose length varies."""
        size = 0
        for kind in self.fields.values():
            if kind is FieldKind.TEXT:
                return None
            size += -size % kind.size_bytes + kind.size_bytes  # each number is at a multiple of its own size
        return size

    def same_as(self, other: MessageType) -> bool:
        """Whether both have the same fields in the same order, and so are the same type on the wire."""
        return list(self.fields.items()) == list(other.fields.items())


def read_message_types(root: Table, file: str) -> list[tuple[Table, MessageType]]:
    """The `[[type]]` tables of a file; what is wrong becomes a problem."""
    found = []
    for table in root.tables("type"):
        name = table.name("name", "Light", forbidden=".")
        fields = _read_fields(table.table("fields", required=True))
        units = {key: value for key, value in table.scalars("units").items() if isinstance(value, str)}
        for key in units:
            if key not in fields:
                table.problem(f'the type has no field "{key}"; name one of its fields', "units", key)
        message = MessageType(name, fields, units, table.text("description", "How bright it is"), file)
        table.finish()
        found.append((table, message))
    return found


@cache
def standard_message_types() -> Mapping[str, MessageType]:
    """The message types that MsBOT brings, by name."""
    problems = Problems()
    document = carried_document(files("msbot.config") / "message_types.toml", "msbot message types")
    table = Table(document, problems, document.values)
    found = read_message_types(table, "msbot message types")
    table.finish()
    problems.raise_if_any()
    return {message.name: message for _, message in found}


def _read_fields(table: Table) -> dict[str, FieldKind]:
    words = [kind.value for kind in FieldKind]
    fields = {}
    for key in table.present_keys():
        if not key.isidentifier() or key.startswith("_"):
            table.problem(f'"{key}" cannot be the name of a field; use letters, digits and _', key)
        fields[key] = FieldKind(table.choice(key, words))
    if table.is_there and not fields:
        table.problem('a message needs at least one field, for example lux = "float32"')
    return fields
