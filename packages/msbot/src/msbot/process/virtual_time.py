"""An asyncio event loop whose clock jumps to the next timer instead of waiting for it.

Theory of operation. An asyncio loop asks its selector to wait until the next timer is due. Here the selector does not
wait: it sets the clock to exactly that timer's time and returns. Everything that takes its time from
`asyncio.get_running_loop().time()` then runs as fast as the machine can, in the same order every time. Sockets are
still served, but time does not wait for them, so only what has no socket (the simulated bus, the in-process link)
behaves as in real time. While a job of `run_in_executor` is running, the clock stands still.
"""

from __future__ import annotations

import asyncio
import math
import selectors
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from typing import TypeVar, TypeVarTuple

STUCK_AFTER_S = 5.0
"""Real seconds after which a loop with no timers, no job of a thread and no news counts as stuck."""

_T = TypeVar("_T")
_Ts = TypeVarTuple("_Ts")


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Event loop with a clock of its own, in seconds from `start`."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start
        self._at_work = 0
        selector = _JumpingSelector(self._next_moment, self._is_stuck)
        super().__init__(selector)
        selector.own = len(selector.get_map())
        self._selector: _JumpingSelector
        self._set_clock(start)

    def time(self) -> float:
        """Seconds of virtual time."""
        return self._now

    def run_in_executor(self, executor: Executor | None, func: Callable[[*_Ts], _T], *args: *_Ts) -> asyncio.Future[_T]:
        """As in every loop; virtual time stays still until the job is done."""
        job = super().run_in_executor(executor, func, *args)
        self._at_work += 1
        job.add_done_callback(self._job_done)
        return job

    def _job_done(self, _: asyncio.Future[_T]) -> None:
        self._at_work -= 1

    def _write_to_self(self) -> None:
        """As in every loop: another thread, or a signal, has something for this one."""
        self._selector.was_poked = True
        super()._write_to_self()  # type: ignore[misc]  # no public way to hear of it

    def add_signal_handler(self, sig: int, callback: Callable[[*_Ts], object], *args: *_Ts) -> None:
        """As in every loop; Python itself then writes to the loop's pipe, so it is read at every turn."""
        super().add_signal_handler(sig, callback, *args)
        self._selector.own = 0

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:  # noqa: ARG002, ASYNC109  # as asyncio has it
        """As in every loop; virtual time stays still until the threads have ended, so a limit never passes."""
        self._at_work += 1
        try:
            await super().shutdown_default_executor()
        finally:
            self._at_work -= 1

    def _set_clock(self, now: float) -> None:
        self._now = now
        # The base class fires timers up to one resolution early. In virtual time "early" would never pass: a state
        # machine that is woken too soon would ask for the same moment for ever. One ulp means "not early".
        self._clock_resolution = math.ulp(now)

    def _next_moment(self) -> bool:
        """Set the clock to the next timer; False when there is none or a thread is still at work."""
        timers: list[asyncio.TimerHandle] = self._scheduled  # type: ignore[attr-defined]  # no public way to see them
        if self._at_work or not timers:
            return False
        self._set_clock(timers[0].when())
        return True

    def _is_stuck(self) -> bool:
        return not self._at_work


class _JumpingSelector(selectors.DefaultSelector):
    """Polls instead of waiting, and lets time jump when there is nothing to poll.

    A loop without sockets, beside which no thread works, asks the system nothing: its own pipe is read only when it
    was written to. Beside a thread it asks at every turn, which lets the thread go on.
    """

    own = 0
    """How many files the loop has for itself."""
    was_poked = True
    """Whether somebody may have written to the loop's own pipe since it was read."""

    def __init__(self, jump: Callable[[], bool], is_stuck: Callable[[], bool]) -> None:
        super().__init__()
        self._jump = jump
        self._is_stuck = is_stuck

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events: list[tuple[selectors.SelectorKey, int]] = []
        if self.was_poked or len(self.get_map()) > self.own or threading.active_count() > 1:
            self.was_poked = False  # before it is read: who writes later is seen the next time
            events = super().select(0)
        if events or timeout == 0 or self._jump():
            return events
        events = super().select(STUCK_AFTER_S)
        if not events and timeout is None and self._is_stuck():
            raise RuntimeError("virtual time is stuck: every task waits, and no timer is set that could wake one")
        return events


def run_virtual(main: Coroutine[object, object, _T], *, start: float = 0.0) -> _T:
    """Run a coroutine to its end in virtual time, as `asyncio.run` does in real time.

    Raises:
        RuntimeError: nothing can happen any more and `main` has not ended.
    """
    with asyncio.Runner(loop_factory=lambda: VirtualTimeLoop(start)) as runner:
        return runner.run(main)
