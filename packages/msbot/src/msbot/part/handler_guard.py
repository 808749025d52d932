"""A student's functions: checked when they are handed over, guarded when they are called.

A mistake in a handler must neither end the part nor flood the screen: it is reported once with file and line, and
counted.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
from collections.abc import Callable
from types import GeneratorType
from typing import TYPE_CHECKING

from msbot.part.program_mistakes import line_of
from msbot.part.waiting import Waiting, WaitingFunctions
from msbot_xrce.errors import ConfigError, MsbotError

if TYPE_CHECKING:
    from greenlet import greenlet

_log = logging.getLogger("msbot.part")

SLOW_S = 0.5
"""A handler that takes longer is reported: while it runs, the part cannot send beats."""
MAX_REPORTS = 100
"""How many different errors are reported; further ones are only counted."""


def check_handler(function: Callable[..., object], arguments: str = "", *, at_once: str = "") -> str:
    """Refuse what cannot be a handler; returns its name for messages.

    Args:
        function: the handler.
        arguments: the names of its arguments, with a comma between them; "" = none.
        at_once: the decorator, if the function must not wait.

    Raises:
        ConfigError: it is not a plain function, or does not take these arguments.
    """
    name = getattr(function, "__name__", repr(function))
    if not callable(function):
        raise ConfigError(f"a handler must be a function, not {function!r}")
    if inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function):
        raise ConfigError(f"{name} is an `async def`: a handler must be a plain function (`def {name}(...)`)")
    if at_once and inspect.isgeneratorfunction(function):
        raise ConfigError(f"{name} waits (`yield`), and what is below @part.{at_once} must be done at once")
    try:
        inspect.signature(function).bind(*([None] * len(arguments.split(",")) if arguments else []))
    except TypeError:
        takes = "no arguments"
        if arguments:
            takes = f"two arguments, {arguments}" if "," in arguments else f"one argument, the {arguments}"
        raise ConfigError(f"{name} must take {takes}: write `def {name}({arguments})`") from None
    except ValueError:
        _log.debug("%s has no signature to check", name)
    return name


class NotSafeYet(MsbotError):
    """Raised by a function that makes the part safe: the hardware was told, and has not reported it yet.

    STOP is not confirmed then. `Part.is_safe_now` has the function called again; so does each repetition of STOP.
    """


class _Turn:
    """One call of a handler."""

    __slots__ = ("function", "outer", "step", "waited_s")

    def __init__(self, function: Callable[..., object], step: Callable[..., object]) -> None:
        self.function = function
        self.step = step
        """What is called: the function, or what follows after a `yield` of it."""
        self.outer: tuple[Callable[..., object], float] | None = None
        """What `Guard.running` was before, and is again while it waits."""
        self.waited_s = 0.0


class Guard:
    """Calls handlers and keeps their errors away from the part."""

    def __init__(self, mistake: Callable[[ConfigError], None], failed: Callable[[str], None] = lambda _: None) -> None:
        """Make a guard.

        Args:
            mistake: called with a ConfigError raised by a handler: a mistake that must be fixed in the program.
            failed: called once with each other error of a handler, in words.
        """
        self._failed_words = failed
        self.part = ""
        """What the part is called; known when it runs."""
        self.errors = 0
        """Calls that ended with an error."""
        self._running: tuple[Callable[..., object], float] | None = None
        self.lets_wait = False
        """Whether functions may `wait`: each then runs on a stack of its own."""
        self.waiting = WaitingFunctions(self._next_step)
        """The functions that wait by `yield`."""
        self._mistake = mistake
        self._turns: dict[greenlet, _Turn] = {}
        """The functions that have begun and not ended, where they may wait."""
        self._reported: set[tuple[str, str]] = set()

    @property
    def running(self) -> tuple[str, float] | None:
        """The function that is running now and when it began, by the loop's clock."""
        running = self._running
        return None if running is None else (self._shown(running[0]), running[1])

    def call(self, function: Callable[..., object], *arguments: object) -> bool:
        """Call a handler; each kind of error at each line is reported once. False: it ended with an error, or waits.

        One that waits by `yield` has done its first step then, and this is True.
        """
        return self._do(function, self._begin, function, *arguments)

    def _begin(self, function: Callable[..., object], *arguments: object) -> None:
        made = function(*arguments)
        if isinstance(made, GeneratorType):
            self.waiting.begin(function, made)

    def _next_step(self, waiting: Waiting) -> None:
        self._do(waiting.function, self.waiting.go_on, waiting)

    def _do(self, function: Callable[..., object], step: Callable[..., object], *arguments: object) -> bool:
        if not self.lets_wait:
            return self._call(_Turn(function, step), arguments)
        from greenlet import greenlet

        stack = greenlet(self._call)
        turn = self._turns[stack] = _Turn(function, step)
        try:
            return stack.switch(turn, arguments) is True
        finally:
            self._forget_ended(stack)

    def is_waiting(self, function: Callable[..., object]) -> bool:
        """Whether a call of that handler has begun and waits."""
        return any(turn.function is function for turn in self._turns.values())

    def may_wait(self) -> bool:
        """Whether this is called by a handler that may `wait`."""
        if not self.lets_wait:
            return False
        from greenlet import getcurrent

        return getcurrent() in self._turns

    def wait(self, begin: Callable[[Callable[[object], None]], None]) -> object:
        """Let the part go on until somebody says that the handler may; called by the handler that waits.

        Args:
            begin: called with a function to be called later with what this returns.
        """
        from greenlet import getcurrent

        stack = getcurrent()
        turn, clock = self._turns[stack], asyncio.get_running_loop().time
        begin(lambda outcome: self._go_on(stack, outcome))
        began_at = clock()
        here, self._running = self._running, turn.outer
        try:
            assert stack.parent is not None
            return stack.parent.switch()
        finally:
            turn.outer, self._running = self._running, here
            turn.waited_s += clock() - began_at

    def _go_on(self, stack: greenlet, outcome: object) -> None:
        from greenlet import getcurrent

        stack.parent = getcurrent()
        try:
            stack.switch(outcome)
        finally:
            self._forget_ended(stack)

    def _forget_ended(self, stack: greenlet) -> None:
        if stack.dead:
            self._turns.pop(stack, None)

    def _call(self, turn: _Turn, arguments: tuple[object, ...]) -> bool:
        function, clock = turn.function, asyncio.get_running_loop().time
        began_at = clock()
        failed = False
        turn.outer, self._running = self._running, (function, began_at)
        try:
            turn.step(*arguments)
        except NotSafeYet as not_yet:
            _log.debug("%s: %s", self._shown(function), not_yet)
            failed = True
        except Exception as error:
            self._failed(function, error)
            failed = True
        finally:
            self._running = turn.outer
        took_s = clock() - began_at - turn.waited_s
        if took_s > SLOW_S and _is_own(function):
            words = f"one of its steps took {took_s:.1f} s, and it cannot beat meanwhile: this computer may be too busy"
            self.report(self.part or "a part", words, kind="slow")
        elif took_s > SLOW_S:
            words = f"took {took_s:.1f} s, and the part cannot beat meanwhile: keep it below {SLOW_S} s"
            self.report(_name(function), words, kind="slow")
        return not failed

    def report(self, where: str, what: str, *, kind: str = "") -> bool:
        """Say something once for each place and kind; without a kind, once for each text. False: it was said."""
        key = (where, kind or what)
        if key in self._reported or len(self._reported) >= MAX_REPORTS:
            return False
        self._reported.add(key)
        _log.error("%s: %s", where, what)
        return True

    def _shown(self, function: Callable[..., object]) -> str:
        """What people know it by: a function of theirs by its name, one of MsBOT's by its part."""
        return f"a step of {self.part or 'the part'}" if _is_own(function) else _name(function)

    def _failed(self, function: Callable[..., object], error: Exception) -> None:
        self.errors += 1
        where = line_of(error) or self._shown(function)
        if isinstance(error, ConfigError):
            self._mistake(ConfigError(f"{where}: {error}"))
            return
        words = f"{type(error).__name__}: {error}"
        if self.report(where, f"{words} (said once, counted from now on)", kind=type(error).__name__):
            self._failed_words(f"{where}: {words}")
        _log.debug("%s: the whole story (-v)", where, exc_info=error)


def _is_own(function: Callable[..., object]) -> bool:
    """Whether it is one of MsBOT's, as those of a simulated part: its name means nothing to people."""
    return (getattr(function, "__module__", None) or "").partition(".")[0] == "msbot"


def _name(function: Callable[..., object]) -> str:
    return getattr(function, "__name__", repr(function))
