"""A model of eProsima's C client: how it repeats, acknowledges and loses its place, after its source and recordings.

Where it differs from ours: any bit of an ACKNACK has it send everything again; an ACKNACK older than known would cost
it its history (counted in `ruined`); a message beyond its history is dropped but asked for for ever; the pieces of a
fragmented message must fit its history all at once; HEARTBEATs come every 100 ms, whatever was acknowledged; the
agent's GET_INFO is answered without a submessage header.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from random import Random

from tests.agent.wiring import FakeLink
from tests.conformance.agent_rig import ENTITIES, create_client, octets

LATENCY_S = 0.0005
HEARTBEAT_S = 0.1
POLL_S = 0.002
PIECE = 500
"""Octets in a piece of a slot of 512."""

_HEAD = octets("81 00 00 00")
_LAST_PIECE = 0x02


async def until(condition: Callable[[], bool]) -> None:
    """Look again and again, as C programs do."""
    while not condition():  # noqa: ASYNC110 - see above
        await asyncio.sleep(POLL_S)


class Wire:
    """One direction of a network that loses and doubles packets, and never lets one overtake another."""

    def __init__(self, random: Random, *, drop: float, duplicate: float) -> None:
        self._random = random
        self._drop = drop
        self._duplicate = duplicate
        self._last_at = 0.0

    def carry(self, deliver: Callable[[bytes], None], packet: bytes) -> None:
        """Have `deliver(packet)` called later, once, twice or never."""
        loop = asyncio.get_running_loop()
        if self._random.random() < self._drop:
            return
        for _ in range(2 if self._random.random() < self._duplicate else 1):
            self._last_at = max(loop.time() + LATENCY_S, self._last_at + 1e-7)
            loop.call_at(self._last_at, deliver, packet)


class CClient:
    """One session on reliable stream 0x80, with histories of `history` messages in both directions."""

    def __init__(
        self, link: FakeLink, key: int, *, history: int, random: Random, drop: float, duplicate: float
    ) -> None:
        self.samples: list[bytes] = []
        """What its topic callback was given."""
        self.statuses: dict[int, int] = {}
        """Status by request id."""
        self.ruined = 0
        """ACKNACKs that would have cost it its history."""
        self._key = key
        self._link = link
        self._history = history
        self._to_agent = Wire(random, drop=drop, duplicate=duplicate)
        self._from_agent = Wire(random, drop=drop, duplicate=duplicate)
        self._output: dict[int, bytes] = {}
        self._written = self._acked = 0xFFFF
        self._input: dict[int, bytes] = {}
        self._handled = self._announced = 0xFFFF
        self._welcome = asyncio.Event()
        link.plug(key, lambda packet: self._from_agent.carry(self._receive, packet))

    # What an application does.

    async def log_in(self) -> None:
        """Open a session and create the objects of `ENTITIES`."""
        while not self._welcome.is_set():
            # Lost as the others may be, but never late: nothing in XRCE tells an old login from a new one.
            self._link.inject(octets(create_client(f"{self._key:08x}")), self._key)
            await asyncio.sleep(1.0)
        self._run_session()
        for entity in ENTITIES:
            contents = octets(entity)
            await self.send(octets("01 01") + struct.pack("<H", len(contents)) + contents)
        await until(lambda: len(self.statuses) == len(ENTITIES))

    async def read(self) -> None:
        """Read reader 0016 without limits."""
        await self.send(octets("08 01 10 00 00 21 00 16 80 00 00 01 ff ff 00 00 00 00 00 00"))
        await until(lambda: self._acked == self._written)

    async def write(self, sample: bytes) -> None:
        """Write to writer 0015, in pieces when it is large."""
        body = octets("07 01") + struct.pack("<H", 4 + len(sample)) + octets("00 22 00 15") + sample
        if len(body) <= PIECE:
            await self.send(body)
            return
        for start in range(0, len(body), PIECE):
            piece = body[start : start + PIECE]
            flags = 0x01 | (_LAST_PIECE if start + PIECE >= len(body) else 0)
            await self.send(bytes((0x0D, flags)) + struct.pack("<H", len(piece)) + piece)

    async def send(self, body: bytes) -> None:
        """Send one message when the history has a free slot."""
        await until(lambda: (self._written - self._acked) & 0xFFFF < self._history)
        self._written = (self._written + 1) & 0xFFFF
        packet = octets("81 80") + struct.pack("<H", self._written) + body
        self._output[self._written] = packet + bytes(-len(packet) & 3)
        self._transmit(self._output[self._written])

    # What its library does.

    def _transmit(self, packet: bytes) -> None:
        self._to_agent.carry(lambda arrived: self._link.inject(arrived, self._key), packet)

    def _run_session(self) -> None:
        if self._acked != self._written:
            numbers = struct.pack("<HH", (self._acked + 1) & 0xFFFF, self._written)
            self._transmit(_HEAD + octets("0b 01 05 00") + numbers + b"\x80")
        asyncio.get_running_loop().call_later(HEARTBEAT_S, self._run_session)

    def _receive(self, packet: bytes) -> None:
        stream, kind = packet[1], packet[4]
        if stream == 0x80:
            self._take_message(packet)
        elif kind == 0x04:
            self._welcome.set()
        elif kind == 0x0A:
            self._take_acknack(*struct.unpack_from("<H", packet, 8), has_gaps=any(packet[10:12]))
        elif kind == 0x0B:
            (last,) = struct.unpack_from("<H", packet, 10)
            self._announce(last)
            self._acknowledge()
        elif kind == 0x02:
            self._transmit(_HEAD + bytes(8))

    def _take_acknack(self, first: int, *, has_gaps: bool) -> None:
        progress = (first - 1 - self._acked) & 0xFFFF
        if progress > self._history:
            self.ruined += 1
            return
        for _ in range(progress):
            self._acked = (self._acked + 1) & 0xFFFF
            del self._output[self._acked]
        if has_gaps:
            for packet in list(self._output.values()):
                self._transmit(packet)

    def _take_message(self, packet: bytes) -> None:
        (number,) = struct.unpack_from("<H", packet, 2)
        self._announce(number)
        if 0 < (number - self._handled) & 0xFFFF <= self._history:
            self._input.setdefault(number, packet)
        while whole := self._next_whole():
            self._handle(whole)
        self._acknowledge()

    def _announce(self, number: int) -> None:
        if 0 < (number - self._announced) & 0xFFFF < 0x8000:
            self._announced = number

    def _next_whole(self) -> bytes:
        """The submessages of the next message in order, joined from its pieces; empty when something is missing."""
        whole = b""
        number = self._handled
        while (packet := self._input.get(number := (number + 1) & 0xFFFF)) is not None:
            is_piece = packet[4] == 0x0D
            whole += packet[8:] if is_piece else packet[4:]
            if not is_piece or packet[5] & _LAST_PIECE:
                while self._handled != number:
                    self._handled = (self._handled + 1) & 0xFFFF
                    del self._input[self._handled]
                return whole
        return b""

    def _handle(self, submessages: bytes) -> None:
        while submessages:
            kind = submessages[0]
            (length,) = struct.unpack_from("<H", submessages, 2)
            body = submessages[: 4 + length]
            assert length == len(body) - 4
            request_id, _, status = struct.unpack_from(">HHB", body + b"\0", 4)
            if kind == 0x05:
                self.statuses[request_id] = status
            elif kind == 0x09:
                self.samples.append(body[8:])
            submessages = submessages[4 + length + (-length & 3) :]

    def _acknowledge(self) -> None:
        first = (self._handled + 1) & 0xFFFF
        while first in self._input:
            first = (first + 1) & 0xFFFF
        missing = [
            index
            for index in range(min((self._announced - first + 1) & 0xFFFF, 16))
            if (first + index) & 0xFFFF not in self._input
        ]
        bitmap = sum(1 << index for index in missing) if (self._announced - first) & 0xFFFF < 0x8000 else 0
        self._transmit(_HEAD + octets("0a 01 05 00") + struct.pack("<H", first) + bitmap.to_bytes(2, "big") + b"\x80")
