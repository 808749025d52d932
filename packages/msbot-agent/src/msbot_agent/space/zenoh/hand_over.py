"""From the threads of the library to the event loop: one bounded queue for each endpoint, one call for each batch."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

BATCH = 64
"""Items dealt with in one turn of the loop."""

MOST_OCTETS = 64 << 20

T = TypeVar("T")


def tell(loop: asyncio.AbstractEventLoop, function: Callable[..., object], *arguments: object) -> None:
    """Call something on the loop, from any thread."""
    with contextlib.suppress(RuntimeError):  # the loop has been closed: nobody is left to tell
        loop.call_soon_threadsafe(function, *arguments)


class HandOver(Generic[T]):
    """Items put in by any thread are taken on the loop, in order; when it is full the oldest gives way.

    No lock is taken: a deque's append and popleft are atomic, and the flag may be set once too often, not too rarely.
    """

    __slots__ = ("_is_announced", "_loop", "_most", "_queue", "_size_of", "_take", "first_lost", "lost")

    def __init__(
        self, loop: asyncio.AbstractEventLoop, take: Callable[[T], None], most: int,
        size_of: Callable[[T], int] | None = None,
    ) -> None:  # fmt: skip
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
            tell(self._loop, self._drain)

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
