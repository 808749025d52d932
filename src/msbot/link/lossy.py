"""A link that loses, duplicates, reorders and delays packets, the same way every time for the same random seed."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable, Hashable
from itertools import count
from random import Random

from msbot.errors import LinkError
from msbot.link.contract import Link, PacketHandler, Peer, RoomHandler, SignalHandler, Tap

OVERTAKEN_S = 0.01
"""How long a reordered packet is held back while later ones pass it."""


class LossyLink:
    """Wraps any link and disturbs its packets in both directions; satisfies `Link`.

    Args:
        link: the link that carries the remaining packets; counters and tap are those of this link.
        random: source of randomness; give it a seed.
        drop: probability from 0 to 1 that a packet is lost.
        duplicate: probability that a packet arrives twice.
        reorder: probability that a packet is held back for 10 ms, so that later ones overtake it.
        delay: extra seconds that every packet takes.

    All four may be changed while the link runs.
    """

    def __init__(
        self,
        link: Link,
        *,
        random: Random,
        drop: float = 0.0,
        duplicate: float = 0.0,
        reorder: float = 0.0,
        delay: float = 0.0,
    ) -> None:
        self.drop = drop
        self.duplicate = duplicate
        self.reorder = reorder
        self.delay = delay
        self.info = link.info
        self.counters = link.counters
        self.remote = link.remote
        self._link = link
        self._random = random
        self._held: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()
        self._packet_handler: PacketHandler | None = None
        link.attach(packet=self._received)

    @property
    def tap(self) -> Tap | None:
        """The wrapped link's tap: the packets really on the wire."""
        return self._link.tap

    @tap.setter
    def tap(self, tap: Tap | None) -> None:
        self._link.tap = tap

    def attach(
        self,
        *,
        packet: PacketHandler | None = None,
        signal: SignalHandler | None = None,
        room: RoomHandler | None = None,
        burst_end: Callable[[], None] | None = None,
    ) -> None:
        """See `Link`; only packets are disturbed."""
        self._packet_handler = packet or self._packet_handler
        self._link.attach(signal=signal, room=room, burst_end=burst_end)

    def has_room(self, peer: Peer) -> bool:
        """Whether `send` to that peer would succeed now."""
        return self._link.has_room(peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        """Send, lose, duplicate or hold back one packet; a late one that finds no room is dropped and counted.

        Raises:
            LinkFull: the peer's queue is full.
            LinkDown: the link is not open.
        """
        self._spoil(lambda: self._link.send(packet, peer))

    def origin(self, peer: Peer) -> Hashable:
        """See `Link`."""
        return self._link.origin(peer)

    def describe(self, peer: Peer) -> str:
        """The peer in the words of the wrapped link."""
        return self._link.describe(peer)

    async def run(self) -> None:
        """Serve the wrapped link until cancelled; packets still held back then are lost.

        Raises:
            LinkDown: the wrapped link cannot be opened or has gone for good.
        """
        try:
            await self._link.run()
        finally:
            self._held.clear()

    def _received(self, packet: bytes, peer: Peer, now: float) -> None:
        def carry() -> None:
            if self._packet_handler is not None:
                self._packet_handler(packet, peer, max(now, asyncio.get_running_loop().time()))

        self._spoil(carry)

    def _spoil(self, carry: Callable[[], None]) -> None:
        chance = self._random.random
        if chance() < self.drop:
            self.counters.dropped.count("lost on purpose")
            return
        for _ in range(2 if chance() < self.duplicate else 1):
            wait = self.delay + (OVERTAKEN_S if chance() < self.reorder else 0.0)
            if wait > 0:
                self._hold(carry, wait)
            else:
                carry()

    def _hold(self, carry: Callable[[], None], wait: float) -> None:
        # Timers due at the same moment fire in any order; the numbers keep their packets in order.
        loop = asyncio.get_running_loop()
        due = loop.time() + wait
        heapq.heappush(self._held, (due, next(self._order), carry))
        loop.call_at(due, self._release)

    def _release(self) -> None:
        if not self._held:
            return
        carry = heapq.heappop(self._held)[2]
        try:
            carry()
        except LinkError as error:
            self.counters.dropped.count(f"held back, then not sent: {type(error).__name__}")
