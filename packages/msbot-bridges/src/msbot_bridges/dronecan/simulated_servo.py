"""A simulated DroneCAN servo, a node of the library: it follows ArrayCommand, and reports its position."""

from __future__ import annotations

import asyncio
import hashlib
import threading
from typing import Any, Final

import dronecan
from dronecan import uavcan
from dronecan.driver.common import DriverError

import can
from msbot_bridges.canbus import open_bus
from msbot_bridges.dronecan.can_driver import PythonCanDriver
from msbot_xrce.errors import LinkDown

REPORT_S: Final = 0.1
SPIN_S: Final = 0.02
SPEED: Final = "profile_velocity"
"""A parameter: how quickly it turns, in turns a minute."""


class SimulatedServo:
    """The servo.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        node_id: where it is on its bus.
        actuator_id: by which commands name it; its node id unless given.
    """

    def __init__(self, address: str, node_id: int = 42, actuator_id: int | None = None) -> None:
        self.position = 0.0
        """In radians."""
        self.speed = 30
        self._target = 0.0
        self._address, self._node_id = address, node_id
        self._actuator_id = node_id if actuator_id is None else actuator_id
        self._ended = threading.Event()

    async def run(self) -> None:
        """See `SimulatedDevice`."""
        running = asyncio.create_task(asyncio.to_thread(self.run_in_thread))
        try:
            await asyncio.wait([running])
        finally:
            self.end()
            await asyncio.gather(running, return_exceptions=True)
        running.result()

    def end(self) -> None:
        """Pull it off its bus."""
        self._ended.set()

    def run_in_thread(self) -> None:
        """Run until `end`.

        Raises:
            LinkDown: the bus cannot be opened, or has ended.
        """
        info = uavcan.protocol.GetNodeInfo.Response()
        info.name = "org.msbot.simservo"
        info.software_version.major = 1
        info.hardware_version.unique_id = hashlib.sha256(b"SimServo %d" % self._node_id).digest()[:16]
        mode = uavcan.protocol.NodeStatus().MODE_OPERATIONAL
        driver = PythonCanDriver(open_bus(self._address))
        node = dronecan.node.Node(driver, self._node_id, node_info=info, mode=mode)
        node.add_handler(uavcan.equipment.actuator.ArrayCommand, self._ordered)
        node.add_handler(uavcan.protocol.param.GetSet, self._parameter)
        node.periodic(REPORT_S, lambda: self._live(node))
        try:
            while not self._ended.is_set():
                node.spin(SPIN_S)
        except (DriverError, can.CanError) as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            node.close()

    def _live(self, node: Any) -> None:  # noqa: ANN401 - the library has no types
        most = self.speed / 60 * 2 * 3.141592653589793 * REPORT_S
        self.position += max(-most, min(most, self._target - self.position))
        node.broadcast(uavcan.equipment.actuator.Status(actuator_id=self._actuator_id, position=self.position))

    def _ordered(self, event: Any) -> None:  # noqa: ANN401
        for command in event.message.commands:
            if command.actuator_id == self._actuator_id:
                self._target = command.command_value

    def _parameter(self, event: Any) -> Any:  # noqa: ANN401
        answer = uavcan.protocol.param.GetSet.Response()
        asked = event.request
        name = bytes(asked.name.to_bytes()).decode(errors="replace")
        if name == SPEED or (not name and asked.index == 0):
            if dronecan.get_active_union_field(asked.value) == "integer_value":
                self.speed = max(1, min(300, asked.value.integer_value))
            answer.name = SPEED
            answer.value.integer_value, answer.default_value.integer_value = self.speed, 30
            answer.min_value.integer_value, answer.max_value.integer_value = 1, 300
        return answer
