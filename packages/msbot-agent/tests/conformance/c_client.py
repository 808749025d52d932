"""A stock C client in virtual time, with its manners (`tests.stock`), on a network that loses, doubles and reorders."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from random import Random

from tests.agent.wiring import FakeLink
from tests.conformance.agent_rig import ENTITIES, create_client, octets
from tests.stock.reading import DATA, STATUS, as_stock_client
from tests.stock.writing import HEARTBEAT_S, StockInput, StockOutput

LATENCY_S = 0.0005
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
    """One direction of a network that loses, doubles and delays packets; a delayed one is overtaken by later ones."""

    def __init__(
        self, random: Random, *, drop: float, duplicate: float = 0.0, reorder: float = 0.0, delay_s: float = 0.03
    ) -> None:
        self._random = random
        self._drop = drop
        self._duplicate = duplicate
        self._reorder = reorder
        self._delay_s = delay_s
        self._last_at = 0.0

    def carry(self, deliver: Callable[[bytes], None], packet: bytes) -> None:
        """Have `deliver(packet)` called later, once, twice or never."""
        loop = asyncio.get_running_loop()
        if self._random.random() < self._drop:
            return
        for _ in range(2 if self._random.random() < self._duplicate else 1):
            if self._random.random() < self._reorder:
                loop.call_at(loop.time() + LATENCY_S + self._random.random() * self._delay_s, deliver, packet)
                continue
            self._last_at = max(loop.time() + LATENCY_S, self._last_at + 1e-7)
            loop.call_at(self._last_at, deliver, packet)


class CClient:
    """One session on reliable stream 0x80, with histories of `history` messages in both directions."""

    def __init__(self, link: FakeLink, key: int, wires: tuple[Wire, Wire], *, history: int, slice_s: float) -> None:
        """`wires`: to the agent, and back; `slice_s`: how long each of its calls of its run function takes."""
        self.samples: list[bytes] = []
        """What its topic callback was given."""
        self.replies: list[bytes] = []
        """What its reply callback was given."""
        self.statuses: dict[int, int] = {}
        """Status by request id."""
        self.acknacks = 0
        """How many came."""
        self.output = StockOutput(history)
        self._input = StockInput(history)
        self._key = key
        self._link = link
        self._slice_s = slice_s
        self._to_agent, self._from_agent = wires
        self._welcome = asyncio.Event()
        link.plug(key, lambda packet: self._from_agent.carry(self._receive, packet))

    # What an application does.

    async def log_in(self) -> None:
        """Open a session and create the objects of `ENTITIES`; statuses are awaited in one call."""
        slice_s, self._slice_s = self._slice_s, HEARTBEAT_S
        while not self._welcome.is_set():
            # Lost as the others may be, but never late: nothing in XRCE tells an old login from a new one.
            self._link.inject(octets(create_client(f"{self._key:08x}")), self._key)
            await asyncio.sleep(1.0)
        self._run()
        for entity in ENTITIES:
            contents = octets(entity)
            await self.send(octets("01 01") + struct.pack("<H", len(contents)) + contents)
        await until(lambda: len(self.statuses) == len(ENTITIES))
        self._slice_s = slice_s

    async def read(self) -> None:
        """Read reader 0016 without limits."""
        await self.send(octets("08 01 10 00 00 21 00 16 80 00 00 01 ff ff 00 00 00 00 00 00"))
        await self.confirm()

    async def confirm(self) -> None:
        """Wait for all acknowledgements, in one call."""
        slice_s, self._slice_s = self._slice_s, HEARTBEAT_S
        await until(lambda: self.output.is_confirmed)
        self._slice_s = slice_s

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
        await until(lambda: self.output.has_room)
        self._transmit(self.output.write(body))

    # What its library does.

    def _transmit(self, packet: bytes) -> None:
        self._to_agent.carry(lambda arrived: self._link.inject(arrived, self._key), packet)

    def _run(self) -> None:
        loop = asyncio.get_running_loop()
        if (heartbeat := self.output.run(loop.time())) is not None:
            self._transmit(heartbeat)
        loop.call_later(self._slice_s, self._run)

    def _receive(self, packet: bytes) -> None:
        kind = packet[4]
        if packet[1] == 0x80:
            for submessages in self._input.take(packet):
                self._handle(submessages)
            self._transmit(self._input.acknack())
        elif kind == 0x04:
            self._welcome.set()
        elif kind == 0x0A:
            self.acknacks += 1
            for again in self.output.take_acknack(packet[8] | packet[9] << 8, packet[10] << 8 | packet[11]):
                self._transmit(again)
        elif kind == 0x0B:
            self._input.announce(packet[10] | packet[11] << 8)
            self._transmit(self._input.acknack())
        elif kind == 0x02:
            self._transmit(_HEAD + bytes(8))

    def _handle(self, submessages: bytes) -> None:
        for taken in as_stock_client(submessages):
            if taken.kind == STATUS:
                self.statuses[taken.request_id] = taken.contents[4]
            elif taken.kind == DATA and taken.object_id & 0x0F == 0x07:
                self.replies.append(taken.contents[4:])
            elif taken.kind == DATA:
                self.samples.append(taken.contents[4:])
