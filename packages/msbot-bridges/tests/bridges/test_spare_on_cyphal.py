"""A Cyphal servo stands by for the slot of a DroneCAN servo, each on a bus of its own, and takes over."""

from __future__ import annotations

from contextlib import AsyncExitStack
from pathlib import Path
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from tests.bridges.hosts import in_thread
from tests.bridges.test_cyphal import living
from tests.bridges.test_every_world import robot_with

pytest.importorskip("dronecan")
pytest.importorskip("pycyphal")

from msbot_bridges.dronecan.simulated_servo import SimulatedServo

MINE, OTHER = "org.msbot:simservo", "org.msbot:simcyphalservo"


async def test_a_cyphal_servo_takes_the_slot_of_a_dronecan_servo(tmp_path: Path) -> None:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

    buses = [f"msbot:{uuid4().hex[:12]}" for _ in range(2)]
    mine, other = SimulatedServo(buses[0]), SimulatedCyphalServo(buses[1], 44)
    bridges = [BridgeTable("dronecan", buses[0]), BridgeTable("cyphal", buses[1])]
    async with robot_with(tmp_path, bridges) as robot, AsyncExitStack() as pull:
        await pull.enter_async_context(in_thread(mine.run_in_thread, mine.end))
        await robot.until(lambda: (found := robot.part(MINE)) is not None and found.says is not None)
        await robot.do("adopt", who="ann", part=MINE, slot="arm")
        await robot.until(lambda: robot.is_in(MINE, PartState.ACTIVE))
        await robot.do("bind", who="ann", **{"topic": "where", "type": "Angle", "from": "arm.position", "to": []})
        await robot.do("set", who="ann", slot="arm", name="profile_velocity", value=90)
        async with living(other):
            await robot.until(lambda: (found := robot.part(OTHER)) is not None and found.says is not None)
            await robot.do("spare", who="ann", slot="arm", part=OTHER, agreed=True)
            await robot.until(lambda: robot.is_in(OTHER, PartState.STANDBY))
            await pull.aclose()
            await robot.until(lambda: other.restarts and robot.is_in(OTHER, PartState.ACTIVE))
            await robot.until(lambda: other.speed == 90)  # the slot's setting, by name
            await robot.do("publish", who="ann", port="arm.angle", values=["20"], seconds=60.0)
            await robot.until(lambda: abs(other.position - 0.349) < 0.01)
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: [one.part for one in robot.master.stop.confirmed] == [OTHER])
            assert other.readiness == 2
