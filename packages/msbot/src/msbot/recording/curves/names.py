"""What the curves of a robot are called, the same on the page, in the terminal, in tables and pictures.

`SLOT.PORT.FIELD` is a field of what goes through a port (`knob.level.percent`), `SLOT:SETTING` a setting
(`ear:threshold`), and what begins with @ was measured at the robot itself (`@bus`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

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
    return any(name == one or name.startswith(f"{one}.") or name.startswith(f"{one}:") for one in wanted)


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
