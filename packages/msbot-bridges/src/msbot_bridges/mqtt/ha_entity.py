"""The ports of one entity of Home Assistant's discovery: light, switch, fan, cover, number, button and sensors.

What a component means by default (`ON`, 255, `online`) is from Home Assistant's documentation of its MQTT components.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from msbot.part import Message
from msbot.part.messages.standard import Colour, Level, Number, Switch, Text, Trigger
from msbot_bridges.bridge.quantity import LEVEL, Quantity, nearest_to_zero, quantity, text_message
from msbot_bridges.mqtt.device_model import CommandPort, Order, PortNames, StatePort
from msbot_bridges.mqtt.json_payload import json_object
from msbot_bridges.mqtt.template import Template
from msbot_bridges.mqtt.topics import checked_topic
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

Config = Mapping[str, Any]
_PERCENT: Mapping[str, tuple[float, float]] = {"percent": (0.0, 100.0)}
GREATEST_NUMBER = 1e15
_NEAR = 0.005
"""A share of the range: a report so near the safe value is the safe value."""


@dataclass(slots=True)
class EntityPorts:
    """What one entity gives to its part."""

    readings: list[StatePort]
    commands: list[CommandPort]


def ports_of(component: str, config: Config, name: str, names: PortNames) -> EntityPorts:
    """The ports of an entity.

    Args:
        component: `light`, `sensor`, ...
        config: its discovery message, spelt out.
        name: what people call it.
        names: gives free names to ports.

    Raises:
        ConfigError: it has no port, or cannot be understood; the text says why.
    """
    maker = _COMPONENTS.get(component)
    if maker is None:
        raise ConfigError(f"a {component} has no port here")
    return maker(config, names.name(name, otherwise=component), names)


COMPONENTS: Mapping[str, tuple[tuple[type[Message], ...], tuple[type[Message], ...]]] = {
    "light": ((Switch, Level), (Switch, Level, Colour)),
    "switch": ((Switch,), (Switch,)),
    "fan": ((Switch, Level), (Switch, Level)),
    "cover": ((Switch, Level), (Switch, Level)),
    "number": ((Number,), (Number,)),
    "button": ((), (Trigger,)),
    "sensor": ((Number, Text), ()),
    "binary_sensor": ((Switch,), ()),
}
"""By component: messages that it may send, and messages that drive it; a number with a unit is what the unit says."""


# What configurations have


def _topic(config: Config, key: str) -> str:
    topic = config.get(key)
    return checked_topic(topic, key) if topic else ""


def needed_topic(config: Config, key: str) -> str:
    """A topic that must be there."""
    topic = _topic(config, key)
    if not topic:
        raise ConfigError(f"it has no {key}")
    return topic


def config_words(config: Config, key: str, otherwise: str) -> str:
    """A text, or what counts without it."""
    value = config.get(key, otherwise)
    return otherwise if value is None else str(value)


def config_number(config: Config, key: str, otherwise: float) -> float:
    """A number, or what counts without it."""
    value = config.get(key, otherwise)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(f"{key} is no number")
    if abs(value) > GREATEST_NUMBER:
        raise ConfigError(f"{key} is {value:g}; a device's numbers are at most {GREATEST_NUMBER:g}")
    return float(value)


def config_template(config: Config, *keys: str) -> Template:
    """The first of these templates that is there; none: the payload as it is."""
    for key in keys:
        text = config.get(key)
        if isinstance(text, str):
            return Template(text)
    return Template("")


def shown_number(value: float) -> str:
    """A number as devices write it: whole where it is whole."""
    return str(int(value)) if float(value).is_integer() else f"{value:.6g}"


def read_number(template: Template, payload: str) -> float | None:
    """A payload as a number; None: it is none."""
    text = template.render(payload)
    try:
        value = float(text) if text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _switching(
    config: Config, port: str, names: PortNames, *, state_keys: tuple[str, ...] = ("value_template",)
) -> EntityPorts:
    """On and off: a switch, a lamp without brightness, a fan without speeds."""
    command_topic, state_topic = needed_topic(config, "command_topic"), _topic(config, "state_topic")
    on, off = config_words(config, "payload_on", "ON"), config_words(config, "payload_off", "OFF")
    template, writes = config_template(config, *state_keys), config_template(config, "command_template")
    state_on, state_off = config_words(config, "state_on", on), config_words(config, "state_off", off)

    def is_on(payload: str) -> bool | None:
        text = template.render(payload)
        return True if text == state_on else False if text == state_off else None

    def orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Switch)
        return [Order(command_topic, writes.render(on if message.on else off) or "")]

    def read(payload: str) -> Message | None:
        state = is_on(payload)
        return None if state is None else Switch(on=state)

    readings = [StatePort(names.name(f"{port}_state"), Switch, state_topic, read)] if state_topic else []
    safe = Switch(on=False)
    command = CommandPort(
        port, Switch, safe, orders, orders(safe), state_topic, lambda payload: _not(is_on(payload)), "that it is off"
    )
    return EntityPorts(readings, [command])


def _not(value: bool | None) -> bool | None:
    return None if value is None else not value


def _switch(config: Config, port: str, names: PortNames) -> EntityPorts:
    return _switching(config, port, names)


def _light(config: Config, port: str, names: PortNames) -> EntityPorts:
    schema = config.get("schema", "basic")
    if schema == "json":
        return _json_light(config, port, names)
    if schema not in ("basic", "default"):
        raise ConfigError(f"a light with schema {schema!r}")
    if not _topic(config, "brightness_command_topic"):
        ports = _switching(config, port, names, state_keys=("state_value_template", "value_template"))
    else:
        ports = _dimmed_light(config, port, names)
    if topic := _topic(config, "rgb_command_topic"):
        ports.commands.append(_colour(config, names.name(f"{port}_colour"), topic))
    return ports


def _colour(config: Config, port: str, topic: str) -> CommandPort:
    if config.get("rgb_command_template"):
        raise ConfigError("a light with a template for colours")

    def orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Colour)
        return [Order(topic, f"{message.red},{message.green},{message.blue}")]

    return CommandPort(port, Colour, None, orders, ())  # STOP switches the light off; its colour stays


def _dimmed_light(config: Config, port: str, names: PortNames) -> EntityPorts:
    command_topic, dim_topic = needed_topic(config, "command_topic"), needed_topic(config, "brightness_command_topic")
    state_topic, dim_state = _topic(config, "state_topic"), _topic(config, "brightness_state_topic")
    on, off = config_words(config, "payload_on", "ON"), config_words(config, "payload_off", "OFF")
    scale = max(1.0, config_number(config, "brightness_scale", 255))
    writes, reads = (
        config_template(config, "brightness_command_template"),
        config_template(config, "brightness_value_template"),
    )
    template = config_template(config, "state_value_template", "value_template")
    is_last = config.get("on_command_type", "last") == "last"

    def orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Level)
        percent = max(0.0, min(100.0, message.percent))
        if percent == 0.0:
            return [Order(command_topic, off)]
        dim = Order(dim_topic, writes.render(shown_number(round(percent * scale / 100))) or "")
        both = [dim, Order(command_topic, on)] if is_last else [Order(command_topic, on), dim]
        return [dim] if config.get("on_command_type") == "brightness" else both

    def is_off(payload: str) -> bool | None:
        text = template.render(payload)
        return True if text == off else False if text == on else None

    def read(payload: str) -> Message | None:
        value = read_number(reads, payload)
        return None if value is None else LEVEL.made(100 * value / scale)

    def read_off(payload: str) -> Message | None:
        return Level(percent=0) if is_off(payload) else None

    readings = []
    if dim_state or state_topic:
        name = names.name(f"{port}_state")
        readings += [StatePort(name, Level, dim_state, read)] if dim_state else []
        readings += [StatePort(name, Level, state_topic, read_off)] if state_topic else []
    safe = Level(percent=0)
    command = CommandPort(port, Level, safe, orders, orders(safe), state_topic, is_off, "that it is off", _PERCENT)
    return EntityPorts(readings, [command])


def _json_light(config: Config, port: str, names: PortNames) -> EntityPorts:
    """Schema `json`: commands and states are objects with `state`, `brightness`, `color`."""
    command_topic, state_topic = needed_topic(config, "command_topic"), _topic(config, "state_topic")
    scale = max(1.0, config_number(config, "brightness_scale", 255))
    modes = config.get("supported_color_modes")
    modes = set(filter(lambda one: isinstance(one, str), modes)) if isinstance(modes, list) else set()
    is_dimmed = bool(config.get("brightness")) or bool(modes - {"onoff"})
    message_type: type[Message] = Level if is_dimmed else Switch

    def state(payload: str) -> tuple[bool | None, float | None]:
        told = json_object(payload)
        is_on = {"ON": True, "OFF": False}.get(str(told.get("state")))
        brightness = told.get("brightness")
        if isinstance(brightness, bool) or not isinstance(brightness, int | float) or not math.isfinite(brightness):
            return is_on, None
        return is_on, float(brightness)

    def orders(message: Message) -> Sequence[Order]:
        percent = message.percent if isinstance(message, Level) else 100.0 * bool(getattr(message, "on", False))
        percent = max(0.0, min(100.0, percent))
        told: dict[str, object] = {"state": "ON" if percent else "OFF"}
        if percent and is_dimmed:
            told["brightness"] = max(1, round(percent * scale / 100))
        return [Order(command_topic, json.dumps(told))]

    def read(payload: str) -> Message | None:
        is_on, brightness = state(payload)
        if is_on is None:
            return None
        if not is_dimmed:
            return Switch(on=is_on)
        return LEVEL.made(0.0 if not is_on else 100.0 if brightness is None else 100 * brightness / scale)

    def colours(message: Message) -> Sequence[Order]:
        assert isinstance(message, Colour)
        colour = {"r": message.red, "g": message.green, "b": message.blue}
        return [Order(command_topic, json.dumps({"state": "ON", "color": colour}))]

    safe: Message = Level(percent=0) if is_dimmed else Switch(on=False)
    readings = [StatePort(names.name(f"{port}_state"), message_type, state_topic, read)] if state_topic else []
    commands = [
        CommandPort(
            port,
            message_type,
            safe,
            orders,
            orders(safe),
            state_topic,
            lambda payload: _not(state(payload)[0]),
            "that it is off",
            _PERCENT if is_dimmed else {},
        )
    ]
    if modes & {"rgb", "rgbw", "rgbww"}:
        commands.append(CommandPort(names.name(f"{port}_colour"), Colour, None, colours, ()))
    return EntityPorts(readings, commands)


def _fan(config: Config, port: str, names: PortNames) -> EntityPorts:
    topic = _topic(config, "percentage_command_topic")
    if not topic:
        return _switching(config, port, names, state_keys=("state_value_template", "value_template"))
    command_topic, state_topic = needed_topic(config, "command_topic"), _topic(config, "state_topic")
    on, off = config_words(config, "payload_on", "ON"), config_words(config, "payload_off", "OFF")
    least, most = config_number(config, "speed_range_min", 1), config_number(config, "speed_range_max", 100)
    if most < least or least < 1:
        raise ConfigError("its range of speeds is empty")
    speeds = most - least + 1
    writes, reads = (
        config_template(config, "percentage_command_template"),
        config_template(config, "percentage_value_template"),
    )
    template = config_template(config, "state_value_template", "value_template")

    def orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Level)
        percent = max(0.0, min(100.0, message.percent))
        if percent == 0.0:
            return [Order(command_topic, off)]
        speed = least - 1 + max(1, math.ceil(speeds * percent / 100))
        return [Order(command_topic, on), Order(topic, writes.render(shown_number(speed)) or "")]

    def read(payload: str) -> Message | None:
        value = read_number(reads, payload)
        return None if value is None else LEVEL.made(100 * (value - least + 1) / speeds)

    def is_off(payload: str) -> bool | None:
        text = template.render(payload)
        return True if text == off else False if text == on else None

    speed_state = _topic(config, "percentage_state_topic")
    readings = []
    if speed_state or state_topic:
        name = names.name(f"{port}_state")
        readings += [StatePort(name, Level, speed_state, read)] if speed_state else []
        if state_topic:
            readings.append(
                StatePort(name, Level, state_topic, lambda text: Level(percent=0) if is_off(text) else None)
            )
    safe = Level(percent=0)
    command = CommandPort(port, Level, safe, orders, orders(safe), state_topic, is_off, "that it is off", _PERCENT)
    return EntityPorts(readings, [command])


def _cover(config: Config, port: str, names: PortNames) -> EntityPorts:
    """A cover: STOP has it stand still where it is."""
    command_topic, state_topic = _topic(config, "command_topic"), _topic(config, "state_topic")
    position_topic, set_topic = _topic(config, "position_topic"), _topic(config, "set_position_topic")
    closed, opened = config_number(config, "position_closed", 0), config_number(config, "position_open", 100)
    if closed == opened or not (command_topic or set_topic):
        raise ConfigError("a cover that cannot be moved")
    stop = config.get("payload_stop", "STOP")
    template, reads = config_template(config, "value_template"), config_template(config, "position_template")
    writes = config_template(config, "set_position_template")
    moving = {config_words(config, "state_opening", "opening"), config_words(config, "state_closing", "closing")}
    still = {
        config_words(config, "state_open", "open"),
        config_words(config, "state_closed", "closed"),
        config_words(config, "state_stopped", "stopped"),
    }

    def position_orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Level)
        percent = max(0.0, min(100.0, message.percent))
        position = shown_number(round(closed + (opened - closed) * percent / 100))
        return [Order(set_topic, writes.render(position, position=position) or "")]

    def open_orders(message: Message) -> Sequence[Order]:
        assert isinstance(message, Switch)
        word = (
            config_words(config, "payload_open", "OPEN")
            if message.on
            else config_words(config, "payload_close", "CLOSE")
        )
        return [Order(command_topic, word)]

    def is_still(payload: str) -> bool | None:
        text = template.render(payload)
        return True if text in still else False if text in moving else None

    def read_position(payload: str) -> Message | None:
        value = read_number(reads, payload)
        return None if value is None else LEVEL.made(100 * (value - closed) / (opened - closed))

    def read_open(payload: str) -> Message | None:
        text = template.render(payload)
        is_open, is_closed = config_words(config, "state_open", "open"), config_words(config, "state_closed", "closed")
        return Switch(on=True) if text == is_open else Switch(on=False) if text == is_closed else None

    stops = [Order(command_topic, str(stop))] if command_topic and stop is not None else []
    message_type: type[Message] = Level if set_topic else Switch
    orders = position_orders if set_topic else open_orders
    words = "that it stands still" if stops else "that it stands still, and it cannot be told to"
    ranges = _PERCENT if set_topic else {}
    command = CommandPort(port, message_type, None, orders, stops, state_topic, is_still, words, ranges)
    readings = []
    if position_topic:
        readings.append(StatePort(names.name(f"{port}_state"), Level, position_topic, read_position))
    elif state_topic:
        readings.append(StatePort(names.name(f"{port}_state"), Switch, state_topic, read_open))
    return EntityPorts(readings, [command])


def _number_entity(config: Config, port: str, names: PortNames) -> EntityPorts:
    command_topic, state_topic = needed_topic(config, "command_topic"), _topic(config, "state_topic")
    least, most = config_number(config, "min", 1), config_number(config, "max", 100)
    if most < least:
        raise ConfigError("its range is empty")
    what = quantity(config_words(config, "unit_of_measurement", ""), config_words(config, "device_class", ""))
    template, writes = config_template(config, "value_template"), config_template(config, "command_template")

    def orders(message: Message) -> Sequence[Order]:
        return _number_orders(command_topic, writes, what, message, least=least, most=most)

    safe_number = nearest_to_zero(least, most)
    tolerance = max(config_number(config, "step", 1.0) / 2, (most - least) * _NEAR)

    def is_safe(payload: str) -> bool | None:
        value = read_number(template, payload)
        return None if value is None else abs(value - safe_number) <= tolerance

    safe = what.make(safe_number)
    readings = [_number_reading(names.name(f"{port}_state"), what, state_topic, template)] if state_topic else []
    words, ranges = f"the value {shown_number(safe_number)}", what.ranges(least, most)
    command = CommandPort(port, what.message, safe, orders, orders(safe), state_topic, is_safe, words, ranges)
    return EntityPorts(readings, [command])


def _number_orders(
    topic: str, writes: Template, what: Quantity, message: Message, *, least: float, most: float
) -> Sequence[Order]:
    number = what.number(message)
    if not math.isfinite(number):
        return ()
    return [Order(topic, writes.render(shown_number(round(max(least, min(most, number)), 9))) or "")]


def _number_reading(port: str, what: Quantity, topic: str, template: Template) -> StatePort:
    def read(payload: str) -> Message | None:
        value = read_number(template, payload)
        return None if value is None else what.made(value)

    return StatePort(port, what.message, topic, read)


def _button(config: Config, port: str, names: PortNames) -> EntityPorts:  # noqa: ARG001 - as all others
    topic, press = needed_topic(config, "command_topic"), config_words(config, "payload_press", "PRESS")
    return EntityPorts([], [CommandPort(port, Trigger, None, lambda _: [Order(topic, press)], ())])


def _sensor(config: Config, port: str, names: PortNames) -> EntityPorts:  # noqa: ARG001
    topic, template = needed_topic(config, "state_topic"), config_template(config, "value_template")
    unit, kind = config_words(config, "unit_of_measurement", ""), config_words(config, "device_class", "")
    if unit or config.get("state_class") or kind == "battery":
        return EntityPorts([_number_reading(port, quantity(unit, kind), topic, template)], [])

    def read(payload: str) -> Message | None:
        text = template.render(payload)
        return None if text is None else text_message(text)

    return EntityPorts([StatePort(port, Text, topic, read)], [])


def _binary_sensor(config: Config, port: str, names: PortNames) -> EntityPorts:  # noqa: ARG001
    topic, template = needed_topic(config, "state_topic"), config_template(config, "value_template")
    on, off = config_words(config, "payload_on", "ON"), config_words(config, "payload_off", "OFF")

    def read(payload: str) -> Message | None:
        text = template.render(payload)
        return Switch(on=True) if text == on else Switch(on=False) if text == off else None

    return EntityPorts([StatePort(port, Switch, topic, read)], [])


_COMPONENTS: Mapping[str, Callable[[Config, str, PortNames], EntityPorts]] = {
    "light": _light,
    "switch": _switch,
    "fan": _fan,
    "cover": _cover,
    "number": _number_entity,
    "button": _button,
    "sensor": _sensor,
    "binary_sensor": _binary_sensor,
}
