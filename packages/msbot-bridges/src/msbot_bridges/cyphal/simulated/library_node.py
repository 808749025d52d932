"""What simulated devices have in common: a node of the library, its registers, its restart, its new software.

It takes an image that begins with `SIMULATED 1.1`, say, and whatever octets follow. From any other image it starts
again with the software that it had.
"""

from __future__ import annotations

import asyncio
import hashlib
import re
import tempfile
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Final

import pycyphal.application
import pycyphal.application.file
import uavcan.node
import uavcan.primitive.array
from pycyphal.application.plug_and_play import Allocatee
from pycyphal.application.register import Value
from pycyphal.transport.can import CANTransport

import can
from msbot_bridges.canbus import is_fd, open_bus
from msbot_bridges.canbus.image_folder import MOST_OCTETS
from msbot_bridges.cyphal.can_media import PythonCanMedia
from msbot_xrce.errors import LinkDown

PERIOD_S: Final = 0.1
LOOK_S: Final = 0.05
_IMAGE: Final = re.compile(rb"SIMULATED (\d{1,2})\.(\d{1,2})\b")
Command = uavcan.node.ExecuteCommand_1_3


class LibraryNode(ABC):
    """One device; its registers survive a restart, as long as it runs.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can; with `fd=1` on CAN FD.
        node_id: where it is on its bus; 0: it asks for a node id.
        number: of this one, of those that are of one kind.
    """

    product = ""

    def __init__(self, address: str, node_id: int, number: int | None = None) -> None:
        self._address, self.node_id = address, node_id
        self.unique_id = hashlib.sha256(f"{self.product} {node_id if number is None else number}".encode()).digest()[
            :16
        ]
        self.restarts = 0
        self.software = (1, 0)
        self._updating: asyncio.Task[None] | None = None
        self.node: Any = None
        self._again = asyncio.Event()
        self._failure: Exception | None = None

    @abstractmethod
    def set_up(self, node: Any) -> None:  # noqa: ANN401 - the library's own
        """Make registers and ports."""

    @abstractmethod
    def live(self) -> None:
        """Do what it does ten times a second."""

    async def run(self) -> None:
        """Run until cancelled.

        Raises:
            LinkDown: the bus cannot be opened, or has ended.
        """
        bus = await asyncio.to_thread(open_bus, self._address)
        try:
            with tempfile.TemporaryDirectory(prefix="msbot-cyphal-") as folder:
                if not self.node_id:
                    self.node_id = await self._ask_for_id(bus)
                while True:
                    self._again.clear()
                    await self._run_once(bus, Path(folder) / "registers.db")
                    self.restarts += 1
        finally:
            await asyncio.to_thread(bus.shutdown)

    async def _run_once(self, bus: can.BusABC, registers: Path) -> None:
        media = PythonCanMedia(bus, self._failed, fd=is_fd(self._address))
        registry = await asyncio.to_thread(pycyphal.application.make_registry, registers, {})
        info = pycyphal.application.NodeInfo(
            name=f"org.msbot.{self.product}",
            unique_id=list(self.unique_id),
            software_version=uavcan.node.Version_1(*self.software),
        )
        transport = CANTransport(media, self.node_id)
        self.node = pycyphal.application.make_node(info, registry, transport=transport)
        try:
            self.node.get_server(Command).serve_in_background(self._commanded)
            self.set_up(self.node)
            self.node.start()
            while not self._again.is_set():
                if self._updating is None:
                    self.live()
                await asyncio.sleep(PERIOD_S)
                self._check_bus()
        finally:
            if self._updating is not None:
                self._updating.cancel()
                self._updating = None
            self.node.close()
            self.node = None  # until it has started again
            await media.closed()

    async def _take_image(self, server: int, path: str) -> None:
        """Read an image, as a boot loader does, and start again."""
        self.node.heartbeat_publisher.mode = uavcan.node.Mode_1.SOFTWARE_UPDATE
        try:
            image = await pycyphal.application.file.FileClient2(self.node, server).read(path, size=MOST_OCTETS)
        except (OSError, pycyphal.application.file.RemoteFileError):
            image = b""
        if (found := _IMAGE.match(image)) is not None:
            self.software = int(found[1]), int(found[2])
        self._again.set()

    async def _ask_for_id(self, bus: can.BusABC) -> int:
        media = PythonCanMedia(bus, self._failed, fd=is_fd(self._address))
        transport = CANTransport(media, None)
        asking = Allocatee(transport, self.unique_id)
        try:
            while (given := asking.get_result()) is None:
                await asyncio.sleep(LOOK_S)
                self._check_bus()
        finally:
            asking.close()
            transport.close()
            await media.closed()
        return int(given)

    def _check_bus(self) -> None:
        if self._failure is not None:
            raise LinkDown(f"{self._address}: {self._failure}") from self._failure

    def _failed(self, error: Exception) -> None:
        self._failure = error

    async def _commanded(self, request: Any, asked: Any) -> Any:  # noqa: ANN401
        answer = Command.Response()
        if request.command == Command.Request.COMMAND_BEGIN_SOFTWARE_UPDATE:
            if self._updating is not None:
                answer.status = answer.STATUS_BAD_STATE
            else:
                path = bytes(request.parameter).decode(errors="replace")
                self._updating = asyncio.create_task(self._take_image(asked.client_node_id, path))
        elif request.command == Command.Request.COMMAND_RESTART:
            asyncio.get_running_loop().call_later(LOOK_S, self._again.set)  # the answer is still to go out
        elif request.command not in (Command.Request.COMMAND_STORE_PERSISTENT_STATES, Command.Request.COMMAND_IDENTIFY):
            answer.status = answer.STATUS_BAD_COMMAND
        return answer

    def setting(self, name: str, kind: str, first: float, least: float, most: float) -> None:
        """Have a register with a range."""

        def value(number: float) -> Value:
            inside = getattr(uavcan.primitive.array, f"{kind.capitalize()}_1")
            return Value(**{kind: inside([number])})

        self.node.registry.setdefault(name, value(first))
        for mark, number in (("<", most), (">", least), ("=", first)):
            self.node.registry[name + mark] = lambda number=number: value(number)

    def port(self, make: Any, kind: Any, name: str) -> Any:  # noqa: ANN401
        """A publisher or subscriber; None: it has no subject yet."""
        try:
            return make(kind, name)
        except pycyphal.application.PortNotConfiguredError:
            return None
