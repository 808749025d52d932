"""Nodes of the genuine library, on a simulated bus: found, told, settings, STOP, subjects, node ids, loss."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.part.messages.standard import Angle, Distance
from msbot.pnp import PartState
from msbot_bridges.bridge import ForeignDevice
from msbot_xrce.errors import LinkDown
from tests.bridges.hosts import Host, Reports, running
from tests.bridges.test_every_world import robot_with

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
async def plugged(
    kind: str, node_id: int = 42, change: Callable[[Any], None] = lambda _: None
) -> AsyncIterator[tuple[Any, ForeignDevice, Host]]:
    """A simulated node, changed before it lives, and the device that the bridge makes of it."""
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange
    from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

    bus = f"msbot:{uuid4().hex[:12]}"
    node: Any = {"range": SimulatedRange, "servo": SimulatedCyphalServo}[kind](bus, node_id)
    change(node)
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


async def test_a_node_that_does_not_restart_is_named() -> None:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    import uavcan.node

    async def refuse(*_: object) -> object:
        return uavcan.node.ExecuteCommand_1_3.Response(status=3)

    async with plugged("range", change=lambda node: setattr(node, "_commanded", refuse)) as (node, device, host):
        device.begin(lambda _port, _message: None)
        await host.until(lambda: device.fault)
        assert device.fault == "node 42 has got subjects for its ports: switch it off and on"
        assert int(node.node.registry["uavcan.pub.distance.id"]) == 2048


async def test_a_node_that_does_not_answer_when_it_is_given_a_subject_is_given_it_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal import cyphal_bus
    from msbot_bridges.cyphal.register_access import RegisterAccess

    write, lost = RegisterAccess.write, list[str]()

    async def answer(self: Any, node_id: int, name: str, kind: str, value: Any) -> Any:
        if not lost:
            lost.append(name)
            return None
        return await write(self, node_id, name, kind, value)

    monkeypatch.setattr(cyphal_bus, "GIVE_AGAIN_S", 0.2)
    monkeypatch.setattr(RegisterAccess, "write", answer)
    async with plugged("range") as (node, device, host):
        device.begin(lambda _port, _message: None)
        await host.until(lambda: device.fault)
        words = "node 42 does not answer when it is given subject 2048 in uavcan.pub.distance.id"
        assert device.fault == words
        device.end()
        await host.until(lambda: not device.fault)
        await in_the_robot(device, host)
        assert int(node.node.registry["uavcan.pub.distance.id"]) == 2048


async def test_two_nodes_that_obey_one_subject_are_named() -> None:
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from pycyphal.application.register import Natural16, Value

    from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

    class Configured(SimulatedCyphalServo):
        """As somebody has set it up: all that are set up so obey the same subjects."""

        def set_up(self, node: Any) -> None:
            for number, name in enumerate(("sub.angle", "sub.readiness")):
                node.registry.setdefault(f"uavcan.{name}.id", Value(natural16=Natural16([100 + number])))
            for number, name in enumerate(("pub.feedback", "pub.position")):
                value = Value(natural16=Natural16([200 + 10 * self.node_id + number]))
                node.registry.setdefault(f"uavcan.{name}.id", value)
            super().set_up(node)

    bus = f"msbot:{uuid4().hex[:12]}"
    one, two = Configured(bus, 41), Configured(bus, 42)
    async with running(CyphalWorld(bus)) as host, living(one):
        first = await host.devices.get()
        reports = Reports()
        first.begin(reports)
        first.act("angle", Angle(degrees=0))
        await reports.until(lambda last: "position" in last)
        assert one.restarts == 0, "it has its subjects"
        async with living(two):
            second = await host.devices.get()
            assert await host.said.get() in {
                f"node 42 hears the orders to node 41: both have subject {subject}" for subject in (100, 101)
            }
            second.begin(lambda _port, _message: None)
            assert second.fault.startswith("nodes 42 and 41 both have subject 10")
            assert second.fault.endswith("of node 42 another, and restart it")
            assert not first.fault


async def test_orders_go_out_by_their_identifiers_and_a_bus_that_ends_is_told() -> None:
    import can
    from msbot_bridges.cyphal.can_media import PythonCanMedia
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from pycyphal.transport.can.media import DataFrame, Envelope, FilterConfiguration, FrameFormat

    may_end, may_send = threading.Event(), threading.Event()

    class Bus:
        channel_info = "a bus"
        sent: ClassVar[list[int]] = []

        def recv(self, timeout: float | None = None) -> can.Message | None:
            if timeout and may_end.wait(timeout):
                raise can.CanOperationError("the adapter is gone")
            return None

        def send(self, message: can.Message, timeout: float | None = None) -> None:
            may_send.wait()
            self.sent.append(message.arbitration_id)

    ended = asyncio.get_running_loop().create_future()
    media = PythonCanMedia(Bus(), ended.set_result)  # type: ignore[arg-type]  # it has what is used
    media.configure_acceptance_filters([FilterConfiguration.new_promiscuous()])
    media.start(lambda _: None, False)

    async def send(identifier: int) -> None:
        frame = DataFrame(FrameFormat.EXTENDED, identifier, bytearray(b"x"))
        assert await media.send([Envelope(frame, loopback=False)], time.monotonic() + 60) == 1

    await send(5)
    for identifier in (9, 7, 1, 7):
        await send(identifier)
    may_send.set()
    may_end.set()
    assert str(await ended) == "the adapter is gone"
    media.close()
    await media.closed()
    assert Bus.sent[-4:] in ([1, 7, 7, 9], [5, 7, 7, 9]), Bus.sent
    assert Bus.sent[:1] in ([5], [1]), "the first may be on its way already"


async def test_a_bus_that_is_fuller_than_the_loop_can_hear_loses_frames_and_does_not_grow() -> None:
    import can
    from msbot_bridges.cyphal.can_media import MOST_HEARD, MOST_UNHEARD, PythonCanMedia
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from pycyphal.transport.can.media import FilterConfiguration

    class FullBus:
        channel_info = "a bus"

        def recv(self, timeout: float | None = None) -> can.Message:
            return can.Message(arbitration_id=5, data=b"x")

    heard = list[int]()
    media = PythonCanMedia(FullBus())  # type: ignore[arg-type]  # it has what is used
    media.configure_acceptance_filters([FilterConfiguration.new_promiscuous()])
    media.start(lambda received: heard.append(len(received)), False)
    while not media.lost:
        time.sleep(0.001)  # noqa: ASYNC251 - the loop is busy with something else
    assert not heard
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert heard[:MOST_UNHEARD] == [MOST_HEARD] * MOST_UNHEARD
    media.close()
    await media.closed()


async def test_another_bridge_on_the_bus_is_named() -> None:
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld

    bus = f"msbot:{uuid4().hex[:12]}"
    # Two with one number may also send at the same time, until a controller leaves the bus: that ends its bridge.
    with suppress(LinkDown):
        async with running(CyphalWorld(bus)) as host, running(CyphalWorld(bus)):
            words = await host.said.get()
    assert "somebody else on this bus is node 125" in words


def has_reach(node: Any, reach: float) -> bool:
    return bool(node.node is not None and node.reach == reach)


async def test_settings_reach_the_device_survive_a_swap_and_are_undone(tmp_path: Path) -> None:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange

    number, bus = "org.msbot:simrange", f"msbot:{uuid4().hex[:12]}"
    first, other = SimulatedRange(bus, 42, 1), SimulatedRange(bus, 42, 2)
    async with robot_with(tmp_path, [BridgeTable("cyphal", bus)]) as robot:
        async with living(first):
            await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
            await robot.do("adopt", who="ann", part=number, slot="guest")
            await robot.until(lambda: first.restarts and robot.is_in(number, PartState.ACTIVE))
            for reach in (2.5, 3.5):
                await robot.do("set", who="ann", slot="guest", name="ranging_reach", value=reach)
                await robot.until(partial(has_reach, first, reach))
            with pytest.raises(ValueError, match="8"):
                await robot.do("set", who="ann", slot="guest", name="ranging_reach", value=80)
            await robot.do("undo", who="ann")
            await robot.until(partial(has_reach, first, 2.5))
        await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))
        async with living(other):
            await robot.until(lambda: other.restarts and has_reach(other, 2.5))
