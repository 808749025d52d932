"""A student's functions: checked when they are handed over, guarded when they are called.

A mistake in a handler must neither end the part nor flood the screen: it is reported once with file and line, and
counted.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
from collections.abc import Callable

from msbot.part.mistakes import line_of
from msbot_xrce.errors import ConfigError

_log = logging.getLogger("msbot.part")

SLOW_S = 0.5
"""A handler that takes longer is reported: while it runs, the part cannot send beats."""
MAX_REPORTS = 100
"""How many different errors are reported; further ones are only counted."""


def check_handler(function: Callable[..., object], arguments: str = "") -> str:
    """Refuse what cannot be a handler; returns its name for messages.

    Args:
        function: the handler.
        arguments: the name of its one argument, "" = none.

    Raises:
        ConfigError: it is not a plain function, or does not take these arguments.
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
            mistake: called with a ConfigError raised by a handler: a mistake that must be fixed in the program.
        """
        self.part = ""
        """What the part is called; known when it runs."""
        self.errors = 0
        """Calls that ended with an error."""
        self.running: tuple[str, float] | None = None
        """The function that is running now and when it began, by the loop's clock."""
        self._mistake = mistake
        self._reported: set[tuple[str, str]] = set()

    def call(self, function: Callable[..., object], *arguments: object) -> bool:
        """Call a handler; each kind of error at each line is reported once. False: it ended with an error."""
        clock = asyncio.get_running_loop().time
        began_at = clock()
        failed = False
        before, self.running = self.running, (self._shown(function), began_at)
        try:
            function(*arguments)
        except Exception as error:
            self._failed(function, error)
            failed = True
        finally:
            self.running = before
        took_s = clock() - began_at
        if took_s > SLOW_S and _is_own(function):
            words = f"one of its steps took {took_s:.1f} s, and it cannot beat meanwhile: this computer may be too busy"
            self.report(self.part or "a part", words, kind="slow")
        elif took_s > SLOW_S:
            words = f"took {took_s:.1f} s, and the part cannot beat meanwhile: keep it below {SLOW_S} s"
            self.report(_name(function), words, kind="slow")
        return not failed

    def report(self, where: str, what: str, *, kind: str = "") -> None:
        """Say something once for each place and kind; without a kind, once for each text."""
        key = (where, kind or what)
        if key not in self._reported and len(self._reported) < MAX_REPORTS:
            self._reported.add(key)
            _log.error("%s: %s", where, what)

    def _shown(self, function: Callable[..., object]) -> str:
        """What people know it by: a function of theirs by its name, one of MsBOT's by its part."""
        return f"a step of {self.part or 'the part'}" if _is_own(function) else _name(function)

    def _failed(self, function: Callable[..., object], error: Exception) -> None:
        self.errors += 1
        where = line_of(error) or self._shown(function)
        if isinstance(error, ConfigError):
            self._mistake(ConfigError(f"{where}: {error}"))
            return
        words = f"{type(error).__name__}: {error} (said once, counted from now on)"
        self.report(where, words, kind=type(error).__name__)
        _log.debug("%s: the whole story (-v)", where, exc_info=error)


def _is_own(function: Callable[..., object]) -> bool:
    """Whether it is one of MsBOT's, as those of a simulated part: its name means nothing to people."""
    return (getattr(function, "__module__", None) or "").partition(".")[0] == "msbot"


def _name(function: Callable[..., object]) -> str:
    return getattr(function, "__name__", repr(function))
