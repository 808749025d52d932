"""Reads the `[driver]` table of a part type: how its ports meet hardware."""

from __future__ import annotations

import re
from collections.abc import Sequence

from msbot.config.library.parameter_reader import check_twice, read_parameter
from msbot.config.library.part_types import BusKind, DriverPin, DriverSpec, Pin
from msbot.config.toml.problems import suggestion
from msbot.config.toml.table import Table

FIRST_ADDRESS, LAST_ADDRESS = 0x08, 0x77
"""I2C addresses that a chip can have; the others are reserved (NXP UM10204, 3.1.12)."""
MOST_GPIO = 255
_ENTRY_POINT = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def read_driver(table: Table, pins: Sequence[Pin]) -> DriverSpec:
    """The driver of a part type with these pins."""
    if not table.is_there:
        return DriverSpec()
    none = table.text("none", "it has a controller of its own")
    if none:
        table.finish()
        return DriverSpec(none=none)
    entry_point = table.name("class", "my_parts:LightSensor")
    if entry_point and not _ENTRY_POINT.fullmatch(entry_point):
        table.problem(f'"{entry_point}" is not an entry point; write package.module:Name', "class")
    spec = DriverSpec(
        entry_point=entry_point,
        bus=BusKind(table.choice("bus", [kind.value for kind in BusKind])),
        pins=tuple(_read_pin(pin, pins) for pin in table.tables("pin")),
        addresses=tuple(table.wholes("addresses", least=FIRST_ADDRESS, most=LAST_ADDRESS)),
        device=table.text("device", "/dev/ttyACM0"),
        options=tuple(read_parameter(option) for option in table.tables("option")),
    )
    table.finish()
    if spec.bus is BusKind.I2C and not spec.addresses:
        table.problem("is missing; name what the chip can have, for example addresses = [0x76, 0x77]", "addresses")
    check_twice(table, "pin", [pin.name for pin in spec.pins])
    check_twice(table, "option", [option.name for option in spec.options])
    return spec


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
