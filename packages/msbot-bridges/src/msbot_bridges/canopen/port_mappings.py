"""Numbers of a device as messages of a robot, and back. Pure."""

from __future__ import annotations

from typing import Final

from msbot.part import Message
from msbot.part.messages.standard import (
    Angle,
    Count,
    Distance,
    Level,
    Light,
    Number,
    Pressure,
    Speed,
    Switch,
    Temperature,
    Weight,
)
from msbot_agent.text.sentence import said
from msbot_bridges.bridge import Fit, fits_of
from msbot_bridges.canopen.objects import Entry
from msbot_xrce.lazy import dataclass

_BY_UNIT: Final[dict[str, tuple[type[Message], str]]] = {
    "%": (Level, "percent"),
    "°": (Angle, "degrees"),
    "deg": (Angle, "degrees"),
    "rpm": (Speed, "rpm"),
    "1/min": (Speed, "rpm"),
    "°C": (Temperature, "celsius"),
    "degC": (Temperature, "celsius"),
    "m": (Distance, "metres"),
    "hPa": (Pressure, "hectopascal"),
    "mbar": (Pressure, "hectopascal"),
    "lx": (Light, "lux"),
    "g": (Weight, "grams"),
}


@dataclass(frozen=True, slots=True)
class PortMapping:
    """One port, and the number that it stands for."""

    port: str
    entry: Entry
    message: type[Message]
    field: str
    factor: float = 1.0
    """The value of the field for one unit of the entry."""
    bit: int | None = None
    """Only this bit of the entry."""

    def to_message(self, value: int) -> Message | None:
        """What the device has reported; None: a count for which no message has room."""
        if self.message is Switch:
            return Switch(on=bool(value if self.bit is None else value >> self.bit & 1))
        if self.message is Count:
            return Count(value=value) if -(2**31) <= value < 2**31 else None
        if self.message is Distance:
            return Distance(metres=value * self.factor, in_range=True)
        return self.message(**{self.field: value * self.factor})

    def to_value(self, message: Message, before: int) -> int:
        """What the device is to have; `before` is what the entry has, of which a bit may be another port's."""
        told = getattr(message, self.field)
        if self.bit is not None:
            return before | 1 << self.bit if told else before & ~(1 << self.bit)
        return int(told) if self.message in (Switch, Count) else round(told / self.factor)

    @property
    def safe(self) -> Message | None:
        """What is safest as far as one can know without the device: off, or no power."""
        if self.message is Switch:
            return Switch(on=False)
        return Level(percent=0) if self.message is Level else None


def mapping_fits() -> tuple[Fit, ...]:
    """Which messages devices send, and are driven by: drives, modules, and objects of an EDS by their unit."""
    drives: list[tuple[type[Message], str]] = [(message, said("drives")) for message in (Speed, Angle, Level)]
    units: dict[type[Message], list[str]] = {}
    for unit, (message, _) in _BY_UNIT.items():
        units.setdefault(message, []).append(unit)
    objects = [(message, said("objects in {units}", units=", ".join(found))) for message, found in units.items()]
    reports: list[tuple[type[Message], str]] = [
        *drives,
        (Switch, said("inputs")),
        (Level, said("analogue inputs")),
        *objects,
    ]
    driven: list[tuple[type[Message], str]] = [
        *drives,
        (Switch, said("outputs")),
        (Level, said("analogue outputs")),
        *objects,
    ]
    return fits_of(reports, driven)


def bits_of(port: str, entry: Entry, first: int) -> list[PortMapping]:
    """Eight ports for the bits of an entry; the first has the number `first`."""
    return [PortMapping(f"{port}_{first + bit}", entry, Switch, "on", bit=bit) for bit in range(8)]


def analogue(port: str, entry: Entry) -> PortMapping:
    """An analogue value, of which only its share of the most is known."""
    return PortMapping(port, entry, Level, "percent", 100 / entry.most)


def by_unit(port: str, entry: Entry, unit: str, factor: float, *, is_truth: bool) -> PortMapping:
    """A port whose message follows from the unit that an EDS names."""
    if is_truth:
        return PortMapping(port, entry, Switch, "on")
    if unit in _BY_UNIT:
        message, field = _BY_UNIT[unit]
        return PortMapping(port, entry, message, field, factor)
    if factor == 1 and entry.bits <= 32 and (entry.signed or entry.bits < 32):
        return PortMapping(port, entry, Count, "value")
    return PortMapping(port, entry, Number, "value", factor)
