"""Devices on MQTT, Modbus and Jacdac take slots of others: of a like one with its settings, of one of another world."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from msbot_bridges.modbus.address import read_address
from msbot_bridges.modbus.device_table import read_device_table
from msbot_bridges.modbus.points import RegisterTable
from msbot_bridges.mqtt.own_broker.server import OwnBroker
from msbot_xrce.errors import ConfigError
from tests.bridges.test_every_world import PUMP, Plug, Robot, robot_with
from tests.bridges.test_mqtt_settings import LAMP, plugged
from tests.e2e.test_processes import free_port

pytest.importorskip("aiomqtt")
pytest.importorskip("pymodbus")

from msbot_bridges.modbus.simulated import SimulatedLine

DIMMER = """
maker = "ACME"
product = "dimmer"
poll_s = 0.1
[[point]]
port = "brightness"
role = "in"
address = 7
unit = "%"
least = 0.0
most = 100.0
"""


@asynccontextmanager
async def line(address: str, table: Path) -> AsyncIterator[SimulatedLine]:
    """Simulated devices with Modbus, plugged in as long as the block."""
    made = SimulatedLine(read_address(address), [read_device_table(table)])
    task = asyncio.create_task(made.run())
    try:
        yield made
    finally:
        task.cancel()
        await asyncio.wait([task])


def register(made: SimulatedLine, address: int) -> int:
    return made._devices[0]._registers[RegisterTable.HOLDING, address]


def holds(robot: Robot, number: str, slot: str) -> bool:
    now = asyncio.get_running_loop().time()
    view = robot.master.inventory.view(now)
    return any((one.part_number, one.state, one.slot) == (number, PartState.ACTIVE, slot) for one in view)


async def described(robot: Robot, number: str) -> None:
    await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)


async def test_a_like_pump_with_modbus_gets_the_slot_with_its_settings(tmp_path: Path) -> None:
    links = [f"tcp:127.0.0.1:{free_port()}" for _ in range(2)]
    bridges = [BridgeTable("modbus", one, {"table": str(PUMP)}) for one in links]
    async with robot_with(tmp_path, bridges) as robot:
        async with line(links[0], PUMP) as first:
            await described(robot, "ACME:pump")
            await robot.do("adopt", who="ann", part="ACME:pump", slot="guest")
            await robot.until(lambda: holds(robot, "ACME:pump", "guest"))
            await robot.do("set", who="ann", slot="guest", name="ramp", value=5)
            await robot.until(lambda: register(first, 40) == 50)
        await robot.until(lambda: not holds(robot, "ACME:pump", "guest"))
        async with line(links[1], PUMP) as second:
            assert register(second, 40) == 20
            await robot.until(lambda: holds(robot, "ACME:pump", "guest") and register(second, 40) == 50)
            await robot.do("undo", who="ann", edit=None)
            await robot.until(lambda: register(second, 40) == 20)


async def test_a_like_module_of_jacdac_gets_the_slot_with_its_settings(tmp_path: Path) -> None:
    pytest.importorskip("websockets")
    offset = "bus.serviceProviders()[0].services()[1].offset.values()[0]"
    async with AsyncExitStack() as stack:
        plug = Plug("jacdac", "servo", tmp_path, stack)
        async with robot_with(tmp_path, [plug.bridge]) as robot:
            await plug.put_in()
            await described(robot, "jacdac:servo")
            await robot.do("adopt", who="ann", part="jacdac:servo", slot="guest")
            await robot.until(lambda: holds(robot, "jacdac:servo", "guest"))
            await robot.do("set", who="ann", slot="guest", name="angle_offset", value=5)
            await plug.until(offset, 5)
            await plug.remove()
            await robot.until(lambda: not holds(robot, "jacdac:servo", "guest"))
            await plug.add()
            await robot.until(lambda: holds(robot, "jacdac:servo", "guest"))
            await plug.until(offset, 5)
            await robot.do("undo", who="ann", edit=None)
            await plug.until(offset, 0)


@pytest.mark.parametrize("first", ["jacdac", "modbus"])
async def test_a_lamp_of_jacdac_and_a_dimmer_with_modbus_stand_by_for_each_other(first: str, tmp_path: Path) -> None:
    pytest.importorskip("websockets")
    table = tmp_path / "dimmer.toml"
    table.write_text(DIMMER)
    address = f"tcp:127.0.0.1:{free_port()}"
    numbers = {"jacdac": "jacdac:lamp", "modbus": "ACME:dimmer"}
    own, other = numbers.pop(first), *numbers.values()
    async with AsyncExitStack() as stack:
        plug = Plug("jacdac", "light bulb (dimmeable)", tmp_path, stack)
        bridges = [plug.bridge, BridgeTable("modbus", address, {"table": str(table)})]
        async with robot_with(tmp_path, bridges) as robot, AsyncExitStack() as dimmers:
            dimmer = await dimmers.enter_async_context(line(address, table))
            await plug.put_in()
            await described(robot, own)
            await described(robot, other)
            await robot.do("adopt", who="ann", part=own, slot="light")
            await robot.until(lambda: holds(robot, own, "light"))
            knob = {"topic": "dim", "type": "Level", "from": None, "to": ["light.brightness"]}
            await robot.do("bind", who="ann", **knob)
            await robot.do("spare", who="ann", slot="light", part=other, agreed=True)
            await robot.until(lambda: robot.is_in(other, PartState.STANDBY))
            if first == "jacdac":
                await plug.pull_out()
            else:
                await dimmers.aclose()
            await robot.until(lambda: holds(robot, other, "light"))
            await robot.do("publish", who="ann", port="light.brightness", values=["40"], seconds=60.0)
            if first == "jacdac":
                await robot.until(lambda: register(dimmer, 7) == 40)
            else:
                await plug.until("bus.serviceProviders()[0].services()[1].register(1).values()[0]", 0.4)
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: other in {one.part for one in robot.master.stop.confirmed})


async def test_a_dimmer_with_modbus_takes_the_slot_of_a_lamp_on_mqtt(tmp_path: Path) -> None:
    table = tmp_path / "dimmer.toml"
    limit = '[[point]]\nport = "limit"\nrole = "setting"\naddress = 9\nunit = "%"\nleast = 0.0\nmost = 100.0\n'
    table.write_text(DIMMER.replace("brightness", "lamp") + limit)
    address, other = f"tcp:127.0.0.1:{free_port()}", "ACME:dimmer"
    async with OwnBroker().running() as broker:
        bridges = [BridgeTable("modbus", address, {"table": str(table)})]
        bridges.append(BridgeTable("mqtt", f"mqtt://127.0.0.1:{broker.port}"))
        async with robot_with(tmp_path, bridges) as robot, line(address, table) as dimmer:
            async with plugged(broker.port, "1") as lamp:
                await described(robot, LAMP)
                await robot.do("adopt", who="ann", part=LAMP, slot="light")
                await robot.until(lambda: holds(robot, LAMP, "light"))
                wire = {"topic": "dim", "type": "Level", "from": None, "to": ["light.lamp"]}
                await robot.do("bind", who="ann", **wire)
                await robot.do("set", who="ann", slot="light", name="limit", value=70)
                await robot.until(lambda: lamp.limit == 70)
                await described(robot, other)
                with pytest.raises(ConfigError, match="lamp_state"):
                    await robot.do("spare", who="ann", slot="light", part=other, agreed=False)
                await robot.do("spare", who="ann", slot="light", part=other, agreed=True)
                await robot.until(lambda: robot.is_in(other, PartState.STANDBY))
            await robot.until(lambda: holds(robot, other, "light"))
            await robot.until(lambda: register(dimmer, 9) == 70)
            await robot.do("publish", who="ann", port="light.lamp", values=["40"], seconds=60.0)
            await robot.until(lambda: register(dimmer, 7) == 40)
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: other in {one.part for one in robot.master.stop.confirmed})
            assert register(dimmer, 7) == 0
