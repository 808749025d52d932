"""Nodes of the genuine library, on a simulated bus: found, told, settings, STOP, subjects, node ids, loss."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Angle, Distance
from msbot_bridges.bridge import ForeignDevice
from tests.bridges.hosts import Host, Reports, running

pytest.importorskip("pycyphal")


@asynccontextmanager
async def living(node: Any) -> AsyncIterator[Callable[[], object]]:
    """A node on its bus; yields what pulls it off."""
    task = asyncio.create_task(node.run())
    try:
        yield task.cancel
    finally:
        task.cancel()
        await asyncio.wait([task])
    if not task.cancelled() and (error := task.exception()) is not None:
        raise error


@asynccontextmanager
async def plugged(kind: str, node_id: int = 42) -> AsyncIterator[tuple[Any, ForeignDevice, Host]]:
    """A simulated node, and the device that the bridge makes of it."""
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange
    from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

    bus = f"msbot:{uuid4().hex[:12]}"
    node: Any = {"range": SimulatedRange, "servo": SimulatedCyphalServo}[kind](bus, node_id)
    async with running(CyphalWorld(bus)) as host, living(node) as node.pull:
        yield node, await host.devices.get(), host


async def in_the_robot(device: ForeignDevice, host: Host) -> tuple[ForeignDevice, Reports]:
    """Take a new node in: it gets its subjects, restarts, and is found again."""
    reports = Reports()
    device.begin(reports)
    assert (await host.lost_why.get()).endswith("has started anew")
    device.end()
    again = await host.devices.get()
    again.begin(reports)
    return again, reports


async def test_a_range_finder_gets_subjects_and_is_heard_and_missed() -> None:
    async with plugged("range") as (node, device, host):
        assert device.identity.part_number == "org.msbot:simrange"
        assert device.identity.unique == node.unique_id
        assert [(one.name, one.message) for one in device.outputs] == [("distance", Distance)]
        assert [(one.name, one.default, one.least, one.most) for one in device.settings] == [
            ("ranging_reach", 4.0, 0.1, 8.0)
        ]
        assert int(node.node.registry["uavcan.pub.distance.id"]) == 65535, "a node in no robot is told nothing"
        again, reports = await in_the_robot(device, host)
        assert node.restarts == 1
        await reports.until(lambda last: 0.4 < getattr(last.get("distance"), "metres", 0.0) < 1.6)
        again.set("ranging_reach", 0.2)
        await reports.until(lambda last: last["distance"] == Distance(metres=0.0, in_range=False))
        assert math.isclose(node.reach, 0.2, rel_tol=1e-6)
        again.stop()
        assert again.not_stopped == "", "there is nothing to stop"
        node.node.heartbeat_publisher.health = 3
        await host.until(lambda: again.fault)
        assert again.fault == "node 42 says that its health is WARNING"
        node.node.heartbeat_publisher.health = 0
        await host.until(lambda: not again.fault)
        node.node.heartbeat_publisher.mode = 2
        await host.until(lambda: again.fault)
        assert again.fault == "node 42 is in maintenance"


async def test_a_servo_is_engaged_told_and_stopped() -> None:
    async with plugged("servo") as (node, device, host):
        servo, reports = await in_the_robot(device, host)
        assert [one.name for one in servo.inputs] == ["angle"]
        assert {one.name for one in servo.outputs} == {"position", "feedback"}
        servo.set("profile_velocity", 120)
        servo.act("angle", Angle(degrees=40))
        await reports.until(lambda last: abs(getattr(last.get("position"), "degrees", 0.0) - 40) < 0.5)
        assert node.speed == 120
        node.is_stuck = True
        servo.stop()
        assert servo.not_stopped == "node 42 has not reported that it is disengaged"
        reports.last.clear()
        await reports.until(lambda last: "feedback" in last)
        assert servo.not_stopped, "it is engaged still"
        node.is_stuck = False
        servo.stop()
        await host.until(lambda: not servo.not_stopped)
        assert node.readiness == 2


async def test_a_node_without_an_id_gets_one_and_is_missed() -> None:
    async with plugged("range", 0) as (node, device, host):
        assert node.node_id == 124, "the highest that is free"
        assert device.identity.where == "node 124"
        node.pull()
        assert await host.lost_why.get() == "node 124 has sent no heartbeat for 3 s"
