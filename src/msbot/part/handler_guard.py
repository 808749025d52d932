"""A student's functions: checked when they are handed over, guarded when they are called.

A mistake in a handler must neither end the part nor flood the screen: it is reported once with file and line, and
counted.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
from collections.abc import Callable

from msbot.errors import ConfigError
from msbot.part.beginner import line_of

_log = logging.getLogger("msbot.part")

SLOW_S = 0.5
"""A handler that takes longer is reported: while it runs, the part cannot beat."""
MAX_REPORTS = 100
"""Different errors that are reported; more are only counted."""


def check_handler(function: Callable[..., object], arguments: str = "") -> str:
    """Refuse what cannot be a handler; returns its name for messages.

    Args:
        function: the handler.
        arguments: the name of its one argument, "" = none.

    Raises:
        ConfigError: it is not a plain function, or takes other arguments.
    """
    name = getattr(function, "__name__", repr(function))
    if not callable(function):
        raise ConfigError(f"a handler must be a function, not {function!r}")
    if inspect.iscoroutinefunction(function):
        raise ConfigError(f"{name} is an `async def`: a handler must be a plain function (`def {name}(...)`)")
    try:
        inspect.signature(function).bind(*([None] if arguments else []))
    except TypeError:
        takes = f"one argument, the {arguments}" if arguments else "no arguments"
        raise ConfigError(f"{name} must take {takes}: write `def {name}({arguments})`") from None
    except ValueError:
        _log.debug("%s has no signature to check", name)
    return name


class Guard:
    """Calls handlers and keeps their errors away from the part."""

    def __init__(self, mistake: Callable[[ConfigError], None]) -> None:
        """Make a guard.

        Args:
            mistake: gets a ConfigError raised by a handler: a mistake that must be mended in the program.
        """
        self.errors = 0
        """Calls that ended with an error."""
        self.running: tuple[str, float] | None = None
        """The function that runs now and since when, by the loop's clock."""
        self._mistake = mistake
        self._reported: set[tuple[str, str]] = set()

    def call(self, function: Callable[..., object], *arguments: object) -> bool:
        """Call a handler; reports each kind of error at each line once. False: it ended with an error."""
        clock = asyncio.get_running_loop().time
        began_at = clock()
        failed = False
        before, self.running = self.running, (_name(function), began_at)
        try:
            function(*arguments)
        except Exception as error:
            self._failed(function, error)
            failed = True
        finally:
            self.running = before
        took_s = clock() - began_at
        if took_s > SLOW_S:
            words = f"took {took_s:.1f} s, and the part cannot beat meanwhile: keep it below {SLOW_S} s"
            self.report(_name(function), words, kind="slow")
        return not failed

    def report(self, where: str, what: str, *, kind: str = "") -> None:
        """Say something once for each place and kind; without a kind, once for each text."""
        key = (where, kind or what)
        if key not in self._reported and len(self._reported) < MAX_REPORTS:
            self._reported.add(key)
            _log.error("%s: %s", where, what)

    def _failed(self, function: Callable[..., object], error: Exception) -> None:
        self.errors += 1
        where = line_of(error) or _name(function)
        if isinstance(error, ConfigError):
            self._mistake(ConfigError(f"{where}: {error}"))
            return
        words = f"{type(error).__name__}: {error} (said once, counted from now on)"
        self.report(where, words, kind=type(error).__name__)
        _log.debug("%s: the whole story (-v)", where, exc_info=error)


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
        """Have another period; one that runs starts over with it, at once."""
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


def _name(function: Callable[..., object]) -> str:
    return getattr(function, "__name__", repr(function))
