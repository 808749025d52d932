"""Reads what a part says of itself: a library file from a stranger, of which nothing is taken on trust.

It is checked like a file that a person writes, and it may say less: no driver, no picture, nothing about other part
types. Only what was read and checked is written to the library, never the text itself.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

from msbot.config.library.field_types import MessageType
from msbot.config.library.message_types import standard_message_types
from msbot.config.library.part_file_reader import add_message_types, open_library_file, read_part_type
from msbot.config.library.part_library import SAID_BY_PART, Library, carried_by
from msbot.config.library.part_types import PartType
from msbot_agent.toml.document import Document, parse_document
from msbot_agent.toml.problems import KeyPath, Problems, quoted
from msbot_agent.toml.table import toml_value
from msbot_xrce.lazy import dataclass

"""Its name in messages."""
MAY_SAY = ("number", "name", "category", "description")
TABLES = ("port", "parameter", "type")
"""Everything that a part may say of itself; a library file may say more."""
_MOST_WHOLE = 2**63


@dataclass(frozen=True, slots=True)
class Described:
    """A part type as a part describes it, checked."""

    part_type: PartType
    messages: tuple[MessageType, ...]
    """The message types of its ports, without the standard ones; the library may know them, too."""
    toml: str
    """The library file, written anew from what was checked."""


def read_description(text: str, number: str, library: Library) -> Described:
    """Check what a part says of itself.

    Args:
        text: what it says.
        number: the part number that it has claimed.
        library: what the robot knows already.

    Raises:
        ConfigError: it is wrong, contradicts itself or the library, or the library knows the number.
    """
    problems = Problems()
    document = parse_document(text, SAID_BY_PART, problems)
    problems.raise_if_any()
    assert document is not None
    _check_values(document, problems)
    problems.raise_if_any()
    file = open_library_file(document, problems)
    known = dict(library.messages)
    add_message_types(known, file)
    part_type = read_part_type(file, known)
    root = file.table
    if part_type is None:
        root.report("describes no part: number, name and ports are missing")
    elif part_type.number != number:
        root.report(f'is "{part_type.number}", and the part has claimed as "{number}"', "number")
    elif (other := library.find(number)) is not None:
        root.report(f"the library knows {other.number} already, and its entry counts", "number")
    elif not part_type.ports:
        root.report("a part needs at least one port: publishes(...), on(...), serves(...) or calls(...)", "port")
    problems.raise_if_any()
    assert part_type is not None
    standard = {name for message in standard_message_types().values() for name in message.described()}
    own = carried_by(part_type) - standard
    messages = tuple(message for _, message in file.messages if message.name in own)
    return Described(part_type, messages, _toml(document.values, own))


def _check_values(document: Document, problems: Problems) -> None:
    allowed = (*MAY_SAY, *TABLES)
    for key in document.values:
        if key not in allowed:
            problems.add(document.location((key,)), f"a part may not say this of itself; it may say {quoted(allowed)}")
    for path, value in _scalars((), document.values):
        match value:
            case str() if not value.isprintable():
                problems.add(document.location(path), f"{value[:40]!r} contains a character that cannot be printed")
            case float() if not math.isfinite(value):
                problems.add(document.location(path), f"must be a finite number; it is {value}")
            case bool() | float() | str():
                pass
            case int() if not -_MOST_WHOLE <= value < _MOST_WHOLE:
                problems.add(document.location(path), "is a number with more than 64 bits")


def _scalars(path: KeyPath, value: object) -> Iterator[tuple[KeyPath, object]]:
    """Every value that is neither table nor list, and every key as a text of its own."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield (*path, key), key
            yield from _scalars((*path, key), inner)
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from _scalars((*path, place), inner)
    else:
        yield path, value


def _toml(values: dict[str, object], types: Collection[str]) -> str:
    """The file, after everything in it was read without a problem; it stands by itself."""
    lines = [f"{key} = {toml_value(value)}" for key in MAY_SAY if isinstance(value := values.get(key), str)]
    for name in TABLES:
        tables = values.get(name, [])
        assert isinstance(tables, list)
        for table in tables:
            if name != "type" or table["name"] in types:
                lines += ["", f"[[{name}]]"]
                lines += [f"{key} = {toml_value(value)}" for key, value in table.items()]
    return "\n".join(lines) + "\n"
