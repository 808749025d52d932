"""Home Assistant's discovery: what becomes of each component, in the shapes in which devices publish it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from msbot import Message
from msbot.part.messages.standard import (
    Battery,
    Distance,
    Level,
    Number,
    Pressure,
    Speed,
    Switch,
    Temperature,
    Text,
    Trigger,
    Weight,
)
from msbot_bridges.bridge import DeviceSetting, Value
from msbot_bridges.mqtt.device_model import CommandPort, DeviceModel, SettingTopic
from msbot_bridges.mqtt.ha_discovery import HaDiscovery

DEVICE = {"ids": ["x1"], "mf": "ACME", "mdl": "box", "sw": "2", "name": "Box"}


def models(*messages: tuple[str, dict[str, Any] | str]) -> list[DeviceModel | None]:
    discovery = HaDiscovery()
    for topic, told in messages:
        payload = told if isinstance(told, str) else json.dumps(told)
        assert discovery.hear(topic, payload.encode(), 0.0)
    return [model for _, model in discovery.due(5.0)]


def one(component: str, **config: Any) -> DeviceModel:
    (model,) = models((f"homeassistant/{component}/x1/thing/config", {"name": "thing", "dev": DEVICE, **config}))
    assert model is not None
    return model


def orders(command: CommandPort, message: Message) -> list[tuple[str, str]]:
    return [(order.topic, order.payload) for order in command.orders(message)]


def test_a_device_of_several_messages_is_one_part_with_the_makers_number() -> None:
    (model,) = models(
        ("homeassistant/switch/x1/relay/config", {"name": "relay", "~": "box/1", "cmd_t": "~/set", "dev": DEVICE}),
        ("homeassistant/sensor/x1-temp/config", {"stat_t": "box/t", "unit_of_meas": "°F", "dev": DEVICE}),
    )
    assert model is not None
    assert model.identity.part_number == "ACME:box"
    assert model.identity.description == "box of ACME (software 2)"
    assert [command.port for command in model.commands] == ["relay"]
    assert model.commands[0].stop[0].topic == "box/1/set"
    assert model.readings[0].port == "x1_temp"
    assert model.readings[0].read("50") == Temperature(celsius=10)


def test_what_esphome_publishes_is_a_part() -> None:
    """ESPHome's documentation names these keys: abbreviated, `~`-free, a status topic, its version and board."""
    device = {"ids": "a0b1c2d3e4f5", "name": "bench", "sw": "esphome v2026.10.1", "mdl": "esp32dev", "mf": "espressif"}
    shared = {"avty_t": "bench/status", "dev": device}
    (model,) = models(
        (
            "homeassistant/light/bench/strip/config",
            {
                "schema": "json",
                "name": "Strip",
                "stat_t": "bench/light/strip/state",
                "cmd_t": "bench/light/strip/command",
                "brightness": True,
                "sup_clrm": ["rgb"],
                "uniq_id": "ESPlightstrip",
                **shared,
            },
        ),
        (
            "homeassistant/sensor/bench/range/config",
            {
                "name": "Range",
                "dev_cla": "distance",
                "unit_of_meas": "m",
                "stat_cla": "measurement",
                "stat_t": "bench/sensor/range/state",
                "uniq_id": "ESPsensorrange",
                **shared,
            },
        ),
        (
            "homeassistant/binary_sensor/bench/door/config",
            {"name": "Door", "stat_t": "bench/binary_sensor/door/state", "uniq_id": "ESPbinarydoor", **shared},
        ),
        (
            "homeassistant/button/bench/restart/config",
            {"name": "Restart", "cmd_t": "bench/button/restart/command", "ent_cat": "config", **shared},
        ),
    )
    assert model is not None
    assert model.identity.part_number == "espressif:esp32dev"
    assert [(one.port, one.message) for one in model.readings] == [
        ("door", Switch),
        ("range", Distance),
        ("strip_state", Level),
    ]
    assert [(one.port, one.state_topic) for one in model.commands] == [
        ("strip", "bench/light/strip/state"),
        ("strip_colour", ""),
    ]
    strip = model.commands[0]
    assert orders(strip, Level(percent=50)) == [("bench/light/strip/command", '{"state": "ON", "brightness": 128}')]
    assert strip.is_safe('{"state": "OFF", "color_mode": "rgb", "brightness": 128}') is True
    assert model.readings[2].read('{"state":"ON","brightness":51}') == Level(percent=20)
    assert [life.read(text) for life in model.life for text in ("online", "offline", "?")] == [True, False, None]
    assert model.left_out == ("Restart: a button that configures the device is no setting here",)


def test_a_device_message_declares_all_its_components() -> None:
    told = {
        "dev": DEVICE,
        "o": {"name": "maker"},
        "avty": {"t": "box/life", "pl_avail": "up", "pl_not_avail": "down"},
        "cmps": {
            "fan": {"p": "fan", "cmd_t": "box/on", "stat_t": "box/is", "pct_cmd_t": "box/speed", "spd_rng_max": 4},
            "gone": {"p": "sensor"},
        },
    }
    (model,) = models(("homeassistant/device/x1/config", told))
    assert model is not None
    assert [command.port for command in model.commands] == ["fan"]
    assert orders(model.commands[0], Level(percent=30)) == [("box/on", "ON"), ("box/speed", "2")]
    assert orders(model.commands[0], Level(percent=0)) == [("box/on", "OFF")]
    assert model.life[0].read("up") is True


def test_what_is_taken_back_is_gone() -> None:
    topic = "homeassistant/switch/x1/thing/config"
    assert models((topic, {"cmd_t": "a", "dev": DEVICE}), (topic, "")) == [None]


@pytest.mark.parametrize(
    ("config", "payload", "message"),
    [
        ({"unit_of_measurement": "rpm"}, "60", Speed(rpm=60)),
        ({"unit_of_measurement": "cm"}, "42", Distance(metres=0.42, in_range=True)),
        ({"unit_of_measurement": "kPa"}, "100", Pressure(hectopascal=1000)),
        ({"unit_of_measurement": "kg", "value_template": "{{ value_json.w }}"}, '{"w": 2}', Weight(grams=2000)),
        ({"unit_of_measurement": "%"}, "55", Level(percent=55)),
        ({"unit_of_measurement": "W"}, "12.5", Number(value=12.5)),
        ({"state_class": "measurement"}, "3", Number(value=3)),
        ({}, "idle", Text(text="idle")),
        ({"unit_of_measurement": "rpm"}, "unknown", None),
        ({"unit_of_measurement": "rpm"}, "nan", None),
    ],
)
def test_a_sensor_is_what_its_unit_says(config: dict[str, Any], payload: str, message: Message | None) -> None:
    (reading,) = one("sensor", state_topic="s", **config).readings
    assert reading.read(payload) == message


def test_a_sensor_of_a_battery_is_a_battery() -> None:
    (reading,) = one("sensor", state_topic="s", device_class="battery", unit_of_measurement="%").readings
    read = reading.read("80")
    assert isinstance(read, Battery)
    assert read.percent == 80.0


def test_a_dimmed_light_takes_brightness_and_is_off_at_zero() -> None:
    model = one("light", cmd_t="c", stat_t="s", bri_cmd_t="b", bri_stat_t="bs", bri_scl=100)
    (command,) = model.commands
    assert orders(command, Level(percent=40)) == [("b", "40"), ("c", "ON")]
    assert orders(command, Level(percent=0)) == [("c", "OFF")]
    assert [(one.topic, one.port) for one in model.readings] == [("bs", "thing_state"), ("s", "thing_state")]


def test_a_number_keeps_to_its_range_and_its_safe_value_is_next_to_zero() -> None:
    (command,) = one("number", cmd_t="c", stat_t="s", min=5, max=30, unit_of_measurement="°C").commands
    assert command.safe == Temperature(celsius=5)
    assert orders(command, Temperature(celsius=99)) == [("c", "30")]
    assert orders(command, Temperature(celsius=float("nan"))) == []
    assert [command.is_safe(text) for text in ("5", "20", "?")] == [True, False, None]


def test_a_cover_stops_where_it_is() -> None:
    model = one("cover", cmd_t="c", stat_t="s", set_pos_t="p", pos_t="ps", pos_open=0, pos_clsd=100)
    (command,) = model.commands
    assert orders(command, Level(percent=100)) == [("p", "0")]
    assert [(order.topic, order.payload) for order in command.stop] == [("c", "STOP")]
    assert [command.is_safe(text) for text in ("opening", "stopped", "open", "?")] == [False, True, True, None]
    assert model.readings[0].read("25") == Level(percent=75)


def test_a_button_has_no_state_and_nothing_to_stop() -> None:
    (command,) = one("button", cmd_t="c").commands
    assert orders(command, Trigger(index=3)) == [("c", "PRESS")]
    assert not command.safe_words


@pytest.mark.parametrize(
    ("component", "config", "words"),
    [
        ("camera", {"t": "x"}, "a camera has no port here"),
        ("light", {"cmd_t": "c", "schema": "template"}, "a light with schema 'template'"),
        ("switch", {"stat_t": "s"}, "it has no command_topic"),
        ("switch", {"cmd_t": "a/#"}, "command_topic stands for more than one topic"),
        ("number", {"cmd_t": "c", "min": 9, "max": 1}, "its range is empty"),
        ("number", {"cmd_t": "c", "min": "low"}, "min is no number"),
        ("sensor", {"stat_t": "s", "val_tpl": "{{ states('x') }}"}, "is not understood"),
    ],
)
def test_what_becomes_no_port_is_named_with_the_reason(component: str, config: dict[str, Any], words: str) -> None:
    model = one(component, **config)
    assert not model.commands
    assert words in model.left_out[0]


@pytest.mark.parametrize("payload", ["no json", "[]", "{", "[" * 5000])
def test_what_is_no_declaration_is_counted(payload: str) -> None:
    discovery = HaDiscovery()
    assert discovery.hear("homeassistant/light/x/config", payload.encode(), 0.0)
    assert discovery.dropped == 1
    assert list(discovery.due(9.0)) == []


def test_a_device_of_a_thousand_entities_becomes_a_part_of_a_few_ports() -> None:
    (model,) = models(
        *(
            (f"homeassistant/sensor/x1/s{number}/config", {"stat_t": f"s/{number}", "dev": DEVICE})
            for number in range(1000)
        )
    )
    assert model is not None
    assert len(model.readings) == 24
    assert len(model.left_out) == 976


def setting(component: str, **config: Any) -> SettingTopic:
    (found,) = one(component, ent_cat="config", cmd_t="c", stat_t="s", **config).settings
    return found


@pytest.mark.parametrize(
    ("component", "config", "declared", "payload", "value", "order"),
    [
        (
            "number",
            {"min": 0, "max": 5, "step": 0.5, "unit_of_meas": "s"},
            DeviceSetting("thing", float, 0, 0, 5, "s"),
            "2.5",
            2.5,
            "2.5",
        ),
        ("number", {"min": 1, "max": 9}, DeviceSetting("thing", int, 0, 1, 9), "4.0", 4, "4"),
        ("switch", {}, DeviceSetting("thing", bool, default=False), "ON", True, "ON"),
        ("switch", {"pl_off": "0", "pl_on": "1"}, DeviceSetting("thing", bool, default=False), "0", False, "0"),
        ("select", {"options": ["a", "b"]}, DeviceSetting("thing", str, "", choices=("a", "b")), "b", "b", "b"),
        ("text", {"cmd_tpl": '{"t": "{{ value }}"}'}, DeviceSetting("thing", str, ""), "hi", "hi", '{"t": "hi"}'),
    ],
)
def test_what_configures_a_device_is_a_setting(
    component: str, config: dict[str, Any], declared: DeviceSetting, payload: str, value: Value, order: str
) -> None:
    found = setting(component, **config)
    assert found.setting == declared
    assert found.topic == "s"
    assert found.read(payload) == value
    assert [(one.topic, one.payload) for one in found.orders(value)] == [("c", order)]


def test_a_value_that_a_setting_does_not_have_is_none() -> None:
    assert setting("select", options=["a", "b"]).read("c") is None
    assert setting("switch").read("maybe") is None
    assert setting("number").read("nan") is None


@pytest.mark.parametrize(
    ("component", "config", "words"),
    [
        ("number", {"cmd_t": "c"}, "has no state_topic: nobody sees what it is set to"),
        ("light", {"cmd_t": "c", "stat_t": "s"}, "a light that configures the device is no setting here"),
        ("select", {"cmd_t": "c", "stat_t": "s"}, "a select without options"),
        ("number", {"cmd_t": "c", "stat_t": "s", "min": 9, "max": 1}, "its range is empty"),
    ],
)
def test_what_becomes_no_setting_is_named_with_the_reason(component: str, config: dict[str, Any], words: str) -> None:
    model = one(component, ent_cat="config", **config)
    assert not model.settings
    assert words in model.left_out[0]


def test_another_safe_value_is_confirmed_by_the_state_only() -> None:
    model = one("light", cmd_t="c", stat_t="s", schema="json", brightness=True)
    command = model.commands[0].stopping_at(Level(percent=20), model.readings)
    assert [order.payload for order in command.stop] == ['{"state": "ON", "brightness": 51}']
    told = ('{"state": "ON", "brightness": 51}', '{"state": "OFF"}', '{"state": "ON", "brightness": 60}', "?")
    assert [command.is_safe(text) for text in told] == [True, False, False, None]
    blind = one("light", cmd_t="c", schema="json", brightness=True)
    assert not blind.commands[0].stopping_at(Level(percent=20), ()).state_topic
