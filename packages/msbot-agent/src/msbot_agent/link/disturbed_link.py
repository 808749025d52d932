"""A link whose packets are lost, doubled, held back or not taken, on purpose: for tests, and for the fault lab.

What happens to a packet is said by treatments, which are pure; the link holds packets back on the loop's clock. It can
be put around a link that is running, and taken away again: without one, nothing costs anything.
"""

from __future__ import annotations

import asyncio
import heapq
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from itertools import count
from random import Random
from typing import Final, Protocol

from msbot_agent.link.contract import Link, PacketHandler, Peer, RoomHandler, SignalHandler, Tap
from msbot_xrce.errors import LinkError, LinkFull

OVERTAKEN_S: Final = 0.01
"""How long a reordered packet is held back while later ones pass it, if nobody says otherwise."""
MOST_HELD: Final = 4096
"""Most packets that are held back; further ones are lost and counted."""
MOST_COPIES: Final = 8
"""Most copies of one packet, when several treatments double it."""
LOST: Final = "lost on purpose"


class Treatment(Protocol):
    """Says what becomes of packets. Pure: time comes in."""

    def applies_to(self, peer: Peer, packet: bytes, *, inward: bool) -> bool:
        """Whether it treats that packet, which comes from the peer (`inward`) or goes to it."""

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """Seconds that each copy of a packet waits; none: it is lost; infinite: until the treatment ends."""

    def free_at(self, peer: Peer, now: float) -> float:
        """When that peer takes the next packet; not after `now`: at once."""


class Disturbance:
    """Treats every packet alike, by chance.

    Args:
        random: source of randomness; give it a seed.
        drop: probability from 0 to 1 that a packet is lost.
        duplicate: probability that a packet arrives twice.
        reorder: probability that a packet is held back, so that later ones overtake it.
        delay: extra seconds that every packet takes.
        jitter: up to so many seconds more, drawn for every packet.
        overtaken_s: how long a packet is held back for others to overtake it.

    All but the first may be changed at any time.
    """

    def __init__(
        self,
        random: Random,
        *,
        drop: float = 0.0,
        duplicate: float = 0.0,
        reorder: float = 0.0,
        delay: float = 0.0,
        jitter: float = 0.0,
        overtaken_s: float = OVERTAKEN_S,
    ) -> None:
        self.drop = drop
        self.duplicate = duplicate
        self.reorder = reorder
        self.delay = delay
        self.jitter = jitter
        self.overtaken_s = overtaken_s
        self._random = random

    def applies_to(self, peer: Peer, packet: bytes, *, inward: bool) -> bool:  # noqa: ARG002 - see `Treatment`
        """All packets."""
        return True

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:  # noqa: ARG002
        """See `Treatment`."""
        chance = self._random.random
        if chance() < self.drop:
            return ()
        copies = 2 if chance() < self.duplicate else 1
        return [self._wait() for _ in range(copies)]

    def free_at(self, peer: Peer, now: float) -> float:  # noqa: ARG002
        """At once."""
        return now

    def _wait(self) -> float:
        chance = self._random.random
        wait = self.delay + (self.overtaken_s if chance() < self.reorder else 0.0)
        return wait + chance() * self.jitter if self.jitter else wait


class DisturbedLink:
    """Wraps any link and treats its packets; satisfies `Link`. Counters and tap are those of the wrapped link.

    It may lose packets, so ACKNACKs are not sparse.

    Args:
        link: the link that carries the packets that are left; its packets come here from now on.
        *treatments: what happens to them.
    """

    def __init__(self, link: Link, *treatments: Treatment) -> None:
        self.info = replace(link.info, sparse_acknacks=False)
        self.counters = link.counters
        self.remote = link.remote
        self.inner = link
        """The wrapped link."""
        self._treatments = list(treatments)
        self._held: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()
        self._waiting_for_room: dict[Peer, asyncio.TimerHandle] = {}
        self._packet_handler: PacketHandler | None = None
        self._room_handler: RoomHandler | None = None
        self._burst_end: Callable[[], None] | None = None
        link.attach(packet=self._received)

    def add(self, treatment: Treatment) -> None:
        """Treat packets so, too."""
        self._treatments.append(treatment)

    def remove(self, treatment: Treatment) -> None:
        """End a treatment: what is held back is carried now, in the order in which it was due."""
        self._treatments.remove(treatment)
        while self._held:
            self._carry_first()
        for timer in self._waiting_for_room.values():
            timer.cancel()
        self._waiting_for_room.clear()
        if self._room_handler is not None:
            self._room_handler(None)

    @property
    def is_idle(self) -> bool:
        """Whether it treats nothing any more."""
        return not self._treatments

    @property
    def tap(self) -> Tap | None:
        """The wrapped link's tap: the packets really on the wire."""
        return self.inner.tap

    @tap.setter
    def tap(self, tap: Tap | None) -> None:
        self.inner.tap = tap

    def attach(
        self,
        *,
        packet: PacketHandler | None = None,
        signal: SignalHandler | None = None,
        room: RoomHandler | None = None,
        burst_end: Callable[[], None] | None = None,
    ) -> None:
        """See `Link`."""
        self._packet_handler = packet or self._packet_handler
        self._room_handler = room or self._room_handler
        self._burst_end = burst_end or self._burst_end
        self.inner.attach(signal=signal, room=room, burst_end=burst_end)

    def has_room(self, peer: Peer) -> bool:
        """Whether `send` to that peer would succeed now."""
        return self._is_free(peer) and self.inner.has_room(peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        """Send, lose, double or hold back one packet; a late one that finds no room is dropped and counted.

        Raises:
            LinkFull: the peer's queue is full, or a treatment lets it take no more now.
            LinkDown: the link is not open.
        """
        if not self._is_free(peer):
            raise LinkFull(f"{self.describe(peer)} takes no packet now, on purpose: wait for on_room")
        self._treat(packet, peer, lambda: self.inner.send(packet, peer), inward=False)

    def origin(self, peer: Peer) -> Hashable:
        """See `Link`."""
        return self.inner.origin(peer)

    def describe(self, peer: Peer) -> str:
        """The peer in the words of the wrapped link."""
        return self.inner.describe(peer)

    async def run(self) -> None:
        """Serve the wrapped link until cancelled; packets still held back then are lost.

        Raises:
            LinkDown: the wrapped link cannot be opened or has gone for good.
        """
        try:
            await self.inner.run()
        finally:
            self._held.clear()

    def _received(self, packet: bytes, peer: Peer, now: float) -> None:
        def carry() -> None:
            if self._packet_handler is not None:
                self._packet_handler(packet, peer, max(now, asyncio.get_running_loop().time()))

        self._treat(packet, peer, carry, inward=True)

    def _treat(self, packet: bytes, peer: Peer, carry: Callable[[], None], *, inward: bool) -> None:
        now = asyncio.get_running_loop().time()
        waits: Sequence[float] = (0.0,)
        for treatment in self._treatments:
            if treatment.applies_to(peer, packet, inward=inward):
                waits = [wait + more for wait in waits for more in treatment.delays(peer, now, inward=inward)]
        if not waits:
            self.counters.dropped.count(LOST)
        for wait in waits[:MOST_COPIES]:
            if wait > 0:
                self._hold(carry, now + wait)
            else:
                carry()

    def _is_free(self, peer: Peer) -> bool:
        """Whether the peer takes a packet now; if not, the owner is told when it does."""
        loop = asyncio.get_running_loop()
        now = loop.time()
        at = max((treatment.free_at(peer, now) for treatment in self._treatments), default=now)
        if at <= now:
            return True
        if at < math.inf and peer not in self._waiting_for_room:
            self._waiting_for_room[peer] = loop.call_at(at, self._has_room_again, peer)
        return False

    def _has_room_again(self, peer: Peer) -> None:
        del self._waiting_for_room[peer]
        if self._room_handler is not None:
            self._room_handler(peer)

    def _hold(self, carry: Callable[[], None], due: float) -> None:
        if len(self._held) >= MOST_HELD:
            self.counters.dropped.count("lost on purpose: too many held back")
            return
        # Timers due at the same moment fire in any order; the numbers keep their packets in order.
        heapq.heappush(self._held, (due, next(self._order), carry))
        if due < math.inf:
            asyncio.get_running_loop().call_at(due, self._release, due)

    def _release(self, due: float) -> None:
        # The packet of this timer may have been carried early, when a treatment ended.
        if self._held and self._held[0][0] <= due:
            self._carry_first()

    def _carry_first(self) -> None:
        carry = heapq.heappop(self._held)[2]
        try:
            carry()
        except LinkError as error:
            self.counters.dropped.count(f"held back, then not sent: {type(error).__name__}")
        if self.info.in_bursts and self._burst_end is not None:
            self._burst_end()  # a late packet is a burst of its own


# A link that loses, duplicates, reorders and delays packets, the same way every time for the same random seed.


class LossyLink(DisturbedLink):
    """Wraps any link and disturbs its packets in both directions; satisfies `Link`.

    Args:
        link: the link that carries the remaining packets.
        random: where its chances come from; see `Disturbance`.
        drop: see `Disturbance`.
        duplicate: see `Disturbance`.
        reorder: see `Disturbance`.
        delay: see `Disturbance`, in s.
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
        self.disturbance = Disturbance(random, drop=drop, duplicate=duplicate, reorder=reorder, delay=delay)
        """What happens to the packets; may be changed while the link runs."""
        super().__init__(link, self.disturbance)
