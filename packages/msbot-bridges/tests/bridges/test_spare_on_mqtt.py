"""A pump on MQTT stands by for one with Modbus: what is lost is said first, and it gets the slot with its settings."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from msbot_bridges.bridge import BridgeLink, worlds
from msbot_bridges.mqtt.own_broker.server import OwnBroker
from msbot_xrce.errors import ConfigError
from tests.bridges.hosting import program
from tests.bridges.test_every_world import PUMP, robot_with
from tests.e2e.test_processes import free_port

pytest.importorskip("aiomqtt")
pytest.importorskip("pymodbus")
pytest.importorskip("ha_mqtt_discoverable")
OWN, OTHER = "ACME:pump", "Other:pump"
SLOTS = """
[[slot]]
name = "meter"
part = "LM393-SPEED"
[[slot]]
name = "pump"
part = "ACME:pump"
[slot.settings]
ramp = 5.0
[slot.safe]
speed = { rpm = 150 }
[[binding]]
topic = "turning"
type = "Speed"
from = "meter.speed"
to = ["pump.speed"]
"""


async def test_a_pump_on_mqtt_takes_the_slot_of_one_with_modbus(tmp_path: Path) -> None:
    (tmp_path / "adopted").mkdir()
    shutil.copy(PUMP.parent / "adopted" / "pump.toml", tmp_path / "adopted")
    line = BridgeLink(f"tcp:127.0.0.1:{free_port()}", {"table": str(PUMP)})
    async with OwnBroker().running() as broker:
        bridges = [BridgeTable("modbus", line.address, line.options)]
        bridges.append(BridgeTable("mqtt", f"mqtt://127.0.0.1:{broker.port}"))
        pump = asyncio.create_task(worlds()["modbus"].simulated["devices"](line, {}).run())
        with program("ha_pump.py", str(broker.port)) as other:
            async with robot_with(tmp_path, bridges, SLOTS) as robot:
                await robot.until(lambda: robot.is_in(OWN, PartState.ACTIVE))
                await robot.until(lambda: (found := robot.part(OTHER)) is not None and found.says is not None)
                with pytest.raises(ConfigError, match="turns"):
                    await robot.do("spare", who="ann", slot="pump", part=OTHER, agreed=False)
                await robot.do("spare", who="ann", slot="pump", part=OTHER, agreed=True)
                await robot.until(lambda: robot.is_in(OTHER, PartState.STANDBY))
                pump.cancel()
                await asyncio.wait([pump])
                await robot.until(lambda: robot.is_in(OTHER, PartState.ACTIVE))
                assert await other.line("ramp") == "5"
                await robot.do("publish", who="ann", port="pump.speed", values=["1200"], seconds=60.0)
                assert await other.line("speed") == "1200"
                await robot.do("stop", who="ann", reason="")
                await robot.until(lambda: OTHER in {one.part for one in robot.master.stop.confirmed})
                assert await other.line("speed") == "150", "the safe value of the slot"
