"""Entities of Home Assistant's discovery that configure their device (`entity_category` `config`), as its settings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from msbot_bridges.bridge import DeviceSetting, Value
from msbot_bridges.mqtt.device_model import Order, PortNames, SettingTopic
from msbot_bridges.mqtt.ha_entity import (
    Config,
    config_number,
    config_template,
    config_words,
    needed_topic,
    read_number,
    shown_number,
)
from msbot_xrce.errors import ConfigError

LONGEST_TEXT = 200
MOST_CHOICES = 50


def is_setting(config: Config) -> bool:
    """Whether an entity configures its device."""
    return config.get("entity_category") == "config"


def setting_of(component: str, config: Config, name: str, names: PortNames) -> SettingTopic:
    """The setting that an entity is.

    Args:
        component: `number`, `select`, ...
        config: its discovery message, spelt out.
        name: what people call it.
        names: gives free names.

    Raises:
        ConfigError: it is none, or cannot be understood; the text says why.
    """
    maker = _COMPONENTS.get(component)
    if maker is None:
        raise ConfigError(f"a {component} that configures the device is no setting here")
    if not config.get("state_topic"):
        raise ConfigError("it configures the device, and has no state_topic: nobody sees what it is set to")
    return maker(config, name, names)


def _number(config: Config, name: str, names: PortNames) -> SettingTopic:
    least, most = config_number(config, "min", 1), config_number(config, "max", 100)
    if most < least:
        raise ConfigError("its range is empty")
    is_whole = all(one.is_integer() for one in (least, most, config_number(config, "step", 1)))
    reads, writes = config_template(config, "value_template"), config_template(config, "command_template")
    topic = needed_topic(config, "command_topic")

    def read(payload: str) -> Value | None:
        value = read_number(reads, payload)
        return None if value is None else round(value) if is_whole else value

    def orders(value: Value) -> list[Order]:
        number = max(least, min(most, float(value)))
        return [] if math.isnan(number) else [Order(topic, writes.render(shown_number(round(number, 9))) or "")]

    unit = config_words(config, "unit_of_measurement", "")
    setting = DeviceSetting(names.name(name), int if is_whole else float, 0, least, most, unit)
    return SettingTopic(setting, orders, needed_topic(config, "state_topic"), read)


def _switch(config: Config, name: str, names: PortNames) -> SettingTopic:
    on, off = config_words(config, "payload_on", "ON"), config_words(config, "payload_off", "OFF")
    told = {config_words(config, "state_on", on): True, config_words(config, "state_off", off): False}
    reads, writes = config_template(config, "value_template"), config_template(config, "command_template")
    topic = needed_topic(config, "command_topic")

    def read(payload: str) -> Value | None:
        return told.get(reads.render(payload) or "")

    def orders(value: Value) -> list[Order]:
        return [Order(topic, writes.render(on if value else off) or "")]

    setting = DeviceSetting(names.name(name), bool, False)
    return SettingTopic(setting, orders, needed_topic(config, "state_topic"), read)


def _text(config: Config, name: str, names: PortNames, choices: tuple[str, ...] = ()) -> SettingTopic:
    reads, writes = config_template(config, "value_template"), config_template(config, "command_template")
    topic = needed_topic(config, "command_topic")

    def read(payload: str) -> Value | None:
        text = reads.render(payload)
        return None if text is None or (choices and text not in choices) else text[:LONGEST_TEXT]

    def orders(value: Value) -> list[Order]:
        return [Order(topic, writes.render(str(value)) or "")]

    setting = DeviceSetting(names.name(name), str, "", choices=choices)
    return SettingTopic(setting, orders, needed_topic(config, "state_topic"), read)


def _select(config: Config, name: str, names: PortNames) -> SettingTopic:
    options = config.get("options")
    if not isinstance(options, list) or not options or not all(isinstance(one, str) for one in options):
        raise ConfigError("a select without options")
    return _text(config, name, names, tuple(options[:MOST_CHOICES]))


_COMPONENTS: Mapping[str, Callable[[Config, str, PortNames], SettingTopic]] = {
    "number": _number,
    "select": _select,
    "switch": _switch,
    "text": _text,
}
