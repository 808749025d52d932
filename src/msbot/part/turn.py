"""The plumbing of a client: one flush per loop turn, one timer, one outbox, one way to wait."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Protocol

from msbot.errors import LinkDown, LinkFull, RequestError
from msbot.link import Link


class Turn:
    """Calls `work(now)` once per loop turn in which somebody booked it, and when the timer is due."""

    def __init__(self, work: Callable[[float], None]) -> None:
        self._work = work
        self._loop: asyncio.AbstractEventLoop | None = None
        self._booked = False
        self._timer: asyncio.TimerHandle | None = None

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Work from now on, in that loop."""
        self._loop = loop
        self.book()

    def stop(self) -> None:
        """Work no more."""
        self._loop = None
        self._cancel_timer()

    def book(self) -> None:
        """Have the work done in the next turn; does nothing before `start`."""
        if self._loop is not None and not self._booked:
            self._booked = True
            self._loop.call_soon(self._do)

    def now(self) -> float:
        """The loop's time; 0 before `start`."""
        return self._loop.time() if self._loop is not None else 0.0

    def set_timer(self, *times: float | None) -> None:
        """Have the work done at the earliest of the times, None = never; replaces the earlier timer."""
        due_at = min((time for time in times if time is not None), default=None)
        if self._timer is not None and not self._timer.cancelled() and self._timer.when() == due_at:
            return
        self._cancel_timer()
        if due_at is not None and self._loop is not None:
            self._timer = self._loop.call_at(due_at, self._timer_due)

    def _timer_due(self) -> None:
        self._timer = None
        self._do()

    def _do(self) -> None:
        self._booked = False
        if self._loop is not None:
            self._work(self._loop.time())

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class Source(Protocol):
    """Where packets come from (a session)."""

    def packets_to_send(self, now: float) -> list[bytes]:
        """All that may go now; given once."""


class Outbox:
    """Packets on their way to the link's remote peer; pulled from the session only when the link has room."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._packets: deque[bytes] = deque()

    def clear(self) -> None:
        """Drop what waits."""
        self._packets.clear()

    def send(self, source: Source, now: float) -> bool:
        """Send as much as the link takes; True when nothing is left to send."""
        link = self._link
        while True:
            peer = link.remote
            if peer is None or not link.has_room(peer):
                return False
            if not self._packets:
                self._packets.extend(source.packets_to_send(now))
                if not self._packets:
                    return True
            try:
                link.send(self._packets[0], peer)
            except (LinkFull, LinkDown):
                # It stays: `on_room`, "link up" or the session's own timer bring us back.
                return False
            self._packets.popleft()


class News:
    """Lets coroutines wait for a condition that only the loop's thread changes."""

    def __init__(self) -> None:
        self._event = asyncio.Event()
        self._waiters = 0

    def tell(self) -> None:
        """Something has changed: have every waiter look again."""
        if self._waiters:
            self._event.set()
            self._event = asyncio.Event()

    async def until(self, condition: Callable[[], bool], timeout_s: float | None, words: str) -> None:
        """Wait until the condition holds.

        Raises:
            RequestError: not within `timeout_s` seconds; begins with `words`.
        """
        self._waiters += 1
        try:
            async with asyncio.timeout(timeout_s):
                while not condition():
                    await self._event.wait()
        except TimeoutError:
            raise RequestError(f"{words} within {timeout_s} s") from None
        finally:
            self._waiters -= 1
