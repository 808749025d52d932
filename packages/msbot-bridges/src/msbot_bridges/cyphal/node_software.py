"""Gives nodes new software: the file server of a bus (`uavcan.file.Read`), for one image and one node at a time.

A node is told to begin, and by which name to ask (`uavcan.node.ExecuteCommand`); it reads the image piece by piece,
mostly from its boot loader, and starts again.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final

import pycyphal.application
import uavcan.file
import uavcan.primitive

from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.canbus.software_update import SoftwareUpdate, SoftwareVersion
from msbot_bridges.cyphal.register_access import BEGIN_SOFTWARE_UPDATE, RegisterAccess
from msbot_xrce.errors import ConfigError

Read: Final = uavcan.file.Read_1
GetInfo: Final = uavcan.file.GetInfo_0
MODE_SOFTWARE_UPDATE: Final = 3
_WARNING: Final = 3
_REFUSALS: Final = {
    1: "it cannot begin",
    2: "it does not allow it",
    3: "it knows no such command",
    4: "it does not take that name",
    5: "it cannot in the state that it is in",
    6: "it has an error",
}
_OTHER: Final = 0xFF
"""An answer whose words say why."""


class CyphalSoftware:
    """See the module's docstring.

    No path of a node leads elsewhere than to the octets of that image, which were read before.

    Args:
        node: the bridge's own.
        registers: the way to commands of nodes.
        images: what there is to take.
        say: takes a line for the person who runs the bridge.
    """

    def __init__(
        self,
        node: pycyphal.application.Node,
        registers: RegisterAccess,
        images: ImageFolder,
        say: Callable[[str], None],
    ) -> None:
        self.images = images
        self._registers, self._say = registers, say
        self._update: SoftwareUpdate | None = None
        self._ended: Callable[[str], None] = lambda _: None
        node.get_server(Read).serve_in_background(self._read)
        node.get_server(GetInfo).serve_in_background(self._tell_size)

    async def begin(
        self, node_id: int, unique: bytes, name: str, *, before: SoftwareVersion, ended: Callable[[str], None]
    ) -> None:
        """Give a node new software.

        Args:
            node_id: where it is.
            unique: its unique id.
            name: the image.
            before: the software that it has.
            ended: called with how it has ended.
        """
        if self._update is not None:
            ended(f"node {node_id} was not told to take {name}: {self._update.state}; try it again afterwards")
            return
        try:
            octets = await asyncio.to_thread(self.images.read, name)
        except ConfigError as error:
            ended(str(error))
            return
        if self._update is not None:  # while the image was read
            ended(f"node {node_id} was not told to take {name}: {self._update.state}; try it again afterwards")
            return
        update = SoftwareUpdate(f"node {node_id}", unique, name, octets, before=before, now=self._now())
        self._update, self._ended = update, ended
        self._say(f"node {node_id} takes {name}, {len(octets):,} octets; it runs software {before}")
        answer = await self._registers.ask_command(node_id, BEGIN_SOFTWARE_UPDATE, name)
        if answer is None:
            update.answered(None, "", self._now())
        else:
            status = int(answer.status)
            words = bytes(answer.output).decode(errors="replace") or _REFUSALS.get(status, f"status {status}")
            update.answered(_OTHER if status else 0, words, self._now())
        self.look()

    def state_of(self, unique: bytes) -> str:
        """That a node takes new software, as a sentence; empty: it does not."""
        update = self._update
        return update.state if update is not None and update.unique == unique else ""

    def reports(self, unique: bytes, health: int, mode: int) -> None:
        """A node has sent its heartbeat, and it is known who it is."""
        if self._update is not None and self._update.unique == unique and mode == MODE_SOFTWARE_UPDATE:
            self._update.reports(is_ill=health >= _WARNING)

    def runs(self, unique: bytes, version: SoftwareVersion) -> str:
        """A node has started again, and is no longer in its boot loader: how it got its software; empty: it did not."""
        update = self._update
        if update is None or update.unique != unique:
            return ""
        update.runs(version)
        self.look()
        return update.outcome

    def look(self) -> None:
        """End what takes too long, or has come to its end; called now and then."""
        update = self._update
        if update is None:
            return
        update.look(self._now())
        if update.outcome:
            self._update = None
            self._ended(update.outcome)

    @staticmethod
    def _now() -> float:
        return asyncio.get_running_loop().time()

    async def _read(self, request: Any, _: object) -> Any:  # noqa: ANN401 - the library makes its classes when it runs
        update = self._update
        if update is None or _path(request.path) != update.name:
            return Read.Response(error=uavcan.file.Error_1(uavcan.file.Error_1.NOT_FOUND))
        piece = update.read(int(request.offset), self._now())
        return Read.Response(data=uavcan.primitive.Unstructured_1(list(piece)))

    async def _tell_size(self, request: Any, _: object) -> Any:  # noqa: ANN401
        update = self._update
        if update is None or _path(request.path) != update.name:
            return GetInfo.Response(error=uavcan.file.Error_1(uavcan.file.Error_1.NOT_FOUND))
        return GetInfo.Response(size=update.octets, is_file_not_directory=True, is_readable=True)


def version_of(info: Any) -> SoftwareVersion:  # noqa: ANN401
    """What a node says of its software, in its GetInfo."""
    crc = [int(one) for one in info.software_image_crc]
    software = info.software_version
    return SoftwareVersion(
        int(software.major), int(software.minor), int(info.software_vcs_revision_id), crc[0] if crc else 0
    )


def _path(path: Any) -> str:  # noqa: ANN401
    return bytes(path.path).decode(errors="replace")
