"""Reads one file of the part library: a part type, message types, or both; every mistake becomes a problem."""

from __future__ import annotations

from collections.abc import Mapping

from msbot.config.library.driver_reader import read_driver
from msbot.config.library.message_types import FieldKind, MessageType, read_message_types
from msbot.config.library.parameter_reader import check_twice, read_parameter
from msbot.config.library.part_types import (
    Category,
    Direction,
    PartType,
    Pin,
    PinKind,
    Port,
    Supply,
)
from msbot.config.library.picture import picture_fault
from msbot.config.library.simulator_reader import SimulatorReader
from msbot.config.library.versions import ANY_VERSION, VERSION_SIGN, Versions, parse_versions
from msbot_agent.toml.document import Document
from msbot_agent.toml.problems import Problems, kind_words, suggestion
from msbot_agent.toml.table import Table
from msbot_xrce.common.lazy_dataclass import dataclass

FORBIDDEN_IN_PORTS = "."
"""A port is named `SLOT.port` in a binding."""

_MOST_HZ = 10_000.0
_MOST_V = 1000.0
_MOST_MA = 1_000_000.0


@dataclass(slots=True)
class LibraryFile:
    """One file being read; its message types are read before any file's ports."""

    document: Document
    table: Table
    messages: list[tuple[Table, MessageType]]


def open_library_file(document: Document, problems: Problems) -> LibraryFile:
    """Start reading a file with its message types."""
    table = Table(document, problems, document.values)
    return LibraryFile(document, table, read_message_types(table, document.file))


def add_message_types(messages: dict[str, MessageType], file: LibraryFile) -> None:
    """Add a file's message types to those of other files, with which they must agree."""
    for table, message in file.messages:
        other = messages.setdefault(message.name, message)
        if not other.same_as(message) and message.name:
            table.problem(
                f'the message type "{message.name}" has other fields in {other.source}; use those or another name',
                "name",
            )


def read_part_type(file: LibraryFile, known: Mapping[str, MessageType]) -> PartType | None:
    """The part type of a file; None when the file has message types only.

    Args:
        file: the file.
        known: all message types, including those of other files.
    """
    table = file.table
    if file.messages and not {"number", "name", "port"}.intersection(table.present_keys()):
        table.finish()
        return None
    ports = tuple(_read_port(port, known) for port in table.tables("port"))
    parameters = tuple(read_parameter(parameter) for parameter in table.tables("parameter"))
    pins = tuple(_read_pin(pin) for pin in table.tables("pin"))
    part_type = PartType(
        number=table.name("number", "ABCD", forbidden=VERSION_SIGN),
        name=table.name("name", "Light sensor"),
        manufacturer=table.text("manufacturer", "Massey University"),
        description=table.text("description", "Measures brightness"),
        specification=table.text("specification", "5V"),
        resolution=table.text("resolution", "10 bit"),
        ports=ports,
        parameters=parameters,
        compatible_with=tuple(table.names("compatible_with", "ABCD")),
        source=file.document.file,
        category=Category(table.choice("category", [category.value for category in Category], default="other")),
        keywords=tuple(table.names("keywords", "brightness")),
        supply=_read_supply(table.table("supply")),
        connector=table.text("connector", "3 pins, 2.54 mm"),
        pins=pins,
        driver=read_driver(table.table("driver"), pins),
        picture=_read_picture(table),
        versions=_read_versions(table),
        simulator=SimulatorReader(table.table("simulator"), ports, parameters).read(),
        origin=table.text("origin", "said by the part, adopted by ada"),
    )
    table.finish()
    _check_sources(table, part_type)
    check_twice(table, "port", [port.name for port in ports])
    check_twice(table, "parameter", [parameter.name for parameter in parameters])
    return part_type


def _check_sources(table: Table, part_type: PartType) -> None:
    """A board's driver measures or drives what the simulator knows."""
    simulator = part_type.simulator
    assert simulator is not None
    known = [one.name for one in simulator.controls]
    known += [*(one.name for one in simulator.readings), *(one.name for one in part_type.parameters)]
    for source in part_type.driver.board.sources:
        if source not in known:
            right = suggestion(source, known, none_known="describe it in [simulator]")
            table.problem(f'the simulator has no source "{source}"; {right}', "driver", "board", "sources")


def _read_port(table: Table, known: Mapping[str, MessageType]) -> Port:
    name = table.name("type", "Light")
    message = known.get(name)
    if message is None and name:
        right = suggestion(name, sorted(known), none_known="declare it")
        table.problem(f'there is no message type "{name}"; {right} Or declare it in a table [[type]]', "type")
    port = Port(
        name=table.name("name", "light", forbidden=FORBIDDEN_IN_PORTS),
        direction=Direction(table.choice("direction", [direction.value for direction in Direction])),
        type_name=name,
        rate_hz=table.number("rate_hz", default=0.0, least=0.0, most=_MOST_HZ, unit="times a second"),
        safe=table.scalars("safe") if "safe" in table else None,
        stop=table.text("stop", "on"),
        description=table.text("description", "How bright it is"),
        message=message,
    )
    if port.safe is not None and port.direction is Direction.PUBLISH:
        table.problem("only a port that subscribes can have a safe value; remove it", "safe")
    elif port.safe is not None and message is not None:
        _check_safe(table, port, message)
    if port.stop:
        _check_stop(table, port, message)
    table.finish()
    return port


def _check_stop(table: Table, port: Port, message: MessageType | None) -> None:
    if port.direction is not Direction.PUBLISH:
        table.problem("only a port that publishes can say STOP; remove it", "stop")
    elif message is not None and message.fields.get(port.stop) is not FieldKind.BOOL:
        flags = [name for name, kind in message.fields.items() if kind is FieldKind.BOOL]
        right = suggestion(port.stop, flags, none_known="remove it")
        table.problem(f'a {message.name} has no field "{port.stop}" that is true or false; {right}', "stop")


def _check_safe(table: Table, port: Port, message: MessageType) -> None:
    for name, value in (port.safe or {}).items():
        kind = message.fields.get(name)
        if kind is None:
            right = suggestion(name, list(message.fields), none_known="remove it")
            table.problem(f'a {message.name} has no field "{name}"; {right}', "safe", name)
        elif fault := kind.fault(value):
            table.problem(fault, "safe", name)


def _read_supply(table: Table) -> Supply | None:
    if not table.is_there:
        return None
    supply = Supply(
        min_v=table.number("min_v", default=5.0, least=0.0, most=_MOST_V, unit="V"),
        max_v=table.number("max_v", default=5.0, least=0.0, most=_MOST_V, unit="V"),
        current_ma=table.number("current_ma", default=0.0, least=0.0, most=_MOST_MA, unit="mA"),
    )
    table.finish()
    if supply.min_v > supply.max_v:
        table.problem(f"is {supply.min_v:g}, more than max_v = {supply.max_v:g}; exchange the two", "min_v")
    return supply


def _read_pin(table: Table) -> Pin:
    pin = Pin(
        name=table.name("name", "VCC"),
        kind=PinKind(table.choice("kind", [kind.value for kind in PinKind], default="signal")),
        description=table.text("description", "supply"),
    )
    table.finish()
    return pin


def _read_picture(table: Table) -> str:
    picture = table.scalar("picture")
    if picture is None:
        return ""
    fault = picture_fault(picture) if isinstance(picture, str) else f"must be an SVG text; it is {kind_words(picture)}"
    if fault is not None:
        table.problem(fault, "picture")
    return str(picture)


def _read_versions(table: Table) -> Versions:
    text = table.text("versions", ">=1.0, <2")
    versions = parse_versions(text)
    if versions is None:
        table.problem(f'"{text}" is not a range of versions; write for example versions = ">=1.0, <2"', "versions")
        return ANY_VERSION
    return versions
