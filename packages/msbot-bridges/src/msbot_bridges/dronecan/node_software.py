"""Restarts nodes and gives them new software: the file server of a bus, in the thread of its world."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any, Final

from dronecan import uavcan

from msbot_bridges.canbus.software_update import SoftwareUpdate, SoftwareVersion

BEGIN_TIMES: Final = 3
"""So often a node that does not answer is told to take new software."""
LOOK_S: Final = 1.0
_log = logging.getLogger("msbot.part")


class NodeSoftware:
    """See the module's docstring.

    It serves one image at a time, and only to the node that was told to take it: no path of a node leads elsewhere.

    Args:
        node: the bridge's own.
        serves: there are images to take.
        say: takes a line for the person who runs the bridge.
    """

    def __init__(self, node: Any, say: Callable[[str], None], *, serves: bool) -> None:  # noqa: ANN401
        self._node, self._say = node, say
        self._update: SoftwareUpdate | None = None
        self._first: object = None
        self._ended: Callable[[str], None] = lambda _: None
        if serves:
            node.add_handler(uavcan.protocol.file.Read, self._read)
            node.add_handler(uavcan.protocol.file.GetInfo, self._tell_size)
            node.periodic(LOOK_S, self._look)

    def restart(self, node_id: int) -> None:
        """Tell a node to restart."""

        def answered(event: Any) -> None:  # noqa: ANN401
            if event is None or not event.response.ok:
                what = "has not answered" if event is None else "refuses"
                _log.warning("node %d %s that it restarts", node_id, what)

        request = uavcan.protocol.RestartNode.Request()
        request.magic_number = request.MAGIC_NUMBER
        self._node.request(request, node_id, answered)

    def begin(
        self,
        known: object,
        node_id: int,
        unique: bytes,
        *,
        name: str,
        octets: bytes,
        before: SoftwareVersion,
        ended: Callable[[str], None],
    ) -> None:
        """Give a node new software.

        Args:
            known: what the world knows of the node until it starts again.
            node_id: where it is.
            unique: its unique id.
            name: the image.
            octets: what it is.
            before: the software that it has.
            ended: called with how it has ended.
        """
        if self._update is not None:
            ended(f"node {node_id} was not told to take {name}: {self._update.state}; try it again afterwards")
            return
        self._update = SoftwareUpdate(f"node {node_id}", unique, name, octets, before=before, now=time.monotonic())
        self._first, self._ended = known, ended
        self._say(f"node {node_id} takes {name}, {len(octets):,} octets; it runs software {before}")
        self._tell_begin(self._update, node_id, BEGIN_TIMES)

    def state_of(self, unique: bytes) -> str:
        """That a node takes new software, as a sentence; empty: it does not."""
        update = self._update
        return update.state if update is not None and update.unique == unique else ""

    def lives(self, known: object, unique: bytes, status: Any, version: SoftwareVersion) -> None:  # noqa: ANN401
        """A node has sent its NodeStatus, and it is known who it is."""
        update = self._update
        if update is None or update.unique != unique:
            return
        if status.mode == status.MODE_SOFTWARE_UPDATE:
            update.reports(is_ill=status.health >= status.HEALTH_ERROR)
        elif status.mode == status.MODE_OPERATIONAL and known is not self._first:
            update.runs(version)
        self._look()

    def _tell_begin(self, update: SoftwareUpdate, node_id: int, times: int) -> None:
        def answered(event: Any) -> None:  # noqa: ANN401
            if update is not self._update:
                return
            if event is None and times > 1:
                self._tell_begin(update, node_id, times - 1)
            elif event is None:
                update.answered(None, "", time.monotonic())
            else:
                words = bytes(event.response.optional_error_message.to_bytes()).decode(errors="replace")
                update.answered(event.response.error, words, time.monotonic())
            self._look()

        request = uavcan.protocol.file.BeginFirmwareUpdate.Request()
        request.source_node_id = self._node.node_id
        request.image_file_remote_path.path = update.name
        self._node.request(request, node_id, answered)

    def _read(self, event: Any) -> Any:  # noqa: ANN401
        answer = uavcan.protocol.file.Read.Response()
        update = self._update
        if update is None or _path(event.request.path) != update.name:
            answer.error.value = answer.error.NOT_FOUND
        else:
            answer.data = bytearray(update.read(event.request.offset, time.monotonic()))
        return answer

    def _tell_size(self, event: Any) -> Any:  # noqa: ANN401
        answer = uavcan.protocol.file.GetInfo.Response()
        update = self._update
        if update is None or _path(event.request.path) != update.name:
            answer.error.value = answer.error.NOT_FOUND
        else:
            answer.size = update.octets
            kind = answer.entry_type
            kind.flags = kind.FLAG_FILE | kind.FLAG_READABLE
        return answer

    def _look(self) -> None:
        update = self._update
        if update is None:
            return
        update.look(time.monotonic())
        if update.outcome:
            self._update, self._first = None, None
            self._ended(update.outcome)


def version_of(software: Any) -> SoftwareVersion:  # noqa: ANN401
    """What a node says of its software, in its GetNodeInfo."""
    has_commit = software.optional_field_flags & software.OPTIONAL_FIELD_FLAG_VCS_COMMIT
    has_crc = software.optional_field_flags & software.OPTIONAL_FIELD_FLAG_IMAGE_CRC
    return SoftwareVersion(
        software.major, software.minor, software.vcs_commit if has_commit else 0, software.image_crc if has_crc else 0
    )


def _path(path: Any) -> str:  # noqa: ANN401
    return bytes(path.path.to_bytes()).decode(errors="replace")
