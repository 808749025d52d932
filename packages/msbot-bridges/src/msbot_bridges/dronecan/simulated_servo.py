"""A simulated DroneCAN servo, a node of the library: it follows ArrayCommand, and reports its position.

It restarts when it is told to, and takes new software: an image that begins with `SIMSERVO 1.1`, say, and whatever
octets follow. From any other image it starts again with the software that it had.
"""

from __future__ import annotations

import hashlib
import logging
import math
import re
from typing import Any, Final

import dronecan
from dronecan import uavcan
from dronecan.driver.common import DriverError

import can
from msbot_bridges.bridge import ThreadedDevice
from msbot_bridges.canbus import open_bus
from msbot_bridges.canbus.image_folder import MOST_OCTETS
from msbot_bridges.dronecan.can_driver import PythonCanDriver
from msbot_bridges.dronecan.transfer_reader import TransferReader
from msbot_xrce.errors import LinkDown

REPORT_S: Final = 0.1
SPIN_S: Final = 0.02
SPEED: Final = "profile_velocity"
"""A parameter: how quickly it turns, in turns a minute."""
_IMAGE: Final = re.compile(rb"SIMSERVO (\d{1,2})\.(\d{1,2})\b")
_READ_TIMES: Final = 5
_PIECE: Final = 256
_log = logging.getLogger("msbot.part")


class SimulatedServo(ThreadedDevice):
    """The servo.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        node_id: where it is on its bus.
        actuator_id: by which commands name it; its node id unless given.
    """

    def __init__(self, address: str, node_id: int = 42, actuator_id: int | None = None) -> None:
        super().__init__()
        self.position = 0.0
        """In radians."""
        self.speed = 30
        self._target = 0.0
        self._address, self._node_id = address, node_id
        self._actuator_id = node_id if actuator_id is None else actuator_id
        self.software = (1, 0)
        self._restarts = self._is_updating = False

    def run_in_thread(self) -> None:
        """Run until `end`.

        Raises:
            LinkDown: the bus cannot be opened, or has ended.
        """
        while not self._ended.is_set():
            self._restarts = False
            self._is_updating = False
            self._run_once()

    def _run_once(self) -> None:
        info = uavcan.protocol.GetNodeInfo.Response()
        info.name = "org.msbot.simservo"
        info.software_version.major, info.software_version.minor = self.software
        info.hardware_version.unique_id = hashlib.sha256(b"SimServo %d" % self._node_id).digest()[:16]
        mode = uavcan.protocol.NodeStatus().MODE_OPERATIONAL
        driver = PythonCanDriver(open_bus(self._address))
        node = self._node = dronecan.node.Node(driver, self._node_id, node_info=info, mode=mode)
        node.add_handler(uavcan.equipment.actuator.ArrayCommand, self._ordered)
        node.add_handler(uavcan.protocol.param.GetSet, self._parameter)
        node.add_handler(uavcan.protocol.RestartNode, self._told_to_restart)
        node.add_handler(uavcan.protocol.file.BeginFirmwareUpdate, self._told_to_update)
        node.periodic(REPORT_S, lambda: self._live(node))
        reader = TransferReader(node, self._address, lambda words: _log.warning("%s: %s", self._address, words))
        try:
            while not (self._ended.is_set() or self._restarts):
                reader.spin(SPIN_S)
        except (DriverError, can.CanError) as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            node.close()

    def _live(self, node: Any) -> None:  # noqa: ANN401 - the library has no types
        if self._is_updating:
            return
        most = self.speed / 60 * 2 * math.pi * REPORT_S
        self.position += max(-most, min(most, self._target - self.position))
        node.broadcast(uavcan.equipment.actuator.Status(actuator_id=self._actuator_id, position=self.position))

    def _ordered(self, event: Any) -> None:  # noqa: ANN401
        for command in event.message.commands:
            if command.actuator_id == self._actuator_id and math.isfinite(command.command_value):
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

    def _told_to_restart(self, event: Any) -> Any:  # noqa: ANN401
        is_meant = event.request.magic_number == event.request.MAGIC_NUMBER
        if is_meant:
            self._node.defer(SPIN_S, self._restart)
        return uavcan.protocol.RestartNode.Response(ok=is_meant)

    def _restart(self) -> None:
        self._restarts = True

    def _told_to_update(self, event: Any) -> Any:  # noqa: ANN401
        answer = uavcan.protocol.file.BeginFirmwareUpdate.Response()
        if self._is_updating:
            answer.error = answer.ERROR_IN_PROGRESS
            return answer
        self._is_updating = True
        self._node.mode = uavcan.protocol.NodeStatus().MODE_SOFTWARE_UPDATE
        server = event.request.source_node_id or event.transfer.source_node_id
        self._read_image(server, event.request.image_file_remote_path, b"", _READ_TIMES)
        return answer

    def _read_image(self, server: int, path: Any, image: bytes, times: int) -> None:  # noqa: ANN401
        """Ask for the next piece; a piece that is not full is the last."""

        def answered(event: Any) -> None:  # noqa: ANN401
            if event is None and times > 1:
                self._read_image(server, path, image, times - 1)
                return
            if event is None or event.response.error.value:
                self._restart()
                return
            piece = bytes(event.response.data.to_bytes())
            if len(piece) == _PIECE and len(image) < MOST_OCTETS:
                self._read_image(server, path, image + piece, _READ_TIMES)
                return
            if (found := _IMAGE.match(image + piece)) is not None:
                self.software = int(found[1]), int(found[2])
            self._restart()

        self._node.request(uavcan.protocol.file.Read.Request(offset=len(image), path=path), server, answered)
