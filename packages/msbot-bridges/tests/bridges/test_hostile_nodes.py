"""What a hostile or broken node can do: beginnings without ends, another allocator, answers that are none."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from random import Random
from typing import Any
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Angle
from msbot_bridges.bridge import BridgeLink, worlds
from msbot_bridges.canbus import open_bus
from tests.bridges.hosts import Reports, in_thread, running
from tests.bridges.test_cyphal import in_the_robot, plugged

pytest.importorskip("canopen")
pytest.importorskip("dronecan")
pytest.importorskip("pycyphal")

import dronecan
from dronecan.app.dynamic_node_id import CentralizedServer
from dronecan.app.node_monitor import NodeMonitor

import can
from msbot_bridges.dronecan.bounded_transfers import MOST_FRAMES, MOST_S, MOST_TRANSFERS, BoundedTransfers
from msbot_bridges.dronecan.can_driver import PythonCanDriver
from msbot_bridges.dronecan.simulated_servo import SimulatedServo
from tests.bridges.test_dronecan_nodes import GenuineNode

START, MIDDLE = 0x80, 0x00


def frame(identifier: int, tail: int) -> Any:
    return dronecan.transport.Frame(identifier, bytes(7) + bytes([tail]))


def test_transfers_that_never_end_have_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    transfers = BoundedTransfers()
    for number in range(10 * MOST_TRANSFERS):
        assert transfers.receive_frame(frame(number << 8 | 5, START)) is None
    assert len(transfers.active_transfers) == len(transfers.active_transfer_timestamps) == MOST_TRANSFERS
    assert transfers.given_up == 9 * MOST_TRANSFERS
    clock[0] = MOST_S + 1
    transfers.receive_frame(frame(0x1234505, START))
    assert len(transfers.active_transfers) == 1
    for number in range(2 * MOST_FRAMES):
        transfers.receive_frame(frame(0x1234505, MIDDLE | (number % 2) << 5))
    assert not transfers.active_transfers, "it had no end"


def flood(bus: str, make: Callable[[Random], can.Message], ended: threading.Event) -> None:
    random = Random(1)
    with open_bus(bus) as sending:
        while not ended.wait(0.002):
            sending.send(make(random), timeout=10)


def beginning(random: Random) -> can.Message:
    """The first frame of a transfer of any node that never goes on."""
    identifier = random.getrandbits(29) & ~0x80 | 1
    return can.Message(arbitration_id=identifier, is_extended_id=True, data=random.randbytes(7) + b"\x80")


def seeming(random: Random) -> can.Message:
    """A NodeStatus of any other node: none answers."""
    identifier = 0x10015500 | random.choice([one for one in range(1, 128) if one not in (42, 126)])
    return can.Message(
        arbitration_id=identifier, is_extended_id=True, data=random.randbytes(7) + bytes([0xC0 | random.randrange(32)])
    )


def broken(random: Random) -> can.Message:
    """Frames of few transfers with wrong toggle bits, numbers and lengths: orders, states, questions of node 7."""
    identifier = random.choice((0x0803F207, 0x10015507, 0x1E0BAA87, 0x1E01AA87))
    data = random.randbytes(7) + bytes([random.choice((0x80, 0x00, 0x20, 0x40, 0x60, 0xC0))])
    return can.Message(arbitration_id=identifier, is_extended_id=True, data=data[random.choice((0, 0, 0, 5, 8)) :])


@pytest.mark.timeout(300)
@pytest.mark.parametrize("make", [beginning, seeming, broken])
@pytest.mark.promise("Nodes that flood a CAN bus with half transfers or node ids do not keep STOP from a device")
async def test_a_servo_is_stopped_beside_a_flood(make: Callable[[Random], can.Message]) -> None:
    bus, ended = f"msbot:{uuid4().hex[:12]}", threading.Event()
    servo = SimulatedServo(bus, 42)
    async with running(worlds()["dronecan"].open(BridgeLink(bus))) as host, in_thread(servo.run_in_thread, servo.end):
        device = await host.devices.get()
        reports = Reports()
        device.begin(reports)
        device.act("angle", Angle(degrees=30))
        await reports.until(lambda last: getattr(last.get("position"), "degrees", 0.0) > 29)
        async with in_thread(lambda: flood(bus, make, ended), ended.set):
            await asyncio.sleep(1.0)
            device.stop()
            await host.until(lambda: not device.not_stopped)
        assert abs(servo.position) < 0.06
        assert sum("cannot be read" in host.said.get_nowait() for _ in range(host.said.qsize())) <= 1, "it is said once"


def damaged(random: Random) -> can.Message:
    """Of Cyphal: heartbeats of nodes that do not answer, half transfers, wrong toggle bits, frames without data."""
    node = random.choice([one for one in range(1, 125) if one != 42])
    identifier = random.choice((0x107D5500, 0x10004500, 0x1067FE00, 0x0C7D2A00)) | node
    tail = random.choice((0xE0, 0x80, 0xA0, 0x00, 0x60, 0xC0)) | random.randrange(32)
    data = random.randbytes(7) + bytes([tail])
    return can.Message(arbitration_id=identifier, is_extended_id=True, data=data[random.choice((0, 0, 0, 5, 8)) :])


@pytest.mark.timeout(300)
@pytest.mark.promise("Nodes that flood a CAN bus with half transfers or node ids do not keep STOP from a device")
async def test_a_cyphal_servo_is_stopped_beside_a_flood() -> None:
    async with plugged("servo") as (node, device, host):
        servo, reports = await in_the_robot(device, host)
        ended = threading.Event()
        async with in_thread(lambda: flood(node._address, damaged, ended), ended.set):
            servo.act("angle", Angle(degrees=30))
            await reports.until(lambda last: getattr(last.get("position"), "degrees", 0.0) > 29)
            servo.stop()
            await host.until(lambda: not servo.not_stopped)
            assert node.readiness == 2
        said = [host.said.get_nowait() for _ in range(host.said.qsize())]
        assert len(said) == len(set(said)), "each is said once"


async def test_another_allocator_is_named_once_and_nodes_get_ids() -> None:
    bus = f"msbot:{uuid4().hex[:12]}"
    ended = threading.Event()

    def allocate() -> None:
        node = dronecan.node.Node(PythonCanDriver(open_bus(bus)), 120)
        server = CentralizedServer(node, NodeMonitor(node))
        while not ended.is_set():
            node.spin(0.02)
        server.close()
        node.close()

    async with running(worlds()["dronecan"].open(BridgeLink(bus))) as host, in_thread(allocate, ended.set):
        asking = GenuineNode(bus, "servo", None)
        async with in_thread(asking.run, asking.ended.set):
            while "node 120 gives node ids, too" not in (said := await host.said.get()):
                assert "cannot be read" in said, said  # two that answer at once may spoil a frame
            while not asking.node.node_id:  # noqa: ASYNC110 - it is in a thread
                await asyncio.sleep(0.05)
