"""What travels beside each sample: who wrote it, its number, what the writer offers, and which request it answers."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from struct import Struct
from typing import Generic, TypeVar

from msbot_agent.space.contract import Guid, Qos
from msbot_agent.space.zenoh.key_expressions import flags, qos_of
from msbot_xrce.lazy import dataclass

VERSION = 1
_REPEATED = 0x80
_PLAIN = Struct("<BB16sQiff")
_RELATED = Struct("<16sQ")
_WITH_RELATED = _PLAIN.size + _RELATED.size
LONGEST_S = 1e9
"""Times above this are none."""


@dataclass(frozen=True, slots=True)
class SampleEnvelope:
    """The envelope of a sample that came in."""

    writer: Guid
    number: int
    offered: Qos
    related: tuple[Guid, int] | None
    is_repeated: bool
    """It was written before: repeated, so that a reader that was cut off notices what it has missed, or written before
    there was a connection. It is not for volatile readers that have heard nothing of this writer yet."""


class EnvelopeWriter:
    """Makes the envelopes of one writer."""

    __slots__ = ("_deadline", "_flags", "_guid", "_lifespan", "_strength")

    def __init__(self, guid: Guid, qos: Qos) -> None:
        """`guid` is the one by which others know it."""
        self._guid = guid
        self._flags = flags(qos)
        self._strength = qos.strength
        self._deadline = qos.deadline_s or 0.0
        self._lifespan = qos.lifespan_s or 0.0

    def seal(self, number: int, related: tuple[Guid, int] | None = None, *, is_repeated: bool = False) -> bytes:
        """The envelope of a sample."""
        flags_now = self._flags | _REPEATED if is_repeated else self._flags
        plain = _PLAIN.pack(VERSION, flags_now, self._guid, number, self._strength, self._deadline, self._lifespan)
        return plain if related is None else plain + _RELATED.pack(*related)


def read_envelope(octets: bytes) -> SampleEnvelope | None:
    """The envelope; None when it makes no sense."""
    if len(octets) not in (_PLAIN.size, _WITH_RELATED):
        return None
    version, number_of_flags, guid, number, strength, deadline, lifespan = _PLAIN.unpack_from(octets)
    if version != VERSION or not 0 <= deadline < LONGEST_S or not 0 <= lifespan < LONGEST_S:
        return None
    known = qos_of(number_of_flags, deadline)
    offered = Qos(
        reliable=known.reliable,
        transient_local=known.transient_local,
        exclusive=known.exclusive,
        deadline_s=known.deadline_s,
        strength=strength,
        lifespan_s=lifespan or None,
    )
    related = _RELATED.unpack_from(octets, _PLAIN.size) if len(octets) == _WITH_RELATED else None
    return SampleEnvelope(guid, number, offered, related, bool(number_of_flags & _REPEATED))


# From the threads of the library to the event loop: one bounded queue for each endpoint, one call for each batch.


BATCH = 64
"""Items dealt with in one turn of the loop."""

MOST_OCTETS = 64 << 20

T = TypeVar("T")


def call_on_loop(loop: asyncio.AbstractEventLoop, function: Callable[..., object], *arguments: object) -> None:
    """Call something on the loop, from any thread."""
    with contextlib.suppress(RuntimeError):  # the loop has been closed: nobody is left to tell
        loop.call_soon_threadsafe(function, *arguments)


class LoopQueue(Generic[T]):
    """Items put in by any thread are taken on the loop, in order; when it is full the oldest gives way.

    No lock is taken: a deque's append and popleft are atomic, and the flag may be set once too often, not too rarely.
    """

    __slots__ = ("_is_announced", "_loop", "_most", "_queue", "_size_of", "_take", "first_lost", "lost")

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        take: Callable[[T], None],
        most: int,
        size_of: Callable[[T], int] | None = None,
    ) -> None:
        """Make an empty one.

        Args:
            loop: where items are taken.
            take: takes one.
            most: how many may wait.
            size_of: octets of one; fewer wait when they are large, so that about `MOST_OCTETS` wait in all.
        """
        self.lost = 0
        """Items that gave way."""
        self.first_lost: T | None = None
        """The first of them."""
        self._loop = loop
        self._take = take
        self._most = most
        self._size_of = size_of
        self._queue: deque[T] = deque()
        self._is_announced = False

    def put(self, item: T) -> None:
        """Hand an item over; called by one thread at a time."""
        queue, most = self._queue, self._most
        if self._size_of is not None:
            most = min(most, max(1, MOST_OCTETS // (self._size_of(item) + 1)))
        while len(queue) >= most:
            with contextlib.suppress(IndexError):  # the loop has just taken it
                lost = queue.popleft()
                if self.first_lost is None:
                    self.first_lost = lost
                self.lost += 1
        queue.append(item)
        if not self._is_announced:
            self._is_announced = True
            call_on_loop(self._loop, self._drain)

    def clear(self) -> None:
        """Forget what was not taken."""
        self._queue.clear()

    def _drain(self) -> None:
        self._is_announced = False
        queue, take = self._queue, self._take
        for _ in range(BATCH):
            try:
                item = queue.popleft()
            except IndexError:
                return
            take(item)
        if not self._is_announced:
            self._is_announced = True
            self._loop.call_soon(self._drain)
