"""A node id is taken over by another device before the one that had it is missed."""

from __future__ import annotations

import asyncio
from pathlib import Path
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from msbot_bridges.canbus import Heartbeats
from tests.bridges.hosts import Reports, in_thread, running
from tests.bridges.test_cyphal import living
from tests.bridges.test_every_world import robot_with

OLDER_S = 1000
"""So much longer than the other one the device that takes over has run: no restart is seen."""


def test_heartbeats_that_go_on_are_of_one_device() -> None:
    beats = Heartbeats()
    for second in range(50):
        assert beats.fits(100 + second, second % 32, float(second))
    assert not beats.fits(1150, 18, 50.0), "it has run for longer"
    assert beats.fits(1151, 19, 51.0)
    assert not beats.fits(1152, 21, 52.0), "a transfer is missing"
    assert not beats.fits(1153, 22, 53.9), "it was silent"
    assert beats.fits(1154, 23, 54.6)


def test_two_that_were_switched_on_together_differ_by_the_gap() -> None:
    beats = Heartbeats()
    for second in range(5):
        assert beats.fits(second, second, float(second))
    assert not beats.fits(6, 6, 6.3)
    late = Heartbeats()
    assert [late.fits(n, n, n + jitter) for n, jitter in enumerate((0.0, 0.1, 0.0, 0.2, 0.1))] == [True] * 5


@pytest.mark.parametrize("older_s", [0, OLDER_S])
async def test_another_cyphal_device_is_another_part(older_s: int) -> None:
    pytest.importorskip("pycyphal")
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange
    from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

    class Older(SimulatedCyphalServo):
        is_older = False

        def live(self) -> None:
            if not self.is_older:  # before its first heartbeat
                self.is_older = True
                self.node.heartbeat_publisher._started_at -= older_s
            super().live()

    bus = f"msbot:{uuid4().hex[:12]}"
    one, other = SimulatedRange(bus, 42), Older(bus, 42)
    async with running(CyphalWorld(bus)) as host:
        async with living(one):
            device = await host.devices.get()
            reports = Reports()
            device.begin(reports)
            await host.lost_why.get()
            device = await host.devices.get()
            device.begin(reports)
            await reports.until(lambda last: "distance" in last)
            while one.node.heartbeat_publisher.uptime < 2:  # noqa: ASYNC110 - the library counts it
                await asyncio.sleep(0.05)
        async with living(other):
            why = await host.lost_why.get()
            assert why == ("node 42 is another device now" if older_s else "node 42 has started anew")
            taker = await host.devices.get()
            assert (taker.identity.part_number, taker.identity.unique) == ("org.msbot:simcyphalservo", other.unique_id)
            assert taker.identity.uid != device.identity.uid


@pytest.mark.parametrize("older_s", [0, OLDER_S])
async def test_another_dronecan_device_is_another_part_and_not_in_the_slot(older_s: int, tmp_path: Path) -> None:
    pytest.importorskip("dronecan")
    from msbot_bridges.dronecan.simulated_servo import SimulatedServo
    from tests.bridges.test_dronecan_nodes import GenuineNode

    bus = f"msbot:{uuid4().hex[:12]}"
    servo, number = SimulatedServo(bus, 42), "org.msbot:simservo"
    async with robot_with(tmp_path, [BridgeTable("dronecan", bus)]) as robot:
        async with in_thread(servo.run_in_thread, servo.end):
            await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
            await robot.do("adopt", who="ann", part=number, slot="guest")
            await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            await robot.do("publish", who="ann", port="guest.angle", values=["20"], seconds=60.0)
            await robot.until(lambda: abs(servo.position - 0.349) < 0.01)
        taker = GenuineNode(bus, "esc", 42)
        taker.node.start_time_monotonic -= older_s
        async with in_thread(taker.run, taker.ended.set):
            await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))
            words = "node 42 is another device now"
            assert any(words in line for line in robot.master.why(number)), robot.master.why(number)
            await robot.until(lambda: robot.part("com.acme:esc") is not None)
            found = robot.part("com.acme:esc")
            assert found is not None
            assert found.slot is None
            assert taker.raw_commands == 0, "it is in no robot"
