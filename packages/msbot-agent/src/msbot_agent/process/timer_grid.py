"""An event loop whose timers come in groups, so that a robot at rest wakes its computer seldom.

A robot's process has hundreds of timers: beats, samples of simulated parts, looks of pages. Each wakes the process by
itself, and a process that has just been woken is slow. Here a timer that is far away comes at the next point of a grid,
the same one for all; periods that are multiples of the grid's step keep their length. A near timer is exact.

asyncio is asked for one timer for each point of the grid. The callbacks of a point are called a few in each turn of the
loop: what comes in, such as STOP, waits for a few of them, not for all.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextvars import Context
from itertools import islice
from typing import Final, TypeVarTuple

from msbot_agent.process.direct_loop import DirectLoop

STEPS: Final = ((0.4, 0.1), (0.08, 0.05), (0.016, 0.01), (0.0, 0.002))
"""A timer at least so far away comes at a multiple of so much, seconds; the longer ones are multiples of the others."""
EARLY_S: Final = 0.01
"""A pause may end so much too early, or a tenth of it: what sleeps in a circle keeps its period."""
MOST_READ: Final = 0x10000
"""Octets that a connection's transport makes room for whenever it reads. For asyncio's own 256 KiB the C library asks
the kernel for memory, gives most of it back at once, and the rest after the message."""
LONGEST_PAUSE_S: Final = 0.002
"""A robot's messages may come so much later where that spares turns of the loop (`Gathering`)."""
MOST_IN_TURN: Final = 16
"""Callbacks of one point of the grid that are called in one turn of the loop."""
_ROUNDING: Final = 1e-6
"""Part of a step that a time on the grid may be off."""

_Ts = TypeVarTuple("_Ts")


def on_grid(delay: float, when: float, early_s: float = 0.0) -> float:
    """The point of the grid for a timer, not earlier than `early_s` before its time.

    Args:
        delay: how far away it is, seconds.
        when: its time, seconds of the loop's clock.
        early_s: how much too early it may come.
    """
    for least, step in STEPS:
        if delay >= least:
            return math.ceil((when - early_s) / step - _ROUNDING) * step
    return when


def first_time(loop: asyncio.AbstractEventLoop) -> float:
    """When something periodic begins in this loop: now, or at the next point of its grid."""
    now = loop.time()
    if not isinstance(loop, TimerGridLoop):
        return now
    step = STEPS[0][1]
    return math.ceil(now / step) * step


def until_step(now: float, step_s: float) -> float:
    """How long it is until the clock of the loop shows a multiple of a step, seconds; at least a quarter of the step.

    Who waits so comes in turns of the loop that come anyway, also after one that was late.
    """
    wait_s = (now // step_s + 1) * step_s - now
    return wait_s if wait_s >= step_s / 4 else wait_s + step_s


def rounds_timers(loop: asyncio.AbstractEventLoop) -> bool:
    """Whether timers come in groups in this loop; otherwise they are exact."""
    return isinstance(loop, TimerGridLoop)


class _Timer(asyncio.TimerHandle):
    """One of the timers of a point of the grid."""

    __slots__ = ("point",)
    point: _Point

    def cancel(self) -> None:
        """As in every loop."""
        if not self.cancelled():
            super().cancel()
            self.point.forget(self)

    def call(self) -> None:
        """Call it; an error goes to the loop's handler, as from every handle."""
        self._run()


class _Point:
    """The timers of one point of the grid.

    Args:
        begun: called when its time has come, or when nothing waits for it any more.
    """

    __slots__ = ("_alarm", "_begun", "_loop", "_timers", "_when")

    def __init__(self, loop: TimerGridLoop, when: float, begun: Callable[[float], object]) -> None:
        self._loop, self._when, self._begun = loop, when, begun
        self._timers: dict[int, _Timer] = {}
        self._alarm: asyncio.TimerHandle | None = loop.call_exactly_at(when, self._begin)

    def add(self, timer: _Timer) -> None:
        """One more."""
        timer.point = self
        self._timers[id(timer)] = timer

    def forget(self, timer: _Timer) -> None:
        """It was cancelled."""
        self._timers.pop(id(timer), None)
        if not self._timers and self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None
            self._begun(self._when)

    def _begin(self) -> None:
        self._alarm = None
        self._begun(self._when)
        self._go_on()

    def _go_on(self) -> None:
        timers = self._timers
        for number in list(islice(timers, MOST_IN_TURN)):
            timer = timers.pop(number, None)  # one of those before it may have cancelled it
            if timer is not None:
                timer.call()
        if timers:
            self._loop.call_soon(self._go_on)


class TimerGridLoop(DirectLoop):
    """See the module's docstring."""

    def __init__(self) -> None:
        self._points: dict[float, _Point] = {}
        super().__init__(LONGEST_PAUSE_S)

    def _make_socket_transport(self, *args: object, **settings: object) -> asyncio.Transport:
        """asyncio's way to a transport: it has no other place for `max_size`."""
        make: Callable[..., asyncio.Transport] = super()._make_socket_transport  # type: ignore[misc]
        transport = make(*args, **settings)
        vars(transport)["max_size"] = MOST_READ
        return transport

    def call_at(
        self, when: float, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call it at that time of the loop's clock or at the next point of the grid; never too early."""
        return self._put(on_grid(when - self.time(), when), callback, args, context)

    def call_later(
        self, delay: float, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call it after that time, at the point of the grid that is near."""
        return self._put(on_grid(delay, self.time() + delay, min(EARLY_S, delay / 10)), callback, args, context)

    def call_exactly_at(self, when: float, callback: Callable[[], object]) -> asyncio.TimerHandle:
        """Call it at that time of the loop's clock."""
        return super().call_at(when, callback)

    def _put(
        self, when: float, callback: Callable[[*_Ts], object], args: tuple[*_Ts], context: Context | None
    ) -> asyncio.TimerHandle:
        point = self._points.get(when)
        if point is None:
            point = self._points[when] = _Point(self, when, self._points.pop)
        timer = _Timer(when, callback, args, self, context)
        point.add(timer)
        return timer
