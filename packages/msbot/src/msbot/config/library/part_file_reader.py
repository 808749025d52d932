"""Reads one file of the part library: a part type, message types, or both; every mistake becomes a problem."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from msbot.config.library.board_drivers import BOARD_DRIVERS, I2C_WIRES
from msbot.config.library.field_types import FieldKind, ListType, MessageType
from msbot.config.library.message_types import enums_of, read_message_types
from msbot.config.library.part_types import (
    BoardSpec,
    BusKind,
    Category,
    Direction,
    DriverPin,
    DriverSpec,
    Parameter,
    ParameterKind,
    PartType,
    Pin,
    PinKind,
    Port,
    Supply,
)
from msbot.config.library.picture import picture_fault
from msbot.config.library.safe_values import read_safe, safe_faults
from msbot.config.library.simulator_reader import SimulatorReader
from msbot.config.library.versions import ANY_VERSION, VERSION_SIGN, VersionRange, parse_versions
from msbot.service_types import ServiceType
from msbot_agent.toml.document import Document
from msbot_agent.toml.problems import Problems, suggestion, toml_value_in_words
from msbot_agent.toml.table import Table
from msbot_xrce.lazy import dataclass

# Reads what can be configured about a part: its parameters, and the options of its driver.


FORBIDDEN_IN_NAMES = "."
"""In a part's settings a dot marks what is none of its parameters: safe values, STOP."""


def read_parameter(table: Table) -> Parameter:
    """Read one table that describes a parameter or option."""
    kind = ParameterKind(table.choice("type", [kind.value for kind in ParameterKind]))
    if "default" not in table:
        table.report("is missing; add the value that holds when nobody sets another", "default")
    default = table.scalar("default")
    parameter = Parameter(
        name=table.name("name", "period_s", forbidden=FORBIDDEN_IN_NAMES),
        kind=kind,
        default="" if default is None else default,
        unit=table.text("unit", "s"),
        least=_limit(table, "min", kind),
        most=_limit(table, "max", kind),
        description=table.text("description", "Time between two measurements"),
    )
    table.finish()
    if default is not None and (fault := parameter.fault(default)):
        table.report(fault, "default")
    return parameter


def _limit(table: Table, key: str, kind: ParameterKind) -> float | None:
    if key not in table:
        return None
    if kind not in (ParameterKind.INT, ParameterKind.FLOAT):
        table.report("only a parameter of type int or float has limits; remove it", key)
    return table.number(key, default=0.0, least=-1e300, most=1e300)


def check_twice(table: Table, key: str, names: list[str]) -> None:
    """Note every name that occurs a second time."""
    for position, name in enumerate(names):
        if name and name in names[:position]:
            table.report(f'there are two with the name "{name}"; give each its own', key, position, "name")


# Reads the `[driver]` table of a part type: how its ports meet hardware.


FIRST_ADDRESS, LAST_ADDRESS = 0x08, 0x77
"""I2C addresses that a chip can have; the others are reserved (NXP UM10204, 3.1.12)."""
MOST_GPIO = 255
_ENTRY_POINT = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def read_driver(table: Table, pins: Sequence[Pin]) -> DriverSpec:
    """The driver of a part type with these pins."""
    if not table.is_there:
        return DriverSpec()
    options = tuple(read_parameter(option) for option in table.tables("option"))
    own = tuple(_read_driver_pin(pin, pins) for pin in table.tables("pin"))
    board = _read_board(table.table("board"), own, pins)
    none = table.text("none", "it has a controller of its own")
    if none:
        table.finish()
        return DriverSpec(none=none, board=board, options=options, pins=own)
    entry_point = table.name("class", "my_parts:LightSensor")
    if entry_point and not _ENTRY_POINT.fullmatch(entry_point):
        table.report(f'"{entry_point}" is not an entry point; write package.module:Name', "class")
    spec = DriverSpec(
        entry_point=entry_point,
        bus=BusKind(table.choice("bus", [kind.value for kind in BusKind])),
        pins=own,
        addresses=tuple(table.wholes("addresses", least=FIRST_ADDRESS, most=LAST_ADDRESS)),
        device=table.text("device", "/dev/ttyACM0"),
        options=options,
        board=board,
    )
    table.finish()
    if spec.bus is BusKind.I2C and not spec.addresses:
        table.report("is missing; name what the chip can have, for example addresses = [0x76, 0x77]", "addresses")
    check_twice(table, "pin", [pin.name for pin in spec.pins])
    check_twice(table, "option", [option.name for option in spec.options])
    return spec


def _read_board(table: Table, own: Sequence[DriverPin], pins: Sequence[Pin]) -> BoardSpec:
    """How a board drives it; the wires are those of the driver on Linux unless others are named."""
    if not table.is_there:
        return BoardSpec()
    name = table.choice("driver", sorted(BOARD_DRIVERS))
    sources = tuple(table.names("sources", "obstacle", required=True))
    wires = {wire: str(pin) for wire, pin in table.scalars("pins").items()}
    table.finish()
    driver = BOARD_DRIVERS.get(name)
    if driver is not None and sources and len(sources) != len(driver.sources):
        table.report(f"the driver {name} has {len(driver.sources)}: {', '.join(driver.sources)}", "sources")
    known = [pin.name for pin in pins]
    for wire, pin in wires.items():
        if pin not in known:
            right = suggestion(pin, known, none_known="describe it in a table [[pin]]")
            table.report(f'the part has no pin "{pin}"; {right}', "pins", wire)
    if driver is not None and driver.on_i2c and not wires:
        wires = {wire: wire.upper() for wire in I2C_WIRES}
    return BoardSpec(name, sources, wires or {pin.name: pin.pin for pin in own})


def _read_driver_pin(table: Table, pins: Sequence[Pin]) -> DriverPin:
    known = [pin.name for pin in pins]
    analog = "channel" in table
    key = "channel" if analog else "gpio"
    found = DriverPin(
        name=table.name("name", "trigger", forbidden="=,"),
        pin=table.name("pin", "TRIG"),
        default=table.whole(key, default=0, least=0, most=MOST_GPIO) if key in table else None,
        analog=analog,
        description=table.text("description", "through a resistor of 330 ohms"),
    )
    table.finish()
    if found.pin and found.pin not in known:
        right = suggestion(found.pin, known, none_known="describe it in a table [[pin]]")
        table.report(f'the part has no pin "{found.pin}"; {right}', "pin")
    return found


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
            table.report(
                f'the message type "{message.name}" has other fields in {other.source}; use those or another name',
                "name",
            )
        theirs = {one.name: one for known in messages.values() for one in enums_of(known)}
        for one in enums_of(message):
            if theirs[one.name] != one:
                table.report(f'the enum "{one.name}" has other names elsewhere; use those or another name', "fields")


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
        lacks=tuple(table.names("lacks", "position")),
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
            table.report(f'the simulator has no source "{source}"; {right}', "driver", "board", "sources")


def _read_port(table: Table, known: Mapping[str, MessageType]) -> Port:
    direction = _read_direction(table)
    reply = None
    if direction.is_service:
        request_name, message = _read_port_type(table, "request", known)
        reply_name, reply = _read_port_type(table, "reply", known)
        type_name = str(ServiceType(request_name, reply_name))
    else:
        type_name, message = _read_port_type(table, "type", known)
    port = Port(
        name=table.name("name", "light", forbidden=FORBIDDEN_IN_PORTS),
        direction=direction,
        type_name=type_name,
        rate_hz=table.number("rate_hz", default=0.0, least=0.0, most=_MOST_HZ, unit="times a second"),
        safe=read_safe(table.table("safe"), message) if "safe" in table else None,
        stop=table.text("stop", "on"),
        stops_by=table.text("stops_by", "quick stop"),
        description=table.text("description", "How bright it is"),
        message=message,
        reply=reply,
        ranges=_read_ranges(table.table("ranges"), message),
    )
    if port.safe is not None and port.direction is not Direction.SUBSCRIBE:
        table.report("only a port that subscribes can have a safe value; remove it", "safe")
    elif port.safe is not None and message is not None:
        for name, fault in safe_faults(port, port.safe):
            table.report(fault, "safe", name)
    if port.stops_by and port.direction is not Direction.SUBSCRIBE:
        table.report("only a port that subscribes can be stopped; remove it", "stops_by")
    if port.stop:
        _check_stop(table, port, message)
    table.finish()
    return port


def _read_direction(table: Table) -> Direction:
    """The direction of a port; a word that is none of them is one mistake, so the other keys decide what it means."""
    direction = Direction(table.choice("direction", [direction.value for direction in Direction]))
    if table.item("direction") != direction.value:
        if "request" in table or "reply" in table:
            return Direction.SERVE
        if "safe" in table:
            return Direction.SUBSCRIBE
    return direction


def _read_port_type(table: Table, key: str, known: Mapping[str, MessageType]) -> tuple[str, MessageType | None]:
    """The name and the fields of a message that a port carries."""
    name = table.name(key, "Light")
    message = known.get(name)
    if message is None and name:
        right = suggestion(name, sorted(known), none_known="declare it")
        table.report(f'there is no message type "{name}"; {right} Or declare it in a table [[type]]', key)
    return name, message


def _read_ranges(table: Table, message: MessageType | None) -> dict[str, tuple[float, float]]:
    """The least and the greatest value of fields."""
    found = {}
    for name in table.present_keys():
        value = table.item(name)
        leaf = None if message is None else message.leaves.get(name)
        kind = leaf.element if isinstance(leaf, ListType) else leaf
        if message is not None and leaf is None:
            right = suggestion(name, list(message.leaves), none_known="remove it")
            table.report(f'a {message.name} has no field "{name}"; {right}', name)
        elif message is not None and (not isinstance(kind, FieldKind) or kind in (FieldKind.BOOL, FieldKind.TEXT)):
            table.report("only a number has a range; remove it", name)
        elif (
            not isinstance(value, list)
            or len(value) != 2
            or not all(isinstance(one, int | float) and not isinstance(one, bool) for one in value)
            or not value[0] < value[1]
        ):
            table.report(f"must be the least and the greatest value, for example {name} = [0, 100]", name)
        else:
            found[name] = float(value[0]), float(value[1])
    return found


def _check_stop(table: Table, port: Port, message: MessageType | None) -> None:
    if port.direction is not Direction.PUBLISH:
        table.report("only a port that publishes can say STOP; remove it", "stop")
    elif message is not None and message.fields.get(port.stop) is not FieldKind.BOOL:
        flags = [name for name, kind in message.fields.items() if kind is FieldKind.BOOL]
        right = suggestion(port.stop, flags, none_known="remove it")
        table.report(f'a {message.name} has no field "{port.stop}" that is true or false; {right}', "stop")


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
        table.report(f"is {supply.min_v:g}, more than max_v = {supply.max_v:g}; exchange the two", "min_v")
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
    fault = (
        picture_fault(picture)
        if isinstance(picture, str)
        else f"must be an SVG text; it is {toml_value_in_words(picture)}"
    )
    if fault is not None:
        table.report(fault, "picture")
    return str(picture)


def _read_versions(table: Table) -> VersionRange:
    text = table.text("versions", ">=1.0, <2")
    versions = parse_versions(text)
    if versions is None:
        table.report(f'"{text}" is not a range of versions; write for example versions = ">=1.0, <2"', "versions")
        return ANY_VERSION
    return versions
