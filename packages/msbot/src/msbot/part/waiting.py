"""Functions that wait: `yield 1.0` in a student's function lets it wait for a second, and everything else go on.

Such a function is a generator. It is called like any other, and does its first step at once; the seconds that it yields
lead to the next step. While it waits, it is not begun a second time. STOP holds those that wait where they are: they go
on after GO; what begins meanwhile, below `on_stop` for example, goes on as usual.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Generator

from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.lazy import dataclass

SHORTEST_WAIT_S = 0.01
"""Nobody waits less: a loop that yields 0 leaves time for the rest of the part."""
MOST_WAITING = 64
"""So many functions may wait at a time."""

Steps = Generator[float, None, object]


@dataclass(slots=True, eq=False)
class Waiting:
    """A function that has begun and has not ended."""

    function: Callable[..., object]
    steps: Steps
    timer: asyncio.TimerHandle | None = None
    is_in_step: bool = False
    is_over: bool = False
    """Ended from outside."""
    is_held: bool = False
    """STOP was said while it waited."""
    is_due: bool = False
    """Its time has come while it was held."""


class WaitingFunctions:
    """The functions of one part that wait.

    Args:
        on_due: called with each whose time has come; it calls `go_on`, and sees to the errors of the function.
    """

    def __init__(self, on_due: Callable[[Waiting], object]) -> None:
        self._on_due = on_due
        self._all: list[Waiting] = []

    def begin(self, function: Callable[..., object], steps: Steps) -> None:
        """Do the first step of a function, unless it is waiting already; raises what the function raises.

        Raises:
            LocalProtocolError: too many functions wait.
        """
        if self._of(function):
            steps.close()
            return
        if len(self._all) >= MOST_WAITING:
            raise LocalProtocolError(f"{MOST_WAITING} functions wait already")
        waiting = Waiting(function, steps)
        self._all.append(waiting)
        self.go_on(waiting)

    def go_on(self, waiting: Waiting) -> None:
        """Do its next step, and wait as long as it says; raises what the function raises."""
        waiting.is_in_step = True
        wait_s: float | None = None
        try:
            wait_s = next(waiting.steps)
            if not _is_time(wait_s):
                words = f"yield waits for seconds, a number from 0 up: yield 0.5, not yield {wait_s!r}"
                wait_s = waiting.steps.throw(ValueError(words))  # raised in the line that is wrong
        except StopIteration:
            wait_s = None
        finally:
            waiting.is_in_step = False
            if wait_s is None or waiting.is_over or not _is_time(wait_s):
                self._forget(waiting)
        if waiting in self._all and wait_s is not None:
            loop = asyncio.get_running_loop()
            waiting.timer = loop.call_later(max(wait_s, SHORTEST_WAIT_S), self._come, waiting)

    def hold(self) -> None:
        """STOP: those that wait stay where they are."""
        for waiting in self._all:
            waiting.is_held = True

    def release(self) -> None:
        """GO: they go on; at once, if their time has come meanwhile."""
        loop = asyncio.get_running_loop()
        for waiting in self._all:
            if waiting.is_due:
                waiting.timer = loop.call_later(0, self._come, waiting)
            waiting.is_held = waiting.is_due = False

    def end(self, function: Callable[..., object]) -> None:
        """End a function, if it waits: it is about to begin anew."""
        for waiting in self._of(function):
            self._forget(waiting)

    def end_all(self) -> None:
        """End all."""
        for waiting in tuple(self._all):
            self._forget(waiting)

    def _of(self, function: Callable[..., object]) -> list[Waiting]:
        return [one for one in self._all if one.function == function]

    def _come(self, waiting: Waiting) -> None:
        if waiting.is_held:
            waiting.is_due = True
        elif not waiting.is_over:
            self._on_due(waiting)

    def _forget(self, waiting: Waiting) -> None:
        waiting.is_over = True
        if waiting in self._all:
            self._all.remove(waiting)
        if waiting.timer is not None:
            waiting.timer.cancel()
        if not waiting.is_in_step:  # else it is closed when its step has ended
            waiting.steps.close()


def _is_time(seconds: object) -> bool:
    return isinstance(seconds, int | float) and not isinstance(seconds, bool) and 0 <= seconds < math.inf
