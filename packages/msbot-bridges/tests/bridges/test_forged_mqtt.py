"""Another client of the broker forges what devices publish: the bridge goes on, and keeps no more than it has room for.

A robot's bridges run in the process of its master: what ends one of them would end the robot.
"""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path
from random import Random

import pytest

from msbot.part import Message
from msbot.part.messages.standard import Level, Text
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.mqtt.device_model import DeviceModel
from msbot_bridges.mqtt.ha_discovery import MOST_OCTETS, HaDiscovery
from msbot_bridges.mqtt.homie4 import Homie4
from msbot_bridges.mqtt.homie5 import Homie5
from msbot_bridges.mqtt.mqtt_device import MqttDevice
from msbot_bridges.mqtt.topics import checked_topic
from msbot_xrce.errors import ConfigError
from tests.bridges.hosting import running
from tests.bridges.mosquitto import mosquitto
from tests.bridges.test_mqtt_settings import plugged

aiomqtt = pytest.importorskip("aiomqtt")

NUL = "a\x00b"
HALF = "\ud800"
"""Half of a character: JSON can write it, UTF-8 cannot."""
HUGE = 10**400
CASES = 5000 if os.environ.get("MSBOT_THOROUGH") else 300


def entity(**config: object) -> str:
    return json.dumps({"state_topic": "forged/state", "device": {"identifiers": ["forged"]}, **config})


FORGED = {
    "homeassistant/sensor/half/config": entity(device={"identifiers": [HALF], "name": HALF, "manufacturer": HALF}),
    "homeassistant/sensor/half2/config": entity(state_topic=HALF),
    "homeassistant/switch/half3/config": entity(command_topic="c", payload_on=HALF, payload_off=HALF),
    "homeassistant/switch/half4/config": entity(command_topic=HALF),
    "homeassistant/sensor/nul/config": entity(state_topic=NUL),
    "homeassistant/sensor/control/config": entity(state_topic="a\x01b\ufffe"),
    "homeassistant/sensor/life/config": entity(availability_topic="a#"),
    "homeassistant/sensor/life2/config": entity(availability=[{"topic": "+x"}, {"topic": NUL}, {"topic": HALF}]),
    "homeassistant/sensor/life3/config": entity(availability_topic="#"),
    "homeassistant/sensor/share/config": entity(state_topic="$share/x"),
    "homeassistant/sensor/levels/config": entity(state_topic="/" * 300),
    "homeassistant/sensor/long/config": entity(state_topic="\N{SNOWMAN}" * 5000),
    "homeassistant/number/huge/config": entity(command_topic="c", min=HUGE, max=HUGE),
    "homeassistant/light/scale/config": entity(command_topic="c", schema="json", brightness=True),
    "homeassistant/fan/speeds/config": entity(command_topic="c", percentage_command_topic="d", speed_range_max=1e308),
    "homeassistant/sensor/words/config": entity(name="words"),
    "homeassistant/sensor/warm/config": entity(unit_of_measurement="°C"),
    "homie/5/forged/$description": json.dumps(
        {"homie": "5.0", "nodes": {"a+": {"properties": {"b#": {"datatype": "float"}, NUL: {"datatype": "float"}}}}}
    ),
    "homie/5/forged/$state": "ready",
    "homie/5/root/$description": json.dumps(
        {"homie": "5.0", "root": "#", "nodes": {HALF: {"properties": {"x": {"datatype": "float"}}}}}
    ),
    "homie/5/root/$state": "ready",
    "homie/forged/$homie": "4.0.0",
    "homie/forged/$nodes": "a+,b#,c",
    "homie/forged/a+/$properties": "x",
    "homie/forged/b#/$properties": "x",
    "homie/forged/c/$properties": "+",
    "homie/forged/$state": "ready",
}
STATES = [json.dumps({"state": "ON", "brightness": HUGE}), NUL, "1e300", "-" + "9" * 4000, "1e400", "nan", "[" * 3000]


@pytest.mark.promise("What other clients of a broker publish ends no bridge")
async def test_whatever_is_published_an_honest_device_is_found_driven_and_stopped(tmp_path: Path) -> None:
    from msbot_bridges.mqtt.world import open_world

    with mosquitto(tmp_path) as port:
        async with aiomqtt.Client("127.0.0.1", port) as attacker:
            for topic, payload in FORGED.items():
                if not set(topic) & set("+#"):
                    await attacker.publish(topic, payload, qos=1, retain=True)
            async with running(open_world(BridgeLink(f"mqtt://127.0.0.1:{port}"))) as host:
                forged = await host.devices.get()
                heard = asyncio.Queue[Message]()
                forged.begin(lambda _port, message: heard.put_nowait(message))
                for state in STATES:
                    await attacker.publish("forged/state", state, qos=1)
                while not isinstance(message := await heard.get(), Text) or message.text != STATES[-1][:200]:
                    pass
                async with plugged(port, "1") as lamp:
                    while (device := await host.devices.get()).identity.part_number != "simulated:lamp":
                        pass
                    device.begin(lambda _port, _message: None)
                    device.act("lamp", Level(percent=40))
                    while lamp.brightness != 102:  # noqa: ASYNC110 - the lamp has no event for it
                        await asyncio.sleep(0.02)
                    while not host.told.is_set():
                        device.stop()
                        await asyncio.sleep(0.05)
                    assert device.not_stopped == ""
                    assert host.lost_why.empty(), "the connection to the broker was never lost"


KEYS = [
    "state_topic", "command_topic", "brightness_command_topic", "brightness_state_topic", "brightness_scale", "schema",
    "rgb_command_topic", "percentage_command_topic", "percentage_state_topic", "speed_range_min", "speed_range_max",
    "position_topic", "set_position_topic", "position_open", "position_closed", "min", "max", "step", "device_class",
    "unit_of_measurement", "value_template", "command_template", "payload_on", "payload_off", "availability_topic",
    "availability", "availability_mode", "entity_category", "options", "name", "supported_color_modes", "brightness",
    "payload_stop", "state_class", "device", "components", "platform", "~", "on_command_type", "origin",
]  # fmt: skip
VALUES: list[object] = [
    "t", "t/u", "~/x", NUL, HALF, "#", "", None, True, 0, -1, 1, 255, 1e308, -1e308, 1e15, HUGE, -HUGE, float("nan"),
    float("inf"), [], {}, [[]], ["rgb"], [{"topic": "t"}], {"topic": "t"}, [7], "json", "config", "{{ value_json.a }}",
    "{{ value | float * 9 }}", "{{ value_json[0] | int }}", "°C", "%", "battery", "last", "brightness", "x" * 3000,
    {"identifiers": HALF}, {"identifiers": [{}]}, {"connections": [[1]]}, {"identifiers": "d", "name": 7},
    {"a": {"platform": "light", "command_topic": "c"}, "b": {"platform": []}, "c": 7},
]  # fmt: skip
COMPONENTS = ("light", "switch", "fan", "cover", "number", "button", "sensor", "binary_sensor", "device", "select")
PAYLOADS = [*STATES, "", "ON", "1", "255", "-1", "9" * 300, '{"a": 1e999}', '{"a": "\\ud800"}', '["\\udfff"]', "online"]


def try_device(model: DeviceModel) -> None:
    """What a world and a bridge do with a device, whatever it is."""
    model.identity.uid.hex()
    sent: list[bytes] = []
    device = MqttDevice(
        model,
        send=lambda order, _: sent.append(order.payload.encode()),
        news=lambda _: None,
        now=lambda: 0.0,
    )
    device.begin(lambda _port, message: sent.append(message.encode()))
    for topic in {one.topic for one in model.readings} | {one.topic for one in model.settings}:
        checked_topic(topic, "topic")
        for payload in PAYLOADS:
            device.heard(topic, payload, is_old=False)
    for life in model.life:
        checked_topic(life.topic, "topic")
        for payload in PAYLOADS:
            life.read(payload)
    device.describe_settings()
    for command in model.commands:
        if command.safe is not None:
            device.act(command.port, command.safe)
        if command.message is Level:
            device.act(command.port, Level(percent=100))
    device.stop()


@pytest.mark.parametrize("seed", range(3))
def test_any_declaration_is_a_device_that_can_be_used_or_left_out(seed: int) -> None:
    random, made = Random(seed), 0
    for _ in range(CASES):
        ha, homie = HaDiscovery(), Homie5()
        for number in range(3):
            config = {key: random.choice(VALUES) for key in random.sample(KEYS, random.randrange(1, 12))}
            config = {"command_topic": "c", "state_topic": "s", **config} if random.random() < 0.7 else config
            if random.random() < 0.7:
                config["device"] = {"identifiers": ["d"]}
            ha.hear(f"homeassistant/{random.choice(COMPONENTS)}/{number}/config", json.dumps(config).encode(), 0.0)
        property_keys = ("datatype", "format", "unit", "settable", "retained")
        datatypes = ("float", "integer", "boolean", "enum", "color", "string")
        told = {key: random.choice((*VALUES, True, *datatypes, "0:1e308", "-9:9", "rgb")) for key in property_keys}
        nodes = {random.choice(("lamp", "settings", NUL)): {"properties": {"x": {"datatype": "float", **told}}}}
        homie.hear("homie/5/d/$description", json.dumps({"homie": "5.0", "nodes": nodes}).encode(), 0.0)
        for convention in (ha, homie):
            for _, model in convention.due(9.0):
                if model is not None:
                    try_device(model)
                    made += bool(model.readings or model.commands)
    assert made > CASES / 3


def test_what_is_kept_of_declarations_is_bounded_in_octets_and_in_work() -> None:
    ha, homie4, homie5 = HaDiscovery(), Homie4(), Homie5()
    filler = "x" * 60_000
    for number in range(MOST_OCTETS // 60_000 + 9):
        ha.hear(f"homeassistant/sensor/{number}/config", entity(name=filler).encode(), 0.0)
        homie5.hear(f"homie/5/{number}/$description", json.dumps({"homie": "5.0", "name": filler}).encode(), 0.0)
        for attribute in range(400):
            homie4.hear(f"homie/d{number % 190}/$a{attribute}", b"x" * 3000, 0.0)
    assert ha.dropped >= 9
    assert homie5.dropped >= 9
    assert homie4.dropped >= 9
    ha.hear("homeassistant/sensor/0/config", b"", 1.0)
    dropped = ha.dropped
    ha.hear("homeassistant/sensor/new/config", entity().encode(), 1.0)
    assert ha.dropped == dropped, "what was taken back makes room"
    shared = {f"k{number}": "" for number in range(150)}
    components = {f"c{number}": {"p": "sensor", "stat_t": "s"} for number in range(2000)}
    many = HaDiscovery()
    many.hear(
        "homeassistant/device/d/config", json.dumps({**shared, "dev": {"ids": "d"}, "cmps": components}).encode(), 0.0
    )
    ((_, model),) = many.due(2.0)
    assert model is not None
    assert len(model.declared) <= 200
    lists = Homie4()
    lists.hear("homie/d/$homie", b"4.0.0", 0.0)
    lists.hear("homie/d/$nodes", b"a," * 1900, 0.0)
    lists.hear("homie/d/a/$properties", ",".join(map(str, range(1000))).encode(), 0.0)
    ((_, other),) = lists.due(2.0)
    assert other is not None
    assert len(other.left_out) <= 400


@pytest.mark.parametrize(
    "topic", [NUL, HALF, "a#", "+/a", "$share/g/t", "", 7, "/" * 200, "x" * 2000, "a\x7f", "a\uffff"]
)
def test_no_topic_is_asked_for_that_a_broker_would_not_have(topic: object) -> None:
    with pytest.raises(ConfigError, match="its topic"):
        checked_topic(topic, "its topic")


@pytest.mark.parametrize("topic", ["a", "/", "$SYS/x", "wohnzimmer/lämpchen/💡", "a b"])
def test_other_topics_are_asked_for(topic: str) -> None:
    assert checked_topic(topic, "its topic") == topic
