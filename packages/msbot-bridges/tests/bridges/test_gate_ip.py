"""A device on MQTT that is not in the inventory is told nothing and heard by nobody: mosquitto_sub is the witness."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from tests.bridges.mosquitto import command, mosquitto
from tests.bridges.test_every_world import robot_with
from tests.bridges.test_mqtt_settings import LAMP, plugged

pytest.importorskip("aiomqtt")
OWN = {"msbot-lamp/1/available", "msbot-lamp/1/state", "msbot-lamp/1/limit"}
"""Where the lamp itself reports."""


@contextlib.asynccontextmanager
async def witness(port: int) -> AsyncIterator[list[str]]:
    """The topics of all messages at a broker, as they come."""
    words = (command("mosquitto_sub", "mosquitto-clients"), "-h", "127.0.0.1", "-p", str(port), "-t", "#", "-F", "%t")
    process = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.PIPE)
    heard: list[str] = []

    async def read() -> None:
        assert process.stdout is not None
        async for line in process.stdout:
            heard.append(line.decode().strip())

    reading = asyncio.create_task(read())
    try:
        yield heard
    finally:
        process.terminate()
        await process.wait()
        await reading


@pytest.mark.promise("A device of another maker that is not in the inventory is told nothing and heard by nobody")
async def test_a_lamp_is_told_nothing_until_it_is_adopted_and_nothing_after_it_is_blocked(tmp_path: Path) -> None:
    with mosquitto(tmp_path) as port:
        bridge = BridgeTable("mqtt", f"mqtt://127.0.0.1:{port}")
        async with witness(port) as heard, robot_with(tmp_path, [bridge]) as robot, plugged(port, "1") as lamp:
            await robot.until(lambda: (found := robot.part(LAMP)) is not None and found.says is not None)
            await robot.until(lambda: OWN - {"msbot-lamp/1/state"} <= set(heard))
            for _ in range(10):  # its reports, while nobody has adopted it
                lamp._report()
                await asyncio.sleep(0.1)
            assert {one for one in heard if not one.startswith("homeassistant/")} <= OWN
            assert not robot.has_recorded("lamp"), robot.recorded
            await robot.do("adopt", who="ann", part=LAMP, slot="guest")
            await robot.until(lambda: robot.is_in(LAMP, PartState.ACTIVE))
            await robot.do("set", who="ann", slot="guest", name="limit", value=70)
            await robot.until(lambda: "msbot-lamp/1/limit/set" in heard and lamp.limit == 70)
            await robot.do("block", who="ann", part=LAMP, reason="lent")
            await robot.until(lambda: not robot.is_in(LAMP, PartState.ACTIVE))
            await asyncio.sleep(0.5)
            heard.clear()
            await robot.do("set", who="ann", slot="guest", name="limit", value=40)
            await asyncio.sleep(1.0)
            assert not [one for one in heard if one.endswith("/set")], heard
            assert lamp.limit == 70
