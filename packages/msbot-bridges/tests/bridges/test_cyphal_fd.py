"""Cyphal on CAN FD: nodes with the library's own way to a bus, and simulated ones on MsBOT's simulated bus."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.part.messages.standard import Angle
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.canbus import open_bus
from msbot_bridges.canopen.world import WORLD as CANOPEN
from msbot_bridges.cli.bridge_runner import RUNNER
from msbot_bridges.cyphal.world import WORLD
from msbot_xrce.errors import ConfigError
from tests.bridges.hosts import in_thread, running
from tests.bridges.test_cyphal import in_the_robot, living

pytest.importorskip("pycyphal")

import can


class Spy:
    """What is on a bus."""

    def __init__(self, address: str) -> None:
        self.frames = list[can.Message]()
        self.ended = threading.Event()
        self._address = address

    def run(self) -> None:
        with open_bus(self._address) as bus:
            while not self.ended.is_set():
                if (frame := bus.recv(0.1)) is not None:
                    self.frames.append(frame)


async def test_a_servo_on_a_bus_of_can_fd_is_driven_by_frames_of_can_fd() -> None:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

    address = f"msbot:{uuid4().hex[:12]}?fd=1&bitrate=500000&dbitrate=2000000"
    node, spy = SimulatedCyphalServo(address, 42), Spy(address)
    async with (
        in_thread(spy.run, spy.ended.set),
        running(WORLD.open(BridgeLink(address))) as host,
        living(node),
    ):
        servo, reports = await in_the_robot(await host.devices.get(), host)
        servo.act("angle", Angle(degrees=40))
        await reports.until(lambda last: abs(getattr(last.get("position"), "degrees", 0.0) - 40) < 0.5)
        servo.stop()
        await host.until(lambda: not servo.not_stopped)
    assert spy.frames
    assert all(frame.is_fd and frame.bitrate_switch for frame in spy.frames)
    assert max(len(frame.data) for frame in spy.frames) > 8, "answers fit into fewer frames"


@asynccontextmanager
async def genuine_node(channel: str) -> AsyncIterator[Any]:
    """A node with the library's own way to a bus; it reports a length."""
    import pycyphal.application
    import uavcan.primitive.array
    import uavcan.si.sample.length
    from pycyphal.application.register import Value
    from pycyphal.transport.can import CANTransport
    from pycyphal.transport.can.media.pythoncan import PythonCANMedia

    media = PythonCANMedia(f"virtual:{channel}", (500_000, 2_000_000))
    registry = pycyphal.application.make_registry(environment_variables={})
    registry.setdefault("uavcan.pub.distance.id", Value(natural16=uavcan.primitive.array.Natural16_1([2100])))
    info = pycyphal.application.NodeInfo(name="com.acme.eye", unique_id=list(range(16)))
    node = pycyphal.application.make_node(info, registry, transport=CANTransport(media, 17))
    publisher = node.make_publisher(uavcan.si.sample.length.Scalar_1_0, "distance")

    async def live() -> None:
        while True:
            publisher.publish_soon(uavcan.si.sample.length.Scalar_1_0(meter=1.25))
            await asyncio.sleep(0.1)

    node.start()
    living = asyncio.create_task(live())
    try:
        yield media
    finally:
        living.cancel()
        await asyncio.wait([living])
        node.close()


async def test_a_genuine_node_with_the_librarys_own_way_to_can_fd_is_found_and_heard() -> None:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    channel = uuid4().hex
    async with running(WORLD.open(BridgeLink(f"virtual:{channel}?fd=1"))) as host, genuine_node(channel) as media:
        assert (media.is_fd, media.mtu) == (True, 64)
        device = await host.devices.get()
        assert (device.identity.part_number, device.identity.unique) == ("com.acme:eye", bytes(range(16)))
        heard = asyncio.Queue[Any]()
        device.begin(lambda _port, message: heard.put_nowait(message))
        assert (await heard.get()).metres == 1.25


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("socketcan:can0?fd=2", "after [?] there may be bitrate=N .*; with fd=1, also dbitrate=N"),
        ("socketcan:can0?dbitrate=2000000", "; with fd=1, also dbitrate=N"),
    ],
)
def test_an_address_that_makes_no_sense_is_refused(address: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        WORLD.open(BridgeLink(address))


def test_devices_of_classic_can_are_on_no_bus_of_can_fd() -> None:
    with pytest.raises(ConfigError, match="the bridge for these devices is for classic CAN; leave fd out"):
        CANOPEN.open(BridgeLink("socketcan:can0?fd=1"))
    with pytest.raises(ConfigError, match=r"would destroy the CAN FD frames of cyphal; use a bus for each"):
        RUNNER.check([BridgeTable("cyphal", "msbot:x?fd=1"), BridgeTable("canopen", "msbot:x")])
