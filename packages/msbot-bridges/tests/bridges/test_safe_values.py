"""The safe value of a slot at devices of other makers: what STOP orders, and what confirms it."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from msbot.config import BridgeTable
from msbot.part.messages.standard import Angle, Colour, Level, Speed, Switch, Tone
from msbot.pnp import PartState
from msbot_bridges.bridge import DeviceIdentity
from msbot_bridges.jacdac.jacdac_bus import JacdacBus
from msbot_bridges.jacdac.module_device import ModuleDevice
from msbot_bridges.jacdac.services import INTENSITY, VALUE
from msbot_bridges.modbus.device_table import read_device_table
from msbot_bridges.modbus.modbus_device import ModbusDevice
from msbot_bridges.modbus.points import ModbusPoint
from msbot_bridges.mqtt.device_model import Order
from msbot_bridges.mqtt.mqtt_device import MqttDevice
from msbot_bridges.mqtt.own_broker.server import OwnBroker
from tests.bridges.test_every_world import PUMP, robot_with
from tests.bridges.test_ha_discovery import one as entity
from tests.bridges.test_jacdac_frames import found
from tests.bridges.test_mqtt_settings import ADOPTED, LAMP, is_in, plugged

SERVO, LAMP_SERVICE, LEDS, MOTOR, BUZZER = 0x12FC9103, 0x1CAB054C, 0x1609D4F0, 0x17004CD8, 0x1B57B1D7


def pump() -> tuple[ModbusDevice, list[tuple[str, float]]]:
    table, written = read_device_table(PUMP), list[tuple[str, float]]()

    def write(point: ModbusPoint, value: float, _is_stop: bool) -> None:
        written.append((point.name, value))
        device.was_written(point, value)

    who = DeviceIdentity("a", "b", b"1", "pump", "unit 1")
    device = ModbusDevice(who, table, write=write, news=lambda _: None)
    return device, written


def test_modbus_writes_it_and_waits_until_it_is_read_back() -> None:
    device, written = pump()
    points = {one.name: one for one in device.table.points}
    device.safe_is("speed", Speed(rpm=100))
    device.stop()
    assert written == [("speed", 100), ("valve", 0)]
    for name, value in (("speed", 0.0), ("valve", 0.0), ("turns", 0.0)):
        device.read(points[name], value)
    assert device.not_stopped == "unit 1 has not been read with the safe value of speed, turns"
    device.read(points["speed"], 100.0)
    device.read(points["turns"], 100.0)
    assert device.not_stopped == ""
    device.read(points["speed"], 0.0)
    assert written[-1] == ("speed", 100), "somebody else has written it"


def test_modbus_is_left_when_the_safe_values_are_read_back() -> None:
    device, written = pump()
    points = {one.name: one for one in device.table.points}
    device.act("speed", Speed(rpm=900))
    device.rests_at("speed", Speed(rpm=100))
    device.leave()
    assert written[-2:] == [("speed", 100), ("valve", 0)]
    device.leave()
    assert written[-2:] == [("speed", 100), ("valve", 0)], "it is written again"
    for name, value in (("speed", 100.0), ("valve", 0.0), ("turns", 900.0)):
        device.read(points[name], value)
    assert device.not_stopped == "unit 1 has not been read with the safe value of turns"
    device.read(points["turns"], 100.0)
    assert device.not_stopped == ""


def test_modules_of_jacdac_are_left_when_they_have_reported_it() -> None:
    module = found(JacdacBus(), MOTOR).module
    device = ModuleDevice(module, lambda: None, lambda _: None)
    device.act("power", Level(percent=90))
    device.rests_at("power", Level(percent=50))
    device.leave()
    half = (0x4000).to_bytes(2, "little")
    assert module.kept == {(1, VALUE): half, (1, INTENSITY): b"\1"}
    assert device.not_stopped == "power has not reported its safe value"
    device.heard(1, VALUE, 0, half)
    device.heard(1, INTENSITY, 0, b"\1")
    assert device.not_stopped == ""


@pytest.mark.parametrize("stops", [True, False])
def test_mqtt_is_left_as_at_stop_but_a_cover_moves_to_its_end(stops: bool) -> None:
    sent, now = list[tuple[str, str, bool]](), [0.0]

    def send(order: Order, is_urgent: bool) -> None:
        sent.append((order.topic, order.payload, is_urgent))

    cover = entity("cover", cmd_t="c", stat_t="s", set_pos_t="p", pos_t="ps")
    light = entity("light", cmd_t="l", stat_t="ls")
    model = replace(light, commands=[*light.commands, replace(cover.commands[0], port="cover")])
    device = MqttDevice(model, send=send, news=lambda _: None, now=lambda: now[0])
    device.act("thing", Switch(on=True))
    if stops:
        device.stop()
    else:
        device.rests_at("thing", Switch(on=False))
        device.leave()
    urgent = [("l", "OFF", True), *([("c", "STOP", True)] if stops else [])]
    assert [one for one in sent if one[2]] == urgent
    assert device.not_stopped.endswith("has not reported for thing that it is off")
    device.heard("ls", "OFF", is_old=False)
    assert device.not_stopped == ("" if not stops else "Box has not reported for cover that it stands still")
    now[0] += 1
    device.stop() if stops else device.leave()
    assert [one for one in sent if one[2]] == [*urgent, *([("c", "STOP", True)] if stops else [])]


def test_modules_of_jacdac_keep_it_with_power() -> None:
    bus = JacdacBus()
    module = found(bus, LAMP_SERVICE, SERVO, MOTOR).module
    device = ModuleDevice(module, lambda: None, lambda _: None)
    device.safe_is("brightness", Level(percent=20))
    device.safe_is("angle", Angle(degrees=90))
    device.safe_is("power", Level(percent=50))
    device.stop()
    dim, right = round(0.2 * 0x10000).to_bytes(2, "little"), (90 << 16).to_bytes(4, "little")
    half = (0x4000).to_bytes(2, "little")
    on = {(2, INTENSITY): b"\1", (3, INTENSITY): b"\1"}
    assert module.kept == {(1, INTENSITY): dim, (2, VALUE): right, (3, VALUE): half, **on}
    assert device.not_stopped == "brightness has not reported its safe value"
    device.heard(1, INTENSITY, 0, dim)
    device.heard(2, INTENSITY, 0, b"\1")
    assert device.not_stopped == "angle has not reported its safe value"
    device.heard(2, VALUE, 0, right)
    device.heard(3, VALUE, 0, half)
    device.heard(3, INTENSITY, 0, b"\1")
    assert device.not_stopped == ""
    device.go()
    device.stop()
    assert module.kept[1, INTENSITY] == b"\0\0", "it holds as long as the robot says it"
    assert module.kept[2, INTENSITY] == module.kept[3, INTENSITY] == b"\0"


def test_without_a_value_of_the_robot_modules_of_jacdac_have_no_power() -> None:
    module = found(JacdacBus(), MOTOR, BUZZER).module
    device = ModuleDevice(module, lambda: None, lambda _: None)
    assert {one.name: one.stops_by for one in device.inputs} == {"power": "", "tone": "volume 0"}
    device.safe_is("power", Level(percent=0))  # the module's own
    device.safe_is("tone", Tone(hertz=440, seconds=1))
    device.stop()
    assert module.kept == {(1, VALUE): b"\0\0", (1, INTENSITY): b"\0", (2, INTENSITY): b"\0"}, "a tone does not last"


def test_a_module_of_jacdac_that_left_during_stop_is_driven_when_it_comes_back() -> None:
    module = found(JacdacBus(), SERVO).module
    device = ModuleDevice(module, lambda: None, lambda _: None)
    device.stop()
    device.end()
    device.begin(lambda _port, _message: None)
    device.act("angle", Angle(degrees=45))
    assert module.kept[1, INTENSITY] == b"\1"


def test_a_partner_that_is_gone_leaves_a_module_of_jacdac_with_it() -> None:
    module = found(JacdacBus(), SERVO, MOTOR).module
    device = ModuleDevice(module, lambda: None, lambda _: None)
    device.act("power", Level(percent=90))
    device.rests_at("angle", Angle(degrees=90))
    device.rest()
    assert module.kept[1, VALUE] == (90 << 16).to_bytes(4, "little")
    assert (module.kept[1, INTENSITY], module.kept[2, INTENSITY]) == (b"\1", b"\0")


def test_a_module_of_jacdac_is_driven_again_when_its_partner_is_back() -> None:
    bus = JacdacBus()
    module = found(bus, SERVO, LEDS).module
    device = ModuleDevice(module, lambda: None, lambda _: None)
    device.act("angle", Angle(degrees=45))
    device.act("colour", Colour(red=1, green=2, blue=3))
    device.rest()
    assert module.kept[1, INTENSITY] == b"\0"
    assert module.kept[2, VALUE] == bytes((1, 2, 3)), "its own partner is still there"
    device.act("angle", Angle(degrees=50))
    assert module.kept[1, INTENSITY] == b"\1"


@pytest.mark.parametrize("wired", [True, False])
async def test_mqtt_is_ordered_it_with_and_without_a_wire_and_reports_it(wired: bool, tmp_path: Path) -> None:
    (tmp_path / "adopted").mkdir()
    (tmp_path / "adopted" / "lamp.toml").write_text(ADOPTED.read_text())
    more = f'\n[[slot]]\nname = "knob"\npart = "POT-10K"\n[[slot]]\nname = "lamp"\npart = "{LAMP}"\n'
    more += "[slot.safe]\nlamp = { percent = 20 }\n"
    if wired:
        more += '[[binding]]\ntopic = "level"\ntype = "Level"\nfrom = "knob.level"\nto = ["lamp.lamp"]\n'
    async with OwnBroker().running() as broker, plugged(broker.port, "1") as lamp:
        bridge = BridgeTable("mqtt", f"mqtt://127.0.0.1:{broker.port}")
        async with robot_with(tmp_path, [bridge], more) as robot:
            await robot.until(lambda: is_in(robot))
            await robot.do("publish", who="ann", port="lamp.lamp", values=["90"], seconds=60.0)
            await robot.until(lambda: lamp.brightness == 230)
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: LAMP in {one.part for one in robot.master.stop.confirmed})
            assert lamp.brightness == 51
            text = (tmp_path / "robot.toml").read_text()
            (tmp_path / "robot.toml").write_text(text.replace("percent = 20", "percent = 40"))
            done = await robot.do("apply", who="ann", path=str(tmp_path / "robot.toml"), folders=[])
            await robot.do("go", who="ann", stop=None)
            await asyncio.sleep(0.5)
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: LAMP in {one.part for one in robot.master.stop.confirmed})
            assert lamp.brightness == 102
            await robot.do("undo", who="ann", edit=done.edit_id)
            await robot.do("go", who="ann", stop=None)
            await asyncio.sleep(0.5)
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: LAMP in {one.part for one in robot.master.stop.confirmed})
            assert lamp.brightness == 51
            assert robot.is_in(LAMP, PartState.ACTIVE)
