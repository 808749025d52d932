"""`@part.every`: a student's function that is called again and again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from msbot.part.handler_guard import Guard


class Every:
    """Calls a handler periodically, on a grid that does not drift; late calls are skipped, not made up for."""

    def __init__(self, period_s: float, function: Callable[[], object]) -> None:
        self.period_s = period_s
        self.function = function
        self._guard: Guard | None = None
        self._timer: asyncio.TimerHandle | None = None

    def start(self, guard: Guard) -> None:
        """Have the guard call it in the next turn of the loop, and then every period."""
        self.cancel()
        self._guard = guard
        loop = asyncio.get_running_loop()
        self._arm(loop, loop.time(), guard)

    def cancel(self) -> None:
        """Stop calling it."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = self._guard = None

    def change(self, period_s: float) -> None:
        """Change the period; if it is running, it starts over with the new period at once."""
        if period_s == self.period_s:
            return
        self.period_s = period_s
        if self._guard is not None:
            self.start(self._guard)

    def _arm(self, loop: asyncio.AbstractEventLoop, due_at: float, guard: Guard) -> None:
        self._timer = loop.call_at(due_at, self._due, loop, due_at, guard)

    def _due(self, loop: asyncio.AbstractEventLoop, due_at: float, guard: Guard) -> None:
        behind = max(0.0, loop.time() - due_at)
        self._arm(loop, due_at + (behind // self.period_s + 1) * self.period_s, guard)
        guard.call(self.function)
