"""Settings and safe values of a device on MQTT in a whole robot: they reach it, survive a swap, and are undone."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.mqtt.own_broker.server import OwnBroker
from tests.bridges.hosting import program, running
from tests.bridges.test_every_world import Robot, robot_with

pytest.importorskip("aiomqtt")

from msbot_bridges.mqtt.simulated import SimulatedLamp

LAMP = "simulated:lamp"
ADOPTED = Path(__file__).parents[4] / "examples" / "makers" / "adopted" / "lamp.toml"


@asynccontextmanager
async def plugged(port: int, serial: str) -> AsyncIterator[SimulatedLamp]:
    lamp = SimulatedLamp(BridgeLink(f"mqtt://127.0.0.1:{port}"), {"serial": serial})
    running_lamp = asyncio.create_task(lamp.run())
    try:
        yield lamp
    finally:
        running_lamp.cancel()
        await asyncio.wait([running_lamp])


def is_in(robot: Robot) -> bool:
    now = asyncio.get_running_loop().time()
    parts = robot.master.inventory.view(now)
    return any((one.part_number, one.state) == (LAMP, PartState.ACTIVE) for one in parts)


async def test_settings_reach_the_device_survive_a_swap_and_are_undone(tmp_path: Path) -> None:
    async with OwnBroker().running() as broker:
        bridge = BridgeTable("mqtt", f"mqtt://127.0.0.1:{broker.port}")
        async with robot_with(tmp_path, [bridge]) as robot:
            async with plugged(broker.port, "1") as lamp:
                await robot.until(lambda: (found := robot.part(LAMP)) is not None and found.says is not None)
                assert lamp.limit == 100, "a device that is not in the inventory is told nothing"
                await robot.do("adopt", who="ann", part=LAMP, slot="guest")
                await robot.until(lambda: is_in(robot))
                await robot.do("set", who="ann", slot="guest", name="limit", value=70)
                await robot.until(lambda: lamp.limit == 70)
                await robot.do("set", who="ann", slot="guest", name="limit", value=40)
                await robot.until(lambda: lamp.limit == 40)
                with pytest.raises(ValueError, match="100"):
                    await robot.do("set", who="ann", slot="guest", name="limit", value=140)
                await robot.do("undo", who="ann")
                await robot.until(lambda: lamp.limit == 70)
            await robot.until(lambda: not is_in(robot))
            async with plugged(broker.port, "2") as other:
                await robot.until(lambda: is_in(robot) and other.limit == 70)


async def test_the_librarys_safe_value_is_what_stop_orders_and_waits_for(tmp_path: Path) -> None:
    text = ADOPTED.read_text().replace("safe = {percent = 0.0}", "safe = {percent = 20.0}")
    (tmp_path / "adopted").mkdir()
    (tmp_path / "adopted" / "lamp.toml").write_text(text)
    more = '\n[[slot]]\nname = "knob"\npart = "POT-10K"\n[[slot]]\nname = "lamp"\npart = "simulated:lamp"\n'
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


async def test_settings_of_a_genuine_library_have_range_choices_and_what_the_device_has_as_default(
    tmp_path: Path,
) -> None:
    pytest.importorskip("ha_mqtt_discoverable")
    from msbot_bridges.mqtt.world import open_world

    async with OwnBroker().running() as broker:
        with program("ha_settings.py", str(broker.port)) as desk:
            await desk.line("ready")
            async with running(open_world(BridgeLink(f"mqtt://127.0.0.1:{broker.port}"))) as host:
                device = await host.devices.get()
                found = {one.name: one for one in device.settings}
                assert set(found) == {"fade", "mode", "loud"}
                fade, mode, loud = found["fade"], found["mode"], found["loud"]
                assert (fade.kind, fade.default, fade.least, fade.most, fade.unit) == (float, 1.5, 0, 10, "s")
                assert (mode.default, mode.choices) == ("soft", ("soft", "hard"))
                assert loud.default is False
                assert any("silent: it has not reported its value" in words for words in host.said), host.said
                device.set("fade", 1.5)  # has it already: it is not told
                device.set("fade", 2.5)
                assert await desk.line("fade") == "2.5"
                device.set("mode", "hard")
                assert await desk.line("mode") == "hard"
                device.set("loud", True)
                assert await desk.line("loud") == "ON"


async def test_messages_that_are_left_out_are_counted_and_said_once_for_each_power_of_ten() -> None:
    import aiomqtt

    from msbot_bridges.mqtt.world import open_world

    state = {"state_topic": "a/b", "command_topic": "a/c", "unique_id": "one", "device": {"identifiers": "d"}}
    async with (
        OwnBroker().running() as broker,
        running(open_world(BridgeLink(f"mqtt://127.0.0.1:{broker.port}"))) as host,
        aiomqtt.Client("127.0.0.1", broker.port) as client,
    ):
        await client.publish("homeassistant/switch/one/config", json.dumps(state), retain=True)
        await host.devices.get()  # the bridge listens
        for number in range(120):
            await client.publish(f"homeassistant/switch/{number}/config", b"no JSON")
        for count in ("1 message ", "10 messages ", "100 messages "):
            while "left out so far" not in (told := await host.saying.get()):
                pass
            assert told == f"left out so far: {count}of the broker, too long, too many, or not readable"
        assert sum("left out so far" in words for words in host.said) == 3


async def test_a_broker_tells_of_topics_for_which_there_is_no_room() -> None:
    from msbot_bridges.mqtt.broker import MOST_TOPICS, Broker, BrokerAddress

    told: list[int] = []
    broker = Broker(
        BrokerAddress("127.0.0.1", 1883), on_message=lambda *_: None, on_dropped=lambda: told.append(broker.dropped)
    )
    broker.subscribe(f"t/{number}" for number in range(MOST_TOPICS + 2))
    assert told == [1, 2]
