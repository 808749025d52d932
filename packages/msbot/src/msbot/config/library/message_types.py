"""Message types by name: MsBOT's standard ones and those that a library file declares.

A library names the type of each port; this file says what that name means: the fields in the order of the wire. The
classes that a Python program uses for the standard types are in `msbot.part.messages.standard`; a test keeps the two
identical.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

from msbot.config.library.field_types import BoundedText, EnumType, FieldKind, FieldType, ListType, MessageType
from msbot_agent.toml.document import packaged_document
from msbot_agent.toml.problems import Problems, suggestion
from msbot_agent.toml.table import Table
from msbot_xrce.errors import ConfigError

__all__ = ["EnumType", "FieldKind", "MessageType", "read_message_types", "standard_message_types"]

MOST_BYTES = 4096
"""The longest message of a type: boards take 8 kB in all, and a CAN bus needs a third of a second for this."""
MOST_NAMES = 64
"""Names of one enum."""
_WORDS = [kind.value for kind in FieldKind]
_FORM = re.compile(r"(?P<base>[^\[\]<>=]+)(<=(?P<octets>[1-9]\d{0,4}))?(\[(?P<bound><=)?(?P<count>[1-9]\d{0,4})\])?")

Inside = FieldKind | BoundedText | EnumType | MessageType


def read_message_types(root: Table, file: str) -> list[tuple[Table, MessageType]]:
    """The `[[type]]` tables of a file; what is wrong becomes a problem.

    A type that has another one inside stands below it: so none can contain itself, and the file stands by itself.
    """
    is_standard = file == STANDARD
    known: dict[str, MessageType | EnumType] = {} if is_standard else dict(_standard_types())
    found = []
    for table in root.tables("type"):
        name = table.name("name", "Light", forbidden=".<>=[] ")
        if name in _WORDS or name == "string":
            table.report(f'"{name}" is a kind of its own; choose another name', "name")
        names = tuple(table.names("enum", "off"))
        if "enum" in table:
            known[name] = _read_enum(table, name, names)
            continue
        fields = _read_fields(table.table("fields", required=True), known)
        units = {key: value for key, value in table.scalars("units").items() if isinstance(value, str)}
        for key in units:
            if key not in fields:
                table.report(f'the type has no field "{key}"; name one of its fields', "units", key)
        for key, kind in fields.items():
            if isinstance(kind, MessageType):
                units |= {f"{key}.{way}": unit for way, unit in kind.units.items()}
        message = MessageType(name, fields, units, table.text("description", "How bright it is"), file)
        if message.most_bytes > MOST_BYTES:
            table.report(
                f"a message can have {message.most_bytes:,} bytes, and may have {MOST_BYTES:,}: make its lists shorter",
                "fields",
            )
            message = MessageType(name, {"none": FieldKind.BOOL}, {}, "", file)  # nothing grows out of it
        table.finish()
        known[name] = message
        found.append((table, message))
    return found


STANDARD = "msbot message types"


@cache
def standard_message_types() -> Mapping[str, MessageType]:
    """The message types that MsBOT brings, by name."""
    problems = Problems()
    document = packaged_document(files("msbot.config") / "message_types.toml", STANDARD)
    table = Table(document, problems, document.values)
    found = read_message_types(table, STANDARD)
    table.finish()
    problems.raise_if_any()
    return {message.name: message for _, message in found}


@cache
def _standard_types() -> Mapping[str, MessageType | EnumType]:
    """The standard types that other types may have inside: messages, and the enums in them."""
    messages = standard_message_types()
    return {one.name: one for message in messages.values() for one in enums_of(message)} | dict(messages)


def enums_of(message: MessageType) -> list[EnumType]:
    """The enums in a type and in those inside."""
    found = []
    for kind in message.fields.values():
        inside = kind.element if isinstance(kind, ListType) else kind
        found += (
            enums_of(inside) if isinstance(inside, MessageType) else [inside] if isinstance(inside, EnumType) else []
        )
    return found


def _read_enum(table: Table, name: str, names: tuple[str, ...]) -> EnumType:
    for key in ("fields", "units"):
        if key in table:
            table.report("an enum has names only; remove it", key)
            table.item(key)
    for place, one in enumerate(names):
        if not one.isidentifier() or one.startswith("_"):
            table.report(f'"{one}" cannot be a name; use letters, digits and _', "enum", place)
    if not 0 < len({one.lower() for one in names}) == len(names) <= MOST_NAMES:
        table.report(f"must be 1 to {MOST_NAMES} names, each different", "enum")
    table.text("description", "What the motor does")
    table.finish()
    return EnumType(name, names or ("none",))


def _read_fields(table: Table, known: Mapping[str, MessageType | EnumType]) -> dict[str, FieldType]:
    fields: dict[str, FieldType] = {}
    for key in table.present_keys():
        if not key.isidentifier() or key.startswith("_"):
            table.report(f'"{key}" cannot be the name of a field; use letters, digits and _', key)
        text = table.text(key, "float32")
        fields[key] = FieldKind.TEXT
        try:
            fields[key] = read_kind(text, known)
        except ConfigError as error:
            if text:
                table.report(str(error), key)
    if table.is_there and not fields:
        table.report('a message needs at least one field, for example lux = "float32"')
    return fields


def read_kind(text: str, known: Mapping[str, MessageType | EnumType]) -> FieldType:
    """What a field holds: `uint16`, `text<=32`, `Pose`, `Colour[<=64]`, `float32[3]`.

    Args:
        text: as a library file writes it.
        known: the types that may be inside.

    Raises:
        ConfigError: it is none of these; one sentence.
    """
    if text.endswith("[]"):
        base = text.removesuffix("[]")
        raise ConfigError(f'how many can there be? Write "{base}[<=64]" for at most 64, "{base}[64]" for exactly 64')
    match = _FORM.fullmatch(text)
    if match is None:
        raise ConfigError(
            f'"{text}" is no kind of field; write for example float32, text<=32, uint16[<=64], float32[3]'
        )
    element = _element(match["base"], match["octets"], known)
    if match["count"] is None:
        return element
    most = int(match["count"])
    if most > MOST_BYTES:
        raise ConfigError(f"a list may have at most {MOST_BYTES:,} elements")
    return ListType(element, most, is_fixed=match["bound"] is None)


def _element(base: str, octets: str | None, known: Mapping[str, MessageType | EnumType]) -> Inside:
    base = "text" if base == "string" else base
    if octets is not None:
        if base != "text":
            raise ConfigError(f'only a text has a length: write "{base}[<={octets}]" for a list')
        return BoundedText(int(octets))
    if base in _WORDS:
        return FieldKind(base)
    if base in known:
        return known[base]
    right = suggestion(base, [*_WORDS, *known], none_known="")
    raise ConfigError(f'there is no kind of field "{base}"; {right} A type inside must stand above')


def type_from_words(name: str, described: Mapping[str, Mapping[str, str]], units: Mapping[str, str]) -> MessageType:
    """A type as another process describes it, see `MessageType.described`.

    Raises:
        ConfigError: it makes no sense.
    """
    known: dict[str, MessageType | EnumType] = {}
    # The types inside come after those that they are in.
    for inner, fields in reversed(list(described.items())):
        if all(word.isdecimal() for word in fields.values()):
            known[inner] = EnumType(inner, tuple(fields))
        else:
            kinds = {field: read_kind(word, known) for field, word in fields.items()}
            known[inner] = MessageType(inner, kinds, units if inner == name else {})
    found = known.get(name)
    if not isinstance(found, MessageType):
        raise ConfigError(f"{name} is no message")
    return found
