"""A servo that the genuine library simulates, on a simulated bus: found, told, its STOP confirmed by its own report."""

from __future__ import annotations

import asyncio
import threading
from typing import Any
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Angle
from msbot_bridges.bridge import ForeignDevice

dronecan = pytest.importorskip("dronecan")


class Servo:
    """A node of the genuine library, in a thread."""

    def __init__(self, bus: str) -> None:
        from msbot_bridges.canbus import open_bus
        from msbot_bridges.dronecan.can_driver import PythonCanDriver

        uavcan = dronecan.uavcan
        info = uavcan.protocol.GetNodeInfo.Response()
        info.name = "com.acme.servo"
        info.hardware_version.unique_id = bytes(range(16))
        self.position, self.speed, self.ended = 0.5, 30, threading.Event()
        self.node = dronecan.node.Node(PythonCanDriver(open_bus(bus)), 42, node_info=info, mode=0)
        self.node.add_handler(uavcan.equipment.actuator.ArrayCommand, self._ordered)
        self.node.add_handler(uavcan.protocol.param.GetSet, self._parameter)
        self.node.periodic(0.05, self._report)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def _spin(self) -> None:
        while not self.ended.is_set():
            self.node.spin(0.02)
        self.node.close()

    def _report(self) -> None:
        self.node.broadcast(dronecan.uavcan.equipment.actuator.Status(actuator_id=3, position=self.position))

    def _ordered(self, event: Any) -> None:
        for command in event.message.commands:
            self.position = command.command_value

    def _parameter(self, event: Any) -> Any:
        answer = dronecan.uavcan.protocol.param.GetSet.Response()
        if event.request.index == 0:
            if dronecan.get_active_union_field(event.request.value) == "integer_value":
                self.speed = event.request.value.integer_value
            answer.name = "SPEED"
            answer.value.integer_value, answer.default_value.integer_value = self.speed, 30
            answer.min_value.integer_value, answer.max_value.integer_value = 1, 90
        return answer


class Host:
    def __init__(self) -> None:
        self.devices = asyncio.Queue[ForeignDevice]()
        self.lost_why = asyncio.Queue[str]()
        self.warned = asyncio.Queue[str]()
        self.told = asyncio.Event()

    def found(self, device: ForeignDevice) -> None:
        self.devices.put_nowait(device)

    def lost(self, device: ForeignDevice, why: str) -> None:
        self.lost_why.put_nowait(why)

    def explain(self, device: ForeignDevice, why: str) -> None:
        self.lost_why.put_nowait(why)

    def news(self, device: ForeignDevice) -> None:
        self.told.set()

    def warn(self, device: ForeignDevice, words: str) -> None:
        self.warned.put_nowait(words)

    def say(self, words: str) -> None:
        pass


async def test_a_genuine_servo_is_found_told_stopped_and_missed() -> None:
    from msbot_bridges.dronecan.dronecan_world import DronecanWorld

    bus = f"msbot:{uuid4().hex[:12]}"
    host, world = Host(), DronecanWorld(bus)
    running = asyncio.create_task(world.run(host))
    servo = await asyncio.to_thread(Servo, bus)
    try:
        async with asyncio.timeout(60):
            device = await host.devices.get()
            assert device.identity.part_number == "com.acme:servo"
            assert device.identity.unique == bytes(range(16))
            assert [(one.name, one.default, one.least, one.most) for one in device.settings] == [("SPEED", 30, 1, 90)]
            assert servo.position == 0.5, "nothing was told to a device that is in no robot"
            positions = asyncio.Queue[float]()
            device.set("SPEED", 55)
            device.begin(lambda _port, message: positions.put_nowait(message.degrees))  # type: ignore[attr-defined]  # an Angle
            device.act("angle", Angle(degrees=40))
            while abs(await positions.get() - 40) > 0.5:
                pass
            assert servo.speed == 55
            device.stop()
            assert device.not_stopped == "node 42 has not reported its neutral position"
            await host.told.wait()
            assert device.not_stopped == ""
            assert servo.position == 0.0
            servo.ended.set()
            assert await host.lost_why.get() == "node 42 has sent no NodeStatus for 3 s"
    finally:
        servo.ended.set()
        await asyncio.to_thread(servo.thread.join)
        running.cancel()
        await asyncio.wait([running])


async def test_the_allocator_forgets_nodes_that_are_gone_when_it_has_no_ids_left() -> None:
    from dronecan.app.node_monitor import NodeMonitor

    from msbot_bridges.canbus import open_bus
    from msbot_bridges.dronecan.can_driver import PythonCanDriver
    from msbot_bridges.dronecan.node_ids import NodeIdAllocator

    bus = f"msbot:{uuid4().hex[:12]}"

    def allocate() -> tuple[list[int], list[int], set[int]]:
        node = dronecan.node.Node(PythonCanDriver(open_bus(bus)), 126)
        try:
            allocator = NodeIdAllocator(node, NodeMonitor(node), 1, 6)
            for node_id in range(2, 7):
                allocator._allocation_table.set(bytes([node_id] * 16), node_id)
            table = allocator._allocation_table
            return allocator.make_room(), allocator.make_room(), {node_id for _, node_id in table.get_entries()}
        finally:
            node.close()

    first, again, left = await asyncio.to_thread(allocate)
    assert len(first) == 2
    assert again == [], "only as many as are needed"
    assert left == {126, 2, 3, 4, 5, 6} - set(first)
