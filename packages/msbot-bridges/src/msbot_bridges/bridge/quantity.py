"""Units of other worlds as standard messages: what a number with a unit is in a robot.

Worlds whose devices name units (MQTT, Modbus) make their ports from this table, so that a distance in millimetres and
one in feet are both a `Distance`, and a part of one maker fits where a part of another maker was.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field

from msbot.part import Message
from msbot.part.messages.standard import (
    Angle,
    Battery,
    Distance,
    Gas,
    Level,
    Light,
    Number,
    Pressure,
    Speed,
    Temperature,
    Text,
    Weight,
)
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number of a device as a message."""

    message: type[Message]
    name: str
    """The field that has the number."""
    factor: float = 1.0
    offset: float = 0.0
    """The field is number times factor plus offset."""
    rest: Mapping[str, object] = field(default_factory=dict)
    """The other fields."""

    def make(self, number: float) -> Message:
        """The message for a number of the device."""
        return self.message(**{**self.rest, self.name: number * self.factor + self.offset})

    def made(self, number: float) -> Message | None:
        """The message for a number that a device has reported; None: no message has room for so great a number."""
        try:
            return self.make(number)
        except LocalProtocolError:
            return None

    def ranges(self, least: float | None, most: float | None) -> dict[str, tuple[float, float]]:
        """The range of the field, for one of the device; none where an end of that is missing."""
        if least is None or most is None or least >= most:
            return {}
        low, high = (round(end * self.factor + self.offset, 9) for end in (least, most))
        return {self.name: (low, high)}

    def number(self, message: Message) -> float:
        """The number of the device for a message."""
        return (float(getattr(message, self.name)) - self.offset) / self.factor


_BATTERY = {"volts": math.nan, "amperes": math.nan, "percent": math.nan}
_SEEN = {"metres": math.nan, "in_range": True}
NUMBER = Quantity(Number, "value")
LEVEL = Quantity(Level, "percent")
BATTERY_PERCENT = Quantity(Battery, "percent", rest=_BATTERY)
QUANTITIES: Mapping[str, Quantity] = {
    "°C": Quantity(Temperature, "celsius"),
    "°F": Quantity(Temperature, "celsius", 5 / 9, -160 / 9),
    "K": Quantity(Temperature, "celsius", 1.0, -273.15),
    "m": Quantity(Distance, "metres", rest=_SEEN),
    "cm": Quantity(Distance, "metres", 0.01, rest=_SEEN),
    "mm": Quantity(Distance, "metres", 0.001, rest=_SEEN),
    "in": Quantity(Distance, "metres", 0.0254, rest=_SEEN),
    "ft": Quantity(Distance, "metres", 0.3048, rest=_SEEN),
    "°": Quantity(Angle, "degrees"),
    "deg": Quantity(Angle, "degrees"),
    "rad": Quantity(Angle, "degrees", 180 / math.pi),
    "rpm": Quantity(Speed, "rpm"),
    "rad/s": Quantity(Speed, "rpm", 30 / math.pi),
    "%": LEVEL,
    "lx": Quantity(Light, "lux"),
    "hPa": Quantity(Pressure, "hectopascal"),
    "mbar": Quantity(Pressure, "hectopascal"),
    "Pa": Quantity(Pressure, "hectopascal", 0.01),
    "kPa": Quantity(Pressure, "hectopascal", 10.0),
    "bar": Quantity(Pressure, "hectopascal", 1000.0),
    "psi": Quantity(Pressure, "hectopascal", 68.947573),
    "ppm": Quantity(Gas, "ppm"),
    "ppb": Quantity(Gas, "ppm", 0.001),
    "g": Quantity(Weight, "grams"),
    "kg": Quantity(Weight, "grams", 1000.0),
}
"""By unit, as Home Assistant, Homie and tables of registers write them."""


def quantity(unit: str, kind: str = "") -> Quantity:
    """What a number is; a unit that no standard message has makes a `Number`.

    Args:
        unit: as the device names it.
        kind: more about it, as the device names it: `battery` is a share of a battery.
    """
    if kind == "battery" and unit in ("%", ""):
        return BATTERY_PERCENT
    return QUANTITIES.get(unit, NUMBER)


def text_message(text: str) -> Text:
    """The message for what a device has said in words; a message has no NUL characters."""
    return Text(text=text[:LONGEST_TEXT].replace("\0", "\N{REPLACEMENT CHARACTER}"))


LONGEST_TEXT = 200
"""Characters."""


def messages_by_unit() -> list[tuple[type[Message], str]]:
    """Each message with the units that make it: `rpm, rad/s`."""
    units: dict[type[Message], list[str]] = {}
    for unit, one in QUANTITIES.items():
        units.setdefault(one.message, []).append(unit)
    return [(message, ", ".join(found)) for message, found in units.items()]


def nearest_to_zero(least: float | None, most: float | None) -> float:
    """The number of a range that is nearest to zero: the safe value of a number that has no other."""
    return min(max(0.0, -math.inf if least is None else least), math.inf if most is None else most)
