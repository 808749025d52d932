"""The plumbing of a client: one flush per loop turn, one timer, one way to wait."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from msbot_xrce.errors import RequestTimeout


class Turn:
    """Calls `work(now)` once per loop turn in which `book` was called, and when the timer is due."""

    def __init__(self, work: Callable[[float], None]) -> None:
        self._work = work
        self._loop: asyncio.AbstractEventLoop | None = None
        self._booked = False
        self._timer: asyncio.TimerHandle | None = None

    @property
    def is_running(self) -> bool:
        """Whether it was started and not cancelled."""
        return self._loop is not None

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Work from now on, in that loop."""
        self._loop = loop
        self.book()

    def cancel(self) -> None:
        """Stop working."""
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
        """Have the work done at the earliest of these times, None = never; replaces the previous timer."""
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


class News:
    """Lets coroutines wait for a condition that changes only in the loop's thread."""

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
            RequestTimeout: it did not hold within `timeout_s` seconds; the message begins with `words`.
        """
        self._waiters += 1
        try:
            async with asyncio.timeout(timeout_s):
                while not condition():
                    await self._event.wait()
        except TimeoutError:
            raise RequestTimeout(f"{words} within {timeout_s} s") from None
        finally:
            self._waiters -= 1
