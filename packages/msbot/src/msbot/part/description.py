"""What a part says of itself: a library file (docs/reference/library.md), made from what its program declares.

The same text comes out in every home, so that a robot that has adopted a part knows it wherever its program runs.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path

from msbot.part.join.pnp_messages import DESCRIPTION_BEGINS, LEAST_DESCRIPTION, MOST_DESCRIPTION
from msbot.part.messages.leaves import leaf_codecs, leaves_of
from msbot.part.messages.message import Message, fields_of
from msbot.part.part_settings import Value
from msbot.part.program import Exchange, ProgramDeclarations
from msbot_xrce.errors import ConfigError

_KINDS = {bool: "bool", int: "int", float: "float", str: "text"}


def describe(number: str, name: str, program: ProgramDeclarations) -> str:
    """The description of a part.

    Args:
        number: its part number.
        name: what it is, in a few words.
        program: what it declares.

    Raises:
        ConfigError: a setting has no default, a message cannot be described, or all of it is too long.
    """
    text = "\n".join(_lines(number, name, program)) + "\n"
    size = len(text.encode())
    if size > MOST_DESCRIPTION:
        raise ConfigError(
            f"what the part says of itself has {size:,} bytes, and may have {MOST_DESCRIPTION:,}: "
            "give it fewer ports and settings, or write a library file"
        )
    return text + "\n" * (LEAST_DESCRIPTION - size)


def _lines(number: str, name: str, program: ProgramDeclarations) -> Iterator[str]:
    yield f"{DESCRIPTION_BEGINS}{_value(number)}"
    yield f"name = {_value(name)}"
    services = bool(program.servers or program.calls)
    if bool(program.listeners) != bool(program.publications) and not services:
        yield f"category = {_value('actuator' if program.listeners else 'sensor')}"
    classes: list[type[Message]] = []
    for port, message_class in program.publications.items():
        yield from _port(port, "publish", message_class)
        classes.append(message_class)
    for port, listener in program.listeners.items():
        yield from _port(port, "subscribe", listener.message_class)
        if listener.safe is not None:
            yield f"safe = {_table(_values(listener.safe))}"
        if listener.ranges:
            ends = (f"{field} = [{_value(least)}, {_value(most)}]" for field, (least, most) in listener.ranges.items())
            yield f"ranges = {{{', '.join(ends)}}}"
        if words := program.stops_by.get(port):
            yield f"stops_by = {_value(words)}"
        classes.append(listener.message_class)
    for port, exchange in program.calls.items():
        yield from _service(port, "call", exchange)
        classes += [exchange.request, exchange.reply]
    for port, server in program.servers.items():
        yield from _service(port, "serve", server.exchange)
        classes += [server.exchange.request, server.exchange.reply]
    for setting in program.settings.followers:
        yield from _parameter(setting, program)
    told: dict[type, None] = {}
    for message_class in classes:
        _add_with_inside(message_class, told)
    for one in told:
        if issubclass(one, IntEnum):
            yield from _enum(one)
        elif issubclass(one, Message):
            yield from _type(one)


def _port(name: str, direction: str, message_class: type[Message]) -> Iterator[str]:
    yield from ("", "[[port]]", f"name = {_value(name)}", f"direction = {_value(direction)}")
    yield f"type = {_value(message_class.type_name)}"


def _service(name: str, direction: str, exchange: Exchange) -> Iterator[str]:
    yield from ("", "[[port]]", f"name = {_value(name)}", f"direction = {_value(direction)}")
    yield f"request = {_value(exchange.request.type_name)}"
    yield f"reply = {_value(exchange.reply.type_name)}"


def _parameter(name: str, program: ProgramDeclarations) -> Iterator[str]:
    declared = program.settings.declared.get(name)
    if declared is None:
        raise ConfigError(
            f"setting {name!r} needs a default, because the part describes itself: for example "
            f"on_setting({name!r}, float, default=1.0) or every({name!r}, default=1.0)"
        )
    yield from ("", "[[parameter]]", f"name = {_value(name)}", f"type = {_value(_KINDS[declared.kind])}")
    yield f"default = {_value(declared.kind(declared.default))}"
    for key, limit in (("min", declared.least), ("max", declared.most)):
        if limit is not None:
            yield f"{key} = {_value(limit)}"
    if declared.unit:
        yield f"unit = {_value(declared.unit)}"


def _add_with_inside(cls: type, told: dict[type, None]) -> None:
    """Add a class after those inside it: a type stands above those that have it inside."""
    if issubclass(cls, Message):
        for field in fields_of(cls):
            if field.codec.inside is not None:
                _add_with_inside(field.codec.inside, told)
    told.setdefault(cls)


def _enum(kind: type[IntEnum]) -> Iterator[str]:
    if [int(member) for member in kind] != list(range(len(kind))):
        raise ConfigError(f"{kind.__name__} cannot be described: number its names from 0, one after the other")
    yield from ("", "[[type]]", f"name = {_value(kind.__name__)}")
    yield f"enum = [{', '.join(_value(member.name.lower()) for member in kind)}]"


def _type(message_class: type[Message]) -> Iterator[str]:
    yield from ("", "[[type]]", f"name = {_value(message_class.type_name)}")
    kinds = {field.name: field.codec.kind for field in fields_of(message_class)}
    for field in fields_of(message_class):
        if not field.codec.kind or field.codec.kind.endswith("[]"):
            raise ConfigError(
                f"{_place(message_class)}{message_class.__name__}.{field.name} is {field.codec.word}, "
                "which a part cannot describe: say how many there can be, Annotated[..., AtMost(64)]; "
                "there are no lists of lists"
            )
    yield f"fields = {_table(kinds)}"
    units = message_class.__dict__.get("units")
    if isinstance(units, dict) and units:
        yield f"units = {_table({field: str(units[field]) for field in kinds if field in units})}"


def _place(message_class: type[Message]) -> str:
    """Where the class begins in its program, `part.py:12: `; empty where that cannot be known, as at a prompt."""
    try:
        path, (_, line) = inspect.getsourcefile(message_class), inspect.getsourcelines(message_class)
    except (OSError, TypeError):
        return ""
    return "" if path is None else f"{Path(path).name}:{line}: "


def _values(message: Message) -> dict[str, Value]:
    codecs = leaf_codecs(type(message))
    return {
        way: float(value) if codecs[way].kind.startswith("float") and not isinstance(value, str) else value
        for way, value in leaves_of(message).items()
    }


def _table(values: dict[str, Value] | dict[str, str]) -> str:
    return "{" + ", ".join(f"{name} = {_value(value)}" for name, value in values.items()) + "}"


def _value(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    return repr(value)
