"""A curve: numbers over time, with what is worth knowing about them. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from msbot_xrce.lazy import dataclass

Point = tuple[float, float]
"""(seconds, value)."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What a piece of a curve comes to."""

    count: int
    mean: float
    """Of the values, whatever the time between them."""
    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Curve:
    """The numbers of one thing over time."""

    name: str
    points: Sequence[Point]
    """Oldest first."""
    unit: str = ""


def figures_of(values: Sequence[float]) -> Figures | None:
    """Mean, least and greatest; None: there is no value. What is not a number (NaN, infinity) is left out."""
    finite = values if all(map(math.isfinite, values)) else [value for value in values if math.isfinite(value)]
    if not finite:
        return None
    return Figures(len(finite), math.fsum(finite) / len(finite), min(finite), max(finite))


def thinned(points: Sequence[Point], most: int) -> Sequence[Point]:
    """At most this many points that show the same curve: of each step its least and its greatest."""
    if len(points) <= most:
        return points
    step = -(-len(points) // max(most // 2, 1))
    kept: list[Point] = []
    for first in range(0, len(points), step):
        part = points[first : first + step]
        kept += sorted({min(part, key=_value), max(part, key=_value)})
    return kept


def _value(point: Point) -> float:
    return point[1]


# What the curves of a robot are called, the same on the page, in the terminal, in tables and pictures.
#
# `SLOT.PORT.FIELD` is a field of what goes through a port (`knob.level.percent`), `SLOT:SETTING` a setting
# (`ear:threshold`), and what begins with @ was measured at the robot itself (`@bus`).


BUS: Final = "@bus"
"""Share of the time in which the CAN bus is busy."""
FRAMES: Final = "@frames"
"""CAN frames a second."""
LATE: Final = "@late"
"""How late the master does what is due."""
LATENCY: Final = "@latency"
"""How long a sample takes through the master."""
BEAT: Final = "@beat."
"""With a slot behind it: the time between two beats of its part."""
ACK: Final = "@ack."
"""With a slot behind it: the time until its part has acknowledged a message."""
UNITS: Final[Mapping[str, str]] = {BUS: "%", FRAMES: "1/s", LATE: "ms", LATENCY: "ms"}
_SLOT_UNITS: Final[Mapping[str, str]] = {BEAT: "s", ACK: "ms"}
_FOREIGN: Final = re.compile(r"[^A-Za-z0-9.]+")
_CAPITAL: Final = re.compile(r"(?<=[a-z0-9])([A-Z])")


def field_name(name: str) -> str:
    """The name of a field as curves have it, whoever writes it: `pose.wheelSpeed[0]` is `pose.wheel_speed.0`."""
    shown = _CAPITAL.sub(r"_\1", name.replace("[", ".").replace("]", "")).lower()
    return ".".join(_FOREIGN.sub("_", piece).strip("_") for piece in shown.split("."))


def port_curve(slot: str, port: str, field: str) -> str:
    """The name of a field that goes through a port."""
    return f"{slot}.{port}.{field_name(field)}"


def setting_curve(slot: str, name: str) -> str:
    """The name of a setting."""
    return f"{slot}:{name}"


def beat_curve(slot: str) -> str:
    """The name of the time between the beats of the part in a slot."""
    return f"{BEAT}{slot}"


def ack_curve(slot: str) -> str:
    """The name of the time until the part in a slot has acknowledged a message."""
    return f"{ACK}{slot}"


def measured_unit(name: str) -> str:
    """The unit of a curve that was measured at the robot itself; empty: it is another curve."""
    return UNITS.get(name) or next((unit for begin, unit in _SLOT_UNITS.items() if name.startswith(begin)), "")


def is_wanted(name: str, wanted: Iterable[str]) -> bool:
    """Whether a curve is one that was asked for, or belongs to it: `knob.level` has all fields of that port."""
    return any(name == one or name.startswith((f"{one}.", f"{one}[", f"{one}:")) for one in wanted)


def number_of(value: object) -> float | None:
    """A value as a number: true is 1; None: it is none."""
    if isinstance(value, bool | int | float):
        return float(value)
    if isinstance(value, str):
        if value in ("true", "false"):
            return float(value == "true")
        try:
            return float(value)
        except ValueError:
            return None
    return None


def close_names(name: str, known: Sequence[str], most: int = 8) -> list[str]:
    """Those of the known names that somebody may have meant."""
    from difflib import get_close_matches

    found = [one for one in known if name.casefold() in one.casefold()]
    return (found or get_close_matches(name, known, most, 0.4))[:most]


# Curves that somebody asks for by name, also those that nobody has measured yet.


class WantedCurves:
    """What was asked for, until it is there.

    Args:
        names: of curves, or of ports or slots with all their curves.
        most: so many are shown at the same time.
    """

    def __init__(self, names: Iterable[str], most: int) -> None:
        self.awaited = [name for name in names if name]
        """What of it nobody has measured so far."""
        self._most = most

    def found(self, known: Iterable[str], shown: Sequence[str] = ()) -> list[str]:
        """The curves that are there now and are not shown yet; they are awaited no longer."""
        known = list(known)
        more = [name for name in known if name not in shown and is_wanted(name, self.awaited)]
        self.awaited = [one for one in self.awaited if not any(is_wanted(name, [one]) for name in known)]
        return more[: max(0, self._most - len(shown))]
