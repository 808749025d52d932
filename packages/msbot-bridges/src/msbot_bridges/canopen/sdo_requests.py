"""Questions to one node by SDO; they wait for its answers, so they are asked in a thread."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Final

from canopen import RemoteNode
from canopen.sdo import SdoAbortedError, SdoCommunicationError

from msbot_bridges.canopen import objects
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.pdo_layout import PdoLayout, mapped_entries
from msbot_xrce.errors import MsbotError

NOT_THERE: Final = frozenset({0x06020000, 0x06090011, 0x06010001, 0x06010002, 0x08000024, 0x060A0023})
"""Abort codes: no such object or subindex, not readable, not writable, no data, not available."""
MOST_OCTETS: Final = 4096
"""Of a value; a node may send pieces without end."""
SET_UP_S: Final = 20.0
"""Longest time for all questions to one node: a node that answers each as late as it can holds up the others."""
READ_S: Final = 2.0
"""The same for a few entries."""
_NO_PDO: Final = 1 << 31
_EVENT_DRIVEN: Final = 255
_SYNCHRONOUS: Final = 240
"""Up to this transmission type a PDO waits for SYNC."""
_SYNC_ID: Final = 0x080
_TPDO, _RPDO = (0x1800, 0x1A00, 0x180), (0x1400, 0x1600, 0x200)


class SdoRefused(MsbotError):
    """The node has refused something."""


class SdoRequests:
    """Asks one node.

    Args:
        node: the library's.
        most_s: longest time for all questions; then they raise SdoCommunicationError.
    """

    def __init__(self, node: RemoteNode, most_s: float | None = None) -> None:
        self._sdo = node.sdo
        self._node_id = node.id
        self._most_s = SET_UP_S if most_s is None else most_s
        self._until = time.monotonic() + self._most_s

    def number(self, entry: Entry) -> int | None:
        """A number; None: the node has no such object."""
        data = self._data(entry.index, entry.subindex)
        return None if data is None else entry.decode(data)

    def text(self, index: int) -> str:
        """A text; empty: the node has none."""
        data = self._data(index, 0) or b""
        return data.rstrip(b"\0").decode("ascii", errors="replace").strip()

    def write(self, entry: Entry, value: int) -> None:
        """Write a number.

        Raises:
            SdoRefused: the node does not take it; the text says why.
        """
        self._write(entry.index, entry.subindex, entry.encode(value))

    def write_if_there(self, entry: Entry, value: int) -> bool:
        """Write a number into an object that not every device has; False: it has none, or it cannot be written."""
        try:
            with self._readable(entry.index, entry.subindex):
                self._sdo.download(entry.index, entry.subindex, entry.encode(value))
        except SdoAbortedError as error:
            if error.code not in NOT_THERE:
                raise SdoRefused(f"node {self._node_id} refuses {value} in {entry.where}: {error}") from error
            return False
        return True

    def count(self, index: int) -> int:
        """How many entries an array has; 0: the node has no such array."""
        return self.number(Entry(index, 0, 8)) or 0

    # PDOs

    def expect_sync(self) -> None:
        """Have the node take the bridge's SYNC for its own."""
        cob_id = self.number(objects.SYNC_COB_ID)
        if cob_id is not None and cob_id & 0x7FF != _SYNC_ID:
            self.write(objects.SYNC_COB_ID, _SYNC_ID)

    def layout(self, number: int, known: Mapping[tuple[int, int], Entry], *, is_sent: bool) -> PdoLayout | None:
        """A PDO as the node has it; None: it has none of that number, or does not use it."""
        communication, mapping, _ = _TPDO if is_sent else _RPDO
        cob_id = self.number(Entry(communication + number - 1, 1, 32))
        if cob_id is None or cob_id & _NO_PDO:
            return None
        count = self.count(mapping + number - 1)
        if count > 64:
            return None  # above are codes for multiplexed PDOs
        mapped = [self.number(Entry(mapping + number - 1, one + 1, 32)) or 0 for one in range(count)]
        transmission = self.number(Entry(communication + number - 1, 2, 8))
        is_synchronous = transmission is not None and transmission <= _SYNCHRONOUS
        return PdoLayout(number, cob_id & 0x1FFFFFFF, mapped_entries(mapped, known), is_synchronous)

    def map_pdo(self, number: int, entries: Sequence[Entry], *, is_sent: bool, event_ms: int = 0) -> PdoLayout:
        """Have a PDO carry these entries, sent when they change and, with `event_ms`, also so often.

        A device whose mapping is fixed keeps it, if it has these entries.

        Raises:
            SdoRefused: the node does not take that mapping.
        """
        communication, mapping, base = _TPDO if is_sent else _RPDO
        communication, mapping = communication + number - 1, mapping + number - 1
        known = {(entry.index, entry.subindex): entry for entry in entries}
        now = self.layout(number, known, is_sent=is_sent)
        cob_id = now.cob_id if now is not None else base + 0x100 * (number - 1) + self._node_id
        is_mapped = now is not None and now.entries == tuple(entries)
        try:
            self._write(communication, 1, (cob_id | _NO_PDO).to_bytes(4, "little"))
            self._write(communication, 2, bytes([_EVENT_DRIVEN]))
            if not is_mapped:
                self._write(mapping, 0, b"\0")
                for place, entry in enumerate(entries, 1):
                    self._write(mapping, place, entry.mapping.to_bytes(4, "little"))
                self._write(mapping, 0, bytes([len(entries)]))
        except SdoRefused:
            if now is None or not set(entries) <= set(now.entries):
                raise
            self._write(communication, 1, cob_id.to_bytes(4, "little"))
            return now
        if is_sent and event_ms:
            self.write_if_there(Entry(communication, 5, 16), event_ms)
        self._write(communication, 1, cob_id.to_bytes(4, "little"))
        return PdoLayout(number, cob_id, tuple(entries))

    def _data(self, index: int, subindex: int) -> bytes | None:
        try:
            with self._readable(index, subindex):
                return self._upload(index, subindex)
        except SdoAbortedError as error:
            if error.code in NOT_THERE:
                return None
            raise SdoRefused(f"node {self._node_id} does not tell 0x{index:04X}:{subindex:02X}: {error}") from error

    def _upload(self, index: int, subindex: int) -> bytes:
        with self._sdo.open(index, subindex, "rb", buffering=0) as stream:
            data = b""
            while piece := stream.read(7):
                self._check_time()
                data += piece
                if len(data) > MOST_OCTETS:
                    raise SdoCommunicationError(f"0x{index:04X}:{subindex:02X} has more than {MOST_OCTETS:,} octets")
            return data if stream.size is None else data[: stream.size]

    @contextmanager
    def _readable(self, index: int, subindex: int) -> Iterator[None]:
        """The library raises whatever it stumbles over in a frame that is no answer."""
        self._check_time()
        try:
            yield
        except (struct.error, IndexError) as error:
            raise SdoCommunicationError(f"what it answers to 0x{index:04X}:{subindex:02X} is no answer") from error

    def _check_time(self) -> None:
        if time.monotonic() > self._until:
            raise SdoCommunicationError(f"it takes more than {self._most_s:g} s to answer")

    def _write(self, index: int, subindex: int, data: bytes) -> None:
        try:
            with self._readable(index, subindex):
                self._sdo.download(index, subindex, data)
        except SdoAbortedError as error:
            raise SdoRefused(f"node {self._node_id} refuses 0x{index:04X}:{subindex:02X}: {error}") from error
