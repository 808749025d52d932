"""A point: one value in the registers of a device, and what it is in a robot. Without I/O."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum

from msbot.part import Message
from msbot.part.messages.standard import Number, Switch
from msbot_agent.text.sentence import said
from msbot_bridges.bridge import Fit, fits_of
from msbot_bridges.bridge.quantity import Quantity, messages_by_unit, quantity
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST_IN_A_BLOCK = 100
"""Registers or bits that are read with one request; a device need not have more than 125."""
_FORMATS: Mapping[str, tuple[str, int]] = {
    "uint16": ("H", 1),
    "int16": ("h", 1),
    "uint32": ("I", 2),
    "int32": ("i", 2),
    "float32": ("f", 2),
    "float64": ("d", 4),
}
"""Letter of `struct` and registers, by type."""
TYPES = tuple(_FORMATS)
WORD_ORDERS = ("big", "little")


class RegisterTable(Enum):
    """The four tables of a device."""

    COIL = "coil"
    DISCRETE = "discrete"
    INPUT = "input"
    HOLDING = "holding"

    @property
    def is_bits(self) -> bool:
        """Whether it has bits and no registers."""
        return self in (RegisterTable.COIL, RegisterTable.DISCRETE)

    @property
    def is_written(self) -> bool:
        """Whether it can be written."""
        return self in (RegisterTable.COIL, RegisterTable.HOLDING)


class PointUse(Enum):
    """What a point is for."""

    OUT = "out"
    """The device reports it."""
    IN = "in"
    """The robot drives it."""
    SETTING = "setting"
    """The slot sets it."""


@dataclass(frozen=True, slots=True)
class ModbusPoint:
    """One value of a device."""

    name: str
    role: PointUse
    table: RegisterTable
    address: int
    """From 0, as it is sent; many manuals count from 1."""
    format: str = "uint16"
    """How the number is written."""
    words: str = "big"
    """Which of several registers comes first: the one with the `big` or the `little` end."""
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    """The value in the unit is what is in the register times scale plus offset."""
    least: float | None = None
    most: float | None = None
    """The range, in the unit."""
    safe: float | None = None
    """The safe value, in the unit."""
    confirmed_by: str = ""
    """A point that the device reports, and that must have the safe value, too, before STOP is confirmed."""
    tolerance: float = 0.0
    default: float = 0.0
    """Of a setting."""

    @property
    def count(self) -> int:
        """Registers or bits."""
        return 1 if self.table.is_bits else _FORMATS[self.format][1]

    @property
    def quantity(self) -> Quantity | None:
        """What it is in a robot; None: on or off."""
        return None if self.table.is_bits else quantity(self.unit)

    @property
    def message(self) -> type[Message]:
        """The message of its port."""
        what = self.quantity
        return Switch if what is None else what.message

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Of its message."""
        what = self.quantity
        return {} if what is None else what.ranges(self.least, self.most)

    @property
    def step(self) -> float:
        """The least difference that the registers can hold, in the unit; 0 for floating point."""
        return 0.0 if self.format.startswith("float") else abs(self.scale)

    def read(self, words: Sequence[int]) -> float:
        """What the registers hold, in the unit; a bit is 0 or 1."""
        if self.table.is_bits:
            return float(bool(words[0]))
        letter, count = _FORMATS[self.format]
        ordered = words[:count] if self.words == "big" else words[:count][::-1]
        octets = b"".join(word.to_bytes(2, "big") for word in ordered)
        return float(struct.unpack(f">{letter}", octets)[0]) * self.scale + self.offset

    def write(self, value: float) -> list[int]:
        """What the registers must hold for a value in the unit; it is kept within the range.

        Raises:
            ConfigError: they cannot hold it.
        """
        if not math.isfinite(value):
            raise ConfigError(f"{self.name} cannot be {value}")
        value = min(
            max(value, -math.inf if self.least is None else self.least), math.inf if self.most is None else self.most
        )
        if self.table.is_bits:
            return [int(value != 0.0)]
        letter, count = _FORMATS[self.format]
        raw: float = (value - self.offset) / self.scale
        try:
            octets = struct.pack(f">{letter}", raw if self.format.startswith("float") else round(raw))
        except (struct.error, OverflowError):
            raise ConfigError(
                f"{self.name} = {value:g} does not fit into its {count} registers as {self.format}"
            ) from None
        words = [int.from_bytes(octets[at : at + 2], "big") for at in range(0, len(octets), 2)]
        return words if self.words == "big" else words[::-1]

    def message_of(self, value: float) -> Message | None:
        """A value in the unit as a message; None: no message has room for so great a number."""
        what = self.quantity
        return Switch(on=value != 0.0) if what is None else what.made(value)

    def value_of(self, message: Message) -> float:
        """The value in the unit that a message means."""
        what = self.quantity
        return float(bool(getattr(message, "on", False))) if what is None else what.number(message)

    def is_at(self, value: float, wanted: float) -> bool:
        """Whether a value that was read is the wanted one, as exactly as the registers can hold it."""
        nearest = self.read(self.write(wanted))
        return abs(value - nearest) <= max(self.tolerance, 1e-6 * max(1.0, abs(nearest)))


@dataclass(frozen=True, slots=True)
class Block:
    """Points that one request reads."""

    table: RegisterTable
    address: int
    count: int
    points: Sequence[ModbusPoint]


def blocks(points: Sequence[ModbusPoint]) -> Iterator[Block]:
    """Requests for these points: those that lie side by side are read together, gaps are never read."""
    for table in RegisterTable:
        inside: list[ModbusPoint] = []
        for one in sorted((one for one in points if one.table is table), key=lambda one: one.address):
            end = max((two.address + two.count for two in inside), default=one.address)
            start = inside[0].address if inside else one.address
            if inside and (one.address > end or one.address + one.count - start > MOST_IN_A_BLOCK):
                yield Block(table, start, end - start, tuple(inside))
                inside = []
            inside.append(one)
        if inside:
            end = max(one.address + one.count for one in inside)
            yield Block(table, inside[0].address, end - inside[0].address, tuple(inside))


def register_fits() -> tuple[Fit, ...]:
    """Which messages registers send, and are driven by: what the unit of a point says."""
    by_unit = [(message, said("registers in {units}", units=units)) for message, units in messages_by_unit()]
    reports: list[tuple[type[Message], str]] = [(Switch, said("coils")), (Switch, said("discrete inputs")), *by_unit]
    driven: list[tuple[type[Message], str]] = [(Switch, said("coils")), *by_unit]
    return fits_of([*reports, (Number, said("registers"))], [*driven, (Number, said("registers"))])
