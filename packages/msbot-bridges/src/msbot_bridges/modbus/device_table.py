"""The table of a kind of device, a TOML file: which registers are which ports."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from msbot_agent.toml.document import read_document
from msbot_agent.toml.problems import Problems
from msbot_agent.toml.table import Table
from msbot_bridges.bridge.quantity import nearest_to_zero
from msbot_bridges.modbus.points import TYPES, WORD_ORDERS, ModbusPoint, PointUse, RegisterTable
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST_POINTS = 24
POLL_S = 0.2
LOST_AFTER = 3


@dataclass(frozen=True, slots=True)
class DeviceTable:
    """One kind of device."""

    maker: str
    """Used where the device itself does not say it."""
    product: str
    words: str
    units: Sequence[int]
    """The addresses on the line at which such a device may be."""
    poll_s: float
    lost_after: int
    """So many requests without an answer, one after the other, and it is lost."""
    points: Sequence[ModbusPoint]
    serial: ModbusPoint | None = None
    """Where the device has a number of its own."""

    def of_role(self, role: PointUse) -> list[ModbusPoint]:
        """Its points of one role."""
        return [one for one in self.points if one.role is role]


def read_device_table(path: Path) -> DeviceTable:
    """Read a table.

    Raises:
        ConfigError: it cannot be read, or something in it is wrong; every mistake is named with its line.
    """
    problems = Problems()
    document = read_document(path, problems)
    if document is None:
        problems.raise_if_any()
        raise ConfigError(f"{path} cannot be read")
    top = Table(document, problems, document.values)
    serial = top.table("serial")
    made = DeviceTable(
        top.name("maker", "ACME"),
        top.name("product", "pump"),
        top.prose("words", "Pump of ACME", default="", most=100),
        tuple(top.wholes("units", least=1, most=247)) or (1,),
        top.number("poll_s", default=POLL_S, least=0.02, most=60.0, unit="s"),
        top.whole("lost_after", default=LOST_AFTER, least=1, most=100),
        _points(top),
        _register(serial, "serial", PointUse.OUT) if serial.is_there else None,
    )
    if serial.is_there:
        serial.finish()
    top.finish()
    problems.raise_if_any()
    return made


def _points(top: Table) -> tuple[ModbusPoint, ...]:
    tables = top.tables("point")
    if not tables:
        top.report("has no point; add a table that begins with [[point]]")
    if len(tables) > MOST_POINTS:
        top.report(f"has {len(tables)} points; a part has room for {MOST_POINTS}", "point")
    points: list[ModbusPoint] = []
    for table in tables[:MOST_POINTS]:
        point = _point(table)
        if any(point.name == other.name for other in points):
            table.report(f'there is another point with the name "{point.name}"', "port")
        points.append(point)
    reported = {one.name for one in points if one.role is PointUse.OUT}
    for table, point in zip(tables, points, strict=False):
        if point.confirmed_by and point.confirmed_by not in reported:
            right = ", ".join(sorted(reported)) or "none"
            table.report(f'"{point.confirmed_by}" is no point with role "out"; there are: {right}', "confirmed_by")
    return tuple(points)


def _point(table: Table) -> ModbusPoint:
    role = PointUse(table.choice("role", [one.value for one in PointUse], default="out"))
    point = _register(table, table.name("port", "speed", forbidden="."), role)
    if role is not PointUse.OUT and not point.table.is_written:
        table.report(
            f'nobody can write a "{point.table.value}"; a port that is driven is a "coil" or "holding"', "table"
        )
    if role is PointUse.OUT:
        for key in ("safe", "confirmed_by", "default"):
            if key in table:
                table.report('is only for points with another role than "out"', key)
    table.finish()
    return point


def _register(table: Table, name: str, role: PointUse) -> ModbusPoint:
    kind = RegisterTable(table.choice("table", [one.value for one in RegisterTable], default="holding"))
    least, most = _limit(table, "least"), _limit(table, "most")
    if least is not None and most is not None and least >= most:
        table.report(f"is {least:g}; it must be less than most, {most:g}", "least")
        least = most = None
    scale = table.number("scale", default=1.0, least=-1e9, most=1e9)
    if scale == 0.0:
        table.report("is 0; every value would be the same", "scale")
        scale = 1.0
    if "address" not in table:
        table.report("is missing; add, for example, address = 16 (from 0)", "address")
    safe = table.number("safe", default=nearest_to_zero(least, most), least=-1e9, most=1e9)
    point = ModbusPoint(
        name,
        role,
        kind,
        table.whole("address", default=0, least=0, most=65_535),
        table.choice("type", TYPES, default="uint16"),
        table.choice("words", WORD_ORDERS, default="big"),
        table.text("unit", "rpm"),
        scale,
        table.number("offset", default=0.0, least=-1e9, most=1e9),
        least,
        most,
        safe if role is PointUse.IN else None,
        table.text("confirmed_by", "turns"),
        table.number("tolerance", default=0.0, least=0.0, most=1e9),
        table.number("default", default=nearest_to_zero(least, most), least=-1e9, most=1e9),
    )
    _check_value(table, point, "safe" if role is PointUse.IN else "default" if role is PointUse.SETTING else "")
    if point.address + point.count > 65_536:
        table.report("is too great: not all of its registers are there", "address")
    return point


def _check_value(table: Table, point: ModbusPoint, key: str) -> None:
    """A value that will be written must fit into the range and the registers."""
    if not key:
        return
    value = point.safe if key == "safe" else point.default
    assert value is not None
    low, high = -math.inf if point.least is None else point.least, math.inf if point.most is None else point.most
    if not low <= value <= high:
        table.report(f"is {value:g}; the range is {low:g} to {high:g}", key)
        return
    try:
        point.write(value)
    except ConfigError as error:
        table.report(str(error), key)


def _limit(table: Table, key: str) -> float | None:
    return table.number(key, default=0.0, least=-1e9, most=1e9) if key in table else None
