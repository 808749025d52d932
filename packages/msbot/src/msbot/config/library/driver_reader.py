"""Reads the `[driver]` table of a part type: how its ports meet hardware."""

from __future__ import annotations

import re
from collections.abc import Sequence

from msbot.config.library.board_drivers import BOARD_DRIVERS, I2C_WIRES
from msbot.config.library.parameter_reader import check_twice, read_parameter
from msbot.config.library.part_types import BoardSpec, BusKind, DriverPin, DriverSpec, Pin
from msbot_agent.toml.problems import suggestion
from msbot_agent.toml.table import Table

FIRST_ADDRESS, LAST_ADDRESS = 0x08, 0x77
"""I2C addresses that a chip can have; the others are reserved (NXP UM10204, 3.1.12)."""
MOST_GPIO = 255
_ENTRY_POINT = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def read_driver(table: Table, pins: Sequence[Pin]) -> DriverSpec:
    """The driver of a part type with these pins."""
    if not table.is_there:
        return DriverSpec()
    options = tuple(read_parameter(option) for option in table.tables("option"))
    own = tuple(_read_pin(pin, pins) for pin in table.tables("pin"))
    board = _read_board(table.table("board"), own, pins)
    none = table.text("none", "it has a controller of its own")
    if none:
        table.finish()
        return DriverSpec(none=none, board=board, options=options, pins=own)
    entry_point = table.name("class", "my_parts:LightSensor")
    if entry_point and not _ENTRY_POINT.fullmatch(entry_point):
        table.problem(f'"{entry_point}" is not an entry point; write package.module:Name', "class")
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
        table.problem("is missing; name what the chip can have, for example addresses = [0x76, 0x77]", "addresses")
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
        table.problem(f"the driver {name} has {len(driver.sources)}: {', '.join(driver.sources)}", "sources")
    known = [pin.name for pin in pins]
    for wire, pin in wires.items():
        if pin not in known:
            right = suggestion(pin, known, none_known="describe it in a table [[pin]]")
            table.problem(f'the part has no pin "{pin}"; {right}', "pins", wire)
    if driver is not None and driver.on_i2c and not wires:
        wires = {wire: wire.upper() for wire in I2C_WIRES}
    return BoardSpec(name, sources, wires or {pin.name: pin.pin for pin in own})


def _read_pin(table: Table, pins: Sequence[Pin]) -> DriverPin:
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
        table.problem(f'the part has no pin "{found.pin}"; {right}', "pin")
    return found
