"""Devices of genuine libraries at a genuine broker: found, told, stopped as they report it, lost by their last will."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from msbot.part.messages.standard import Angle, Level, Switch, Temperature
from msbot_bridges.bridge import BridgeLink, World
from tests.bridges.hosting import program, running
from tests.bridges.mosquitto import mosquitto, publish

pytest.importorskip("aiomqtt")
pytest.importorskip("ha_mqtt_discoverable")


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    with mosquitto(tmp_path_factory.mktemp("broker")) as port:
        yield port


def world(port: int) -> World:
    from msbot_bridges.mqtt.world import open_world

    return open_world(BridgeLink(f"mqtt://127.0.0.1:{port}"))


async def test_a_device_of_home_assistant_is_a_part(broker: int) -> None:
    with program("ha_device.py", str(broker), "desk1") as desk:
        await desk.line("ready")
        async with running(world(broker)) as host:
            device = await host.devices.get()
            assert device.identity.part_number == "ACME:desk"
            assert device.identity.software == "1.2"
            assert [(one.name, one.safe) for one in device.inputs] == [
                ("heater", Level(percent=0)),
                ("lamp", Level(percent=0)),
                ("relay", Switch(on=False)),
            ]
            assert [one.name for one in device.outputs] == [
                "door",
                "heater_state",
                "lamp_state",
                "probe",
                "relay_state",
            ]
            heard = asyncio.Queue[tuple[str, object]]()
            device.begin(lambda port, message: heard.put_nowait((port, message)))
            first = [await heard.get() for _ in range(4)]
            assert ("probe", Temperature(celsius=21.5)) in first, "a device that joins tells what is known of it"
            device.act("lamp", Level(percent=40))
            assert await desk.line("lamp") == '{"brightness": 102, "state": "ON"}'
            while (await heard.get())[1] != Level(percent=40):
                pass
            await desk.tell("warm 33")
            while await heard.get() != ("probe", Temperature(celsius=33)):
                pass

            await desk.tell("mute")
            device.stop()
            assert await desk.line("lamp") == '{"state": "OFF"}'
            assert await desk.line("relay") == "OFF"
            while "relay" in device.not_stopped:
                await heard.get()
            assert device.not_stopped == "Desk desk1 has not reported for lamp that it is off"
            await desk.tell("speak")
            while not host.told.is_set():
                device.stop()  # as a bridge does again and again
                await asyncio.sleep(0.05)
            assert device.not_stopped == ""

            # Somebody else switches it on while STOP holds: it is switched off again.
            host.told.clear()
            publish(broker, "hmd/light/Desk-desk1/lamp/command", '{"state": "ON", "brightness": 9}')
            while await desk.line("lamp") != '{"brightness": 9, "state": "ON"}':
                pass
            assert await desk.line("lamp") == '{"state": "OFF"}'
            await host.told.wait()

            desk.kill()
            assert await host.lost_why.get() == "Desk desk1 is no longer available, as its topic says"


async def test_a_device_of_homie_is_a_part(broker: int) -> None:
    pytest.importorskip("homie_spec")
    with program("homie_device.py", str(broker), "lamp1") as lamp:
        await lamp.line("ready")
        async with running(world(broker)) as host:
            device = await host.devices.get()
            assert device.identity.part_number == "homie:ACME lamp"
            assert [(one.name, one.safe) for one in device.inputs] == [
                ("power", Switch(on=False)),
                ("level", Level(percent=0)),
            ]
            heard = asyncio.Queue[tuple[str, object]]()
            device.begin(lambda port, message: heard.put_nowait((port, message)))
            device.act("level", Level(percent=70))
            assert await lamp.line("level") == "70"
            while await heard.get() != ("level_state", Level(percent=70)):
                pass
            await lamp.tell("mute")
            device.act("power", Switch(on=True))
            assert await lamp.line("power") == "true"
            device.stop()
            assert await lamp.line("power") == "false"
            assert device.not_stopped, "the broker has the order; the device has not said anything"
            await lamp.tell("speak")
            while not host.told.is_set():
                device.stop()
                await asyncio.sleep(0.05)
            assert device.not_stopped == ""
            lamp.kill()
            assert await host.lost_why.get() == "lamp1 is no longer available, as its topic says"


async def test_a_device_of_homie_5_is_a_part(broker: int) -> None:
    pytest.importorskip("ebus_sdk")
    with program("homie5_device.py", str(broker)) as arm:
        await arm.line("ready")
        async with running(world(broker)) as host:
            device = await host.devices.get()
            assert device.identity.part_number == "homie:acme-arm"
            assert [(one.name, one.safe, one.ranges) for one in device.inputs] == [
                ("angle", Angle(degrees=0), {"degrees": (-90, 90)}),
                ("gripper", Switch(on=False), {}),
            ]
            assert [(one.name, one.default, one.least, one.most, one.unit) for one in device.settings] == [
                ("speed", 40, 1, 100, "%")
            ]
            heard = asyncio.Queue[tuple[str, object]]()
            device.begin(lambda port, message: heard.put_nowait((port, message)))
            device.set("speed", 70)
            assert await arm.line("speed") == "70"
            device.act("angle", Angle(degrees=12.5))
            assert float(await arm.line("angle")) == 12.5
            while await heard.get() != ("angle_state", Angle(degrees=12.5)):
                pass
            device.act("gripper", Switch(on=True))
            assert (await arm.line("gripper")).lower() == "true"
            device.stop()
            assert float(await arm.line("angle")) == 0.0
            while not host.told.is_set():
                device.stop()
                await asyncio.sleep(0.05)
            assert device.not_stopped == ""
            arm.kill()
            assert await host.lost_why.get() == "arm1 is no longer available, as its topic says"


async def test_a_broker_that_is_gone_loses_its_devices_and_one_that_comes_back_finds_them(tmp_path: Path) -> None:
    from msbot_bridges.mqtt.simulated import SimulatedLamp

    with ExitStack() as first:
        port = first.enter_context(mosquitto(tmp_path))
        lamp = asyncio.create_task(SimulatedLamp(BridgeLink(f"mqtt://127.0.0.1:{port}"), {"serial": "7"}).run())
        try:
            async with running(world(port)) as host:
                device = await host.devices.get()
                assert device.identity.part_number == "simulated:lamp"
                first.close()
                await host.lost_why.get()
                with mosquitto(tmp_path, port):
                    assert (await host.devices.get()).identity.uid == device.identity.uid
        finally:
            lamp.cancel()
            await asyncio.wait([lamp])


async def test_where_no_broker_is_the_sentence_says_so() -> None:
    from msbot_xrce.errors import LinkDown

    with pytest.raises(LinkDown, match="does the broker run there"):
        await world(1).run(None)  # type: ignore[arg-type]  # nothing is found
