"""A property of a Homie device as ports; Homie 4 and 5 say the same about it in two ways."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from msbot.part import Message
from msbot.part.messages.standard import Colour, Count, Switch, Text, Trigger
from msbot_bridges.bridge import DeviceSetting, Value
from msbot_bridges.bridge.quantity import NUMBER, Quantity, nearest_to_zero, quantity, text_message
from msbot_bridges.mqtt.device_model import CommandPort, Order, PortNames, SettingTopic, StatePort
from msbot_bridges.mqtt.ha_entity import GREATEST_NUMBER
from msbot_bridges.mqtt.topics import checked_topic
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_NEAR = 0.005


@dataclass(frozen=True, slots=True)
class HomieProperty:
    """What a device says about one of its properties."""

    topic: str
    name: str
    datatype: str
    format: str = ""
    unit: str = ""
    is_settable: bool = False
    is_retained: bool = True


DATATYPES: Mapping[str, type[Message]] = {
    "boolean": Switch,
    "integer": Count,
    "float": NUMBER.message,
    "enum": Text,
    "string": Text,
    "color": Colour,
}
"""What a property without a unit is; a number with a unit is what the unit says."""


class HomiePorts:
    """The ports and settings of a device, from its properties.

    Args:
        setting_nodes: nodes whose properties are settings.
    """

    def __init__(self, setting_nodes: Collection[str]) -> None:
        self.readings: list[StatePort] = []
        self.commands: list[CommandPort] = []
        self.settings: list[SettingTopic] = []
        self.left_out: list[str] = []
        self._setting_nodes = setting_nodes
        self._names = PortNames()

    def add(self, one: HomieProperty) -> None:
        """Take one property."""
        try:
            checked_topic(one.topic, "its id")
            if one.topic.split("/")[-2] in self._setting_nodes:
                self.settings.append(homie_setting(one, self._names))
            else:
                readings, commands = homie_ports(one, self._names)
                self.readings += readings
                self.commands += commands
        except ConfigError as error:
            self.left_out.append(f"{one.name}: {error}")


MOST_PROPERTIES = 400
"""Of a device; further ones are not looked at."""
SETTING_NODES = ("settings", "config")
"""Homie has no word for settings; these names of nodes are common."""


def homie_ports(one: HomieProperty, names: PortNames) -> tuple[list[StatePort], list[CommandPort]]:
    """The ports of a property.

    Raises:
        ConfigError: it has none; the text says why.
    """
    if one.datatype == "boolean":
        return _boolean(one, names)
    if one.datatype in ("integer", "float"):
        return _number(one, names)
    if one.datatype in ("enum", "string"):
        return _text(one, names)
    if one.datatype == "color" and "rgb" in one.format.split(","):
        return _colour(one, names)
    what = f"{one.datatype} {one.format}".strip()
    raise ConfigError(f"{what or 'a property without a datatype'} has no port here")


def homie_setting(one: HomieProperty, names: PortNames) -> SettingTopic:
    """A property that configures its device, as a setting.

    Raises:
        ConfigError: it is none; the text says why.
    """
    kind = _KINDS.get(one.datatype)
    if kind is None or not one.is_settable or not one.is_retained:
        raise ConfigError(f"a setting is settable, retained, and one of {', '.join(_KINDS)}")
    least, most = _range(one.format) if kind in (int, float) else (None, None)
    choices = tuple(one.format.split(",")) if one.datatype == "enum" else ()

    def read(payload: str) -> Value | None:
        if kind is bool:
            return {"true": True, "false": False}.get(payload)
        if kind is str:
            return None if choices and payload not in choices else payload[:200]
        value = _finite(payload)
        return None if value is None else round(value) if kind is int else value

    def orders(value: Value) -> Sequence[Order]:
        return [Order(f"{one.topic}/set", str(value).lower() if isinstance(value, bool) else str(value))]

    default: Value = False if kind is bool else "" if kind is str else 0
    setting = DeviceSetting(names.name(one.name), kind, default, least, most, one.unit, choices)
    return SettingTopic(setting, orders, one.topic, read)


_KINDS: Mapping[str, type[Value]] = {"boolean": bool, "integer": int, "float": float, "enum": str, "string": str}


def _names(one: HomieProperty, names: PortNames) -> tuple[str, str]:
    """Names of command and reading; what is only read has the plain name."""
    plain = names.name(one.name)
    return (plain, names.name(f"{plain}_state")) if one.is_settable else ("", plain)


def _boolean(one: HomieProperty, names: PortNames) -> tuple[list[StatePort], list[CommandPort]]:
    command, reading = _names(one, names)
    state = {"true": True, "false": False}

    def read(payload: str) -> Message | None:
        return Switch(on=state[payload]) if payload in state else None

    def orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Switch)
        return [Order(f"{one.topic}/set", "true" if message.on else "false")]

    readings = [StatePort(reading, Switch, one.topic, read)] if one.is_retained or not one.is_settable else []
    if not one.is_settable:
        return readings, []
    if not one.is_retained:  # brew coffee: something that happens once, and has no state
        press = [Order(f"{one.topic}/set", "true")]
        return [], [CommandPort(command, Trigger, None, lambda _: press, ())]
    safe = Switch(on=False)
    stopped = {"false": True, "true": False}
    return readings, [
        CommandPort(command, Switch, safe, orders, orders(safe), one.topic, stopped.get, "that it is off")
    ]


def _range(text: str) -> tuple[float | None, float | None]:
    """`min:max[:step]`, each of which may be missing."""
    least, _, rest = text.partition(":")
    try:
        found = [float(word) if word else None for word in (least, rest.partition(":")[0])]
    except ValueError:
        return None, None
    if any(one is not None and not abs(one) <= GREATEST_NUMBER for one in found):
        return None, None
    return found[0], found[1]


def _finite(payload: str) -> float | None:
    try:
        value = float(payload)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _number(one: HomieProperty, names: PortNames) -> tuple[list[StatePort], list[CommandPort]]:
    command, reading = _names(one, names)
    least, most = _range(one.format)
    is_whole = one.datatype == "integer"
    what = quantity(one.unit)
    if is_whole and what is NUMBER:
        what = _COUNT

    def read(payload: str) -> Message | None:
        value = _finite(payload)
        if value is None or (what is _COUNT and not -(2**31) <= value < 2**31):
            return None
        return Count(value=int(value)) if what is _COUNT else what.made(value)

    def orders(message: Message) -> Sequence[Order]:
        value = what.number(message)
        if not math.isfinite(value):
            return ()
        value = max(-math.inf if least is None else least, min(math.inf if most is None else most, value))
        return [Order(f"{one.topic}/set", str(round(value)) if is_whole else f"{value:.9g}")]

    readings = [StatePort(reading, what.message, one.topic, read)]
    if not one.is_settable:
        return readings, []
    safe_number = nearest_to_zero(least, most)
    span = (most - least) if least is not None and most is not None else 0.0
    tolerance = max(span * _NEAR, 1e-6)

    def is_safe(payload: str) -> bool | None:
        value = _finite(payload)
        return None if value is None else abs(value - safe_number) <= tolerance

    safe: Message = Count(value=round(safe_number)) if what is _COUNT else what.make(safe_number)
    words, ranges = f"the value {safe_number:g}", what.ranges(least, most)
    return readings, [CommandPort(command, what.message, safe, orders, orders(safe), one.topic, is_safe, words, ranges)]


_COUNT = Quantity(Count, "value")


def _text(one: HomieProperty, names: PortNames) -> tuple[list[StatePort], list[CommandPort]]:
    """Words: nothing is known about what they do, so there is no safe value."""
    command, reading = _names(one, names)
    choices = one.format.split(",") if one.datatype == "enum" else []

    def read(payload: str) -> Message | None:
        return text_message(payload)

    def orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Text)
        if choices and message.text not in choices:
            return ()
        return [Order(f"{one.topic}/set", message.text)]

    readings = [StatePort(reading, Text, one.topic, read)]
    return readings, [CommandPort(command, Text, None, orders, ())] if one.is_settable else []


def _colour(one: HomieProperty, names: PortNames) -> tuple[list[StatePort], list[CommandPort]]:
    """`r,g,b` in Homie 4, `rgb,r,g,b` in Homie 5."""
    command, reading = _names(one, names)
    prefix = "rgb," if one.topic.split("/")[1:2] == ["5"] else ""

    def read(payload: str) -> Message | None:
        words = payload.removeprefix("rgb,").split(",")
        if len(words) != 3 or not all(word.strip().isdecimal() and int(word) <= 255 for word in words):
            return None
        red, green, blue = map(int, words)
        return Colour(red=red, green=green, blue=blue)

    def orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Colour)
        return [Order(f"{one.topic}/set", f"{prefix}{message.red},{message.green},{message.blue}")]

    black = Colour(red=0, green=0, blue=0)

    def is_black(payload: str) -> bool | None:
        told = read(payload)
        return None if told is None else told == black

    readings = [StatePort(reading, Colour, one.topic, read)]
    if not one.is_settable:
        return readings, []
    return readings, [
        CommandPort(command, Colour, black, orders, orders(black), one.topic, is_black, "that it is black")
    ]
