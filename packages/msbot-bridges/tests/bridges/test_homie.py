"""Homie 4 and 5: documents and topics as the conventions have them."""

from __future__ import annotations

import json
from typing import Any

import pytest

from msbot import Message
from msbot.part.messages.standard import Angle, Colour, Count, Distance, Level, Number, Switch, Text, Trigger
from msbot_bridges.bridge import DeviceSetting, Value
from msbot_bridges.mqtt.device_model import DeviceModel, PortNames
from msbot_bridges.mqtt.homie4 import Homie4
from msbot_bridges.mqtt.homie5 import Homie5
from msbot_bridges.mqtt.homie_property import HomieProperty, homie_ports


def described(**more: Any) -> DeviceModel:
    homie = Homie5()
    told = {
        "homie": "5.0",
        "version": 1,
        "name": "Arm",
        "type": "acme-arm",
        "nodes": {
            "joint": {
                "properties": {
                    "angle": {"datatype": "float", "format": "-90:90", "unit": "°", "settable": True},
                    "gripper": {"datatype": "boolean", "settable": True},
                    "plan": {"datatype": "json"},
                }
            }
        },
        **more,
    }
    assert homie.hear("homie/5/arm1/$description", json.dumps(told).encode(), 0.0)
    ((_, model),) = homie.due(1.0)
    assert model is not None
    return model


def test_a_document_of_homie_5_describes_a_part() -> None:
    model = described()
    assert model.identity.part_number == "homie:acme-arm"
    assert [(one.port, one.safe) for one in model.commands] == [
        ("angle", Angle(degrees=0)),
        ("gripper", Switch(on=False)),
    ]
    assert model.commands[0].orders(Angle(degrees=120))[0].payload == "90"
    assert model.commands[0].orders(Angle(degrees=12.5))[0].topic == "homie/5/arm1/joint/angle/set"
    assert [model.commands[1].is_safe(text) for text in ("false", "true", "?")] == [True, False, None]
    assert model.left_out == ("plan: json has no port here",)


def test_a_child_of_homie_5_lives_as_long_as_its_root() -> None:
    own, root = described(root="hub").life
    assert (own.topic, root.topic) == ("homie/5/arm1/$state", "homie/5/hub/$state")
    assert [own.read(text) for text in ("ready", "init", "lost")] == [True, False, False]
    assert [root.read(text) for text in ("sleeping", "lost")] == [True, False]


def test_a_device_of_homie_5_whose_state_is_emptied_is_gone() -> None:
    homie = Homie5()
    homie.hear("homie/5/arm1/$description", b'{"homie": "5.0"}', 0.0)
    list(homie.due(1.0))
    assert not homie.hear("homie/5/arm1/$state", b"ready", 2.0)
    assert homie.hear("homie/5/arm1/$state", b"", 2.0)
    assert list(homie.due(3.0)) == [("arm1", None)]


@pytest.mark.parametrize("told", [b"no json", b'{"homie": "6.0"}', b"[]"])
def test_a_document_of_something_else_is_counted(told: bytes) -> None:
    homie = Homie5()
    assert homie.hear("homie/5/arm1/$description", told, 0.0)
    assert homie.dropped == 1
    assert list(homie.due(9.0)) == []


def test_topics_of_homie_4_describe_a_part() -> None:
    homie = Homie4()
    for topic, text in {
        "$homie": "4.0.0",
        "$name": "Rover",
        "$fw/name": "rover-fw",
        "$fw/version": "1.0",
        "$nodes": "drive",
        "drive/$properties": "speed,lamp",
        "drive/speed/$datatype": "integer",
        "drive/speed/$format": "0:100",
        "drive/speed/$unit": "%",
        "drive/speed/$settable": "true",
        "drive/lamp/$datatype": "color",
        "drive/lamp/$format": "rgb",
        "drive/lamp/$settable": "true",
    }.items():
        assert homie.hear(f"homie/rover/{topic}", text.encode(), 0.0)
    assert not homie.hear("homie/rover/drive/speed", b"40", 0.0)
    assert not homie.hear("homie/5/x/$description", b"{}", 0.0)
    ((_, model),) = homie.due(2.0)
    assert model is not None
    assert model.identity.part_number == "homie:rover-fw"
    assert model.identity.software == "1.0"
    speed, lamp = model.commands
    assert speed.orders(Level(percent=40))[0] == speed.orders(Level(percent=40.2))[0]
    assert lamp.orders(Colour(red=1, green=2, blue=3))[0].payload == "1,2,3"
    assert [life.read(text) for life in model.life for text in ("ready", "alert", "lost")] == [True, True, False]


@pytest.mark.parametrize(
    ("one", "payload", "message"),
    [
        (HomieProperty("t", "n", "float"), "1.5", Number(value=1.5)),
        (HomieProperty("t", "n", "float", unit="m"), "1.5", Distance(metres=1.5, in_range=True)),
        (HomieProperty("t", "n", "float"), "inf", None),
        (HomieProperty("t", "n", "integer", unit="#"), "7", Count(value=7)),
        (HomieProperty("t", "n", "integer"), "99999999999", None),
        (HomieProperty("t", "n", "enum", "a,b"), "a", Text(text="a")),
        (HomieProperty("homie/5/d/n/p", "n", "color", "rgb"), "rgb,1,2,3", Colour(red=1, green=2, blue=3)),
        (HomieProperty("t", "n", "color", "rgb"), "1,2,300", None),
        (HomieProperty("t", "n", "boolean"), "TRUE", None),
    ],
)
def test_a_property_is_what_datatype_and_unit_say(one: HomieProperty, payload: str, message: Message | None) -> None:
    ((reading,), _) = homie_ports(one, PortNames())
    assert reading.read(payload) == message


def test_an_event_is_triggered_and_a_word_must_be_one_of_the_choices() -> None:
    brew = HomieProperty("t", "brew", "boolean", is_settable=True, is_retained=False)
    readings, (command,) = homie_ports(brew, PortNames())
    assert readings == []
    assert command.orders(Trigger(index=1))[0].payload == "true"
    mode = HomieProperty("t", "mode", "enum", "slow,fast", is_settable=True)
    _, (command,) = homie_ports(mode, PortNames())
    assert command.orders(Text(text="fast"))[0].payload == "fast"
    assert command.orders(Text(text="backwards")) == ()


@pytest.mark.parametrize(
    ("told", "declared", "payload", "value", "order"),
    [
        ({"datatype": "boolean"}, DeviceSetting("one", bool, default=False), "true", True, "true"),
        ({"datatype": "integer", "format": "1:9"}, DeviceSetting("one", int, 0, 1, 9), "4", 4, "4"),
        ({"datatype": "float", "unit": "s"}, DeviceSetting("one", float, 0, unit="s"), "0.5", 0.5, "0.5"),
        ({"datatype": "enum", "format": "a,b"}, DeviceSetting("one", str, "", choices=("a", "b")), "b", "b", "b"),
    ],
)
def test_what_a_settings_node_has_is_a_setting(
    told: dict[str, Any], declared: DeviceSetting, payload: str, value: Value, order: str
) -> None:
    model = described(nodes={"settings": {"properties": {"one": {"settable": True, **told}}}})
    (found,) = model.settings
    assert (found.setting, found.topic) == (declared, "homie/5/arm1/settings/one")
    assert found.read(payload) == value
    assert found.read("?") is None
    assert [(one.topic, one.payload) for one in found.orders(value)] == [("homie/5/arm1/settings/one/set", order)]


def test_what_nobody_can_set_is_no_setting() -> None:
    model = described(nodes={"config": {"properties": {"one": {"datatype": "float"}}}})
    assert not model.settings
    assert "one: a setting is settable, retained" in model.left_out[0]
