"""What a robot's ports are in Home Assistant: the component of each field, and its discovery message. Without I/O."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from msbot.config import Direction, PartType, Port
from msbot_xrce.lazy import dataclass

MOST_FIELDS = 8
"""Fields of a port that are shown; a list is none."""
LONGEST_TEXT = 255
"""Characters of a state in Home Assistant."""
_NUMBERS = frozenset(("uint8", "uint16", "uint32", "uint64", "int8", "int16", "int32", "int64", "float32", "float64"))
_ANY_NUMBER = (-1e6, 1e6)
_LEVEL = (-100.0, 100.0)
_NOT_IN_ID = re.compile(r"[^A-Za-z0-9_-]+")
_CLASSES: Mapping[str, str] = {
    "°C": "temperature",
    "lx": "illuminance",
    "lux": "illuminance",
    "hPa": "atmospheric_pressure",
    "m": "distance",
    "V": "voltage",
    "A": "current",
    "g": "weight",
}
"""Home Assistant's device class, by unit."""
_UNITS: Mapping[str, str] = {"lux": "lx", "degrees": "°"}
"""Home Assistant's spelling, where it is another one."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One field of a port in Home Assistant."""

    slot: str
    port: str
    field: str
    component: str
    topic: str
    """Of its state; `/set` behind it is where it is told something."""
    config: Mapping[str, object]
    safe: bool | int | float | str | None = None
    """What a driven port has while STOP holds; None: it keeps what it has."""

    @property
    def is_driven(self) -> bool:
        """Whether Home Assistant drives it."""
        return "command_topic" in self.config


def topic_word(name: str) -> str:
    """A name as a level of a topic and as a part of an id."""
    return _NOT_IN_ID.sub("_", name) or "_"


def base_topic(robot: str) -> str:
    """What all topics of a robot begin with."""
    return f"msbot/{topic_word(robot)}"


def shown_fields(robot: str, slot: str, part_type: PartType, heard: frozenset[str]) -> list[Shown]:
    """What Home Assistant shows of the part in a slot.

    Args:
        robot: name of the robot.
        slot: name of the slot.
        part_type: what is in it.
        heard: those of its publishing ports that have a topic.
    """
    base = base_topic(robot)
    device = {
        "identifiers": [f"msbot_{topic_word(robot)}_{topic_word(slot)}"],
        "name": f"{robot} {slot}",
        "manufacturer": "MsBOT",
        "model": f"{part_type.name} ({part_type.number})",
    }
    shared: dict[str, object] = {
        "device": device,
        "availability": [{"topic": f"{base}/status"}, {"topic": f"{base}/{topic_word(slot)}/status"}],
        "availability_mode": "all",
    }
    found = []
    for port in part_type.ports:
        if port.message is None or port.reply is not None:
            continue
        if port.direction is Direction.PUBLISH and port.name in heard:
            entries = list(_readings(port))
        elif port.direction is Direction.SUBSCRIBE:
            entries = list(_driven(port))
        else:
            continue
        for field, component, more in entries:
            words = [topic_word(one) for one in (slot, port.name, field)]
            topic = "/".join([base, *words])
            config = {
                "name": port.name if len(entries) == 1 else f"{port.name} {field}",
                "unique_id": f"msbot_{topic_word(robot)}_{'_'.join(words)}",
                **({"state_topic": topic} if component != "button" else {}),
                **({"command_topic": f"{topic}/set"} if port.direction is Direction.SUBSCRIBE else {}),
                **more,
                **shared,
            }
            safe = port.safe.get(field) if port.safe is not None else None
            found.append(Shown(slot, port.name, field, component, topic, config, safe))
    return found


def _readings(port: Port) -> Iterator[tuple[str, str, dict[str, object]]]:
    assert port.message is not None
    for field, kind in list(port.message.leaves.items())[:MOST_FIELDS]:
        unit = port.message.units.get(field, "")
        unit = _UNITS.get(unit, unit)
        if kind.word == "bool":
            yield field, "binary_sensor", {}
        elif kind.word in _NUMBERS:
            more: dict[str, object] = {"state_class": "measurement"}
            more |= {"unit_of_measurement": unit} if unit else {}
            yield field, "sensor", more | ({"device_class": _CLASSES[unit]} if unit in _CLASSES else {})
        elif "[" not in kind.word:
            yield field, "sensor", {}


def _driven(port: Port) -> Iterator[tuple[str, str, dict[str, object]]]:
    """A port whose message is one value; several cannot be told apart in Home Assistant's components."""
    assert port.message is not None
    if port.message.name == "Trigger":
        yield "index", "button", {}
        return
    leaves = port.message.leaves
    if len(leaves) != 1:
        return
    ((field, kind),) = leaves.items()
    if kind.word == "bool":
        yield field, "switch", {}
    elif kind.word in _NUMBERS:
        unit = port.message.units.get(field, "")
        least, most = port.ranges.get(field, _LEVEL if port.message.name == "Level" else _ANY_NUMBER)
        more: dict[str, object] = {"min": least, "max": most, "step": 0.1 if kind.word.startswith("float") else 1}
        more |= {"mode": "box"} if (least, most) == _ANY_NUMBER else {}
        yield field, "number", more | ({"unit_of_measurement": _UNITS.get(unit, unit)} if unit else {})
    elif kind.word.startswith("text"):
        yield field, "text", {}


def robot_fields(robot: str) -> list[Shown]:
    """What Home Assistant shows of the robot: whether STOP holds, and a button that says it. GO is for people there."""
    base, word = base_topic(robot), topic_word(robot)
    shared: dict[str, object] = {
        "device": {"identifiers": [f"msbot_{word}"], "name": robot, "manufacturer": "MsBOT", "model": "robot"},
        "availability_topic": f"{base}/status",
    }
    stop = {"name": "STOP", "unique_id": f"msbot_{word}_stop", "command_topic": f"{base}/stop/set", **shared}
    stopped = {"name": "stopped", "unique_id": f"msbot_{word}_stopped", "state_topic": f"{base}/stopped", **shared}
    return [
        Shown("", "", "stop", "button", f"{base}/stop", stop),
        Shown("", "", "stopped", "binary_sensor", f"{base}/stopped", {"device_class": "problem", **stopped}),
    ]


def config_topic(prefix: str, shown: Shown) -> str:
    """Where its discovery message is."""
    return f"{prefix}/{shown.component}/{shown.config['unique_id']}/config"


def state_text(value: Any) -> str | None:  # noqa: ANN401 - a value of a message
    """A value as a state; None: it has none."""
    if isinstance(value, bool):
        return "ON" if value else "OFF"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else None
    return str(value)[:LONGEST_TEXT]


def command_value(shown: Shown, text: str) -> str:
    """What Home Assistant says, as people write values."""
    if shown.component == "switch":
        return {"ON": "true", "OFF": "false"}.get(text, text)
    return "1" if shown.component == "button" else text
