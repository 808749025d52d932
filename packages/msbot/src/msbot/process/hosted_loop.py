"""An asyncio event loop inside a program that has a loop of its own and cannot be waited in: a browser's tab.

Theory of operation. `asyncio` runs its loop until something ends it, and waits in a selector. In a tab nothing may
wait: JavaScript calls a function, which must return. So the host is asked for one thing only, to call
`HostedLoop.turn` after some time; a turn does what is due, and asks for the next one when the next timer is due. What
`asyncio` promises (the order of calls, handles with `when()`, times in the past) is that of `asyncio` itself, whose
base class does the work. There are no sockets, threads or signals.
"""

from __future__ import annotations

import asyncio
from asyncio import _get_running_loop, _set_running_loop  # for those who make loops
from collections.abc import Callable, Coroutine
from typing import Any

TURN_S = 0.05
"""What is due and cannot be done within this time waits for the next turn: the host has other things to do, too."""


class HostedLoop(asyncio.BaseEventLoop):
    """See the module's docstring.

    Args:
        call_later: asks the host to call a function once, after so many seconds; 0: soon, but not at once.
    """

    def __init__(self, call_later: Callable[[float, Callable[[], None]], object]) -> None:
        self._call_later = call_later
        self._asked_for: float | None = None
        """When the next turn is due; earlier requests that it makes needless come to nothing."""
        self._in_turn = False
        self._selector = _NoSockets()
        self._ready: Any
        self._scheduled: Any
        super().__init__()

    def begin(self, main: Coroutine[Any, Any, object]) -> asyncio.Task[object]:
        """Have a coroutine run; the turns begin."""
        task = self.create_task(main)
        self.wake()
        return task

    def do(self, function: Callable[[], object]) -> None:
        """Call a function as if by the loop, at once: for what the host has to say. Not from within the loop."""
        self._as_running(function)
        self.wake()

    def wake(self) -> None:
        """Ask for a turn soon: somebody outside the loop has given it something to do."""
        self._ask(self.time())

    def turn(self) -> None:
        """Do what is due, and ask for the next turn."""
        self._asked_for = None
        self._as_running(self._do_due)
        if (at := self._next_due()) is not None:
            self._ask(at)

    def _do_due(self) -> None:
        until = self.time() + TURN_S
        while True:
            self._run_once()  # type: ignore[attr-defined]  # what `run_forever` calls; there is no public way
            at = self._next_due()
            if at is None or at > self.time() or self.time() >= until:
                return

    def _as_running(self, function: Callable[[], object]) -> None:
        outer = _get_running_loop()
        _set_running_loop(self)
        self._in_turn = True
        try:
            function()
        finally:
            self._in_turn = False
            _set_running_loop(outer)

    def _next_due(self) -> float | None:
        """When a turn is needed; None: when somebody outside has something to do."""
        if self._ready:
            return self.time()
        timers = self._scheduled
        return timers[0].when() if timers else None

    def _ask(self, at: float) -> None:
        if self._in_turn or (self._asked_for is not None and self._asked_for <= at):
            return
        self._asked_for = at

        def due() -> None:
            if self._asked_for == at:  # otherwise an earlier turn has been asked for since
                self.turn()

        self._call_later(max(0.0, at - self.time()), due)

    def _write_to_self(self) -> None:
        self.wake()

    def _process_events(self, event_list: object) -> None:
        """There are none."""


class _NoSockets:
    """In place of a selector: nothing to wait for, and no waiting."""

    def select(self, _timeout: float | None) -> list[object]:
        return []
