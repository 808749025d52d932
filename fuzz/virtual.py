"""Virtual time with a budget of turns, and nothing hidden: what a call-back raises comes out at the end."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Coroutine
from typing import TypeVar

from fuzz.case import Violation
from msbot.process.virtual_time import VirtualTimeLoop

_T = TypeVar("_T")

TURNS = 400_000
"""Looks at the clock in one case; every turn of the loop needs one. A long case has a tenth of that."""


class BudgetLoop(VirtualTimeLoop):
    """A virtual-time loop that does not turn for ever, and that keeps what call-backs raise."""

    def __init__(self, turns: int = TURNS) -> None:
        self.left = turns
        self.errors: list[BaseException] = []
        super().__init__()
        self.set_exception_handler(self._note)

    def time(self) -> float:
        """Seconds of virtual time.

        Raises:
            Violation: the budget is used up.
        """
        self.left -= 1
        if self.left < 0:
            raise Violation("the step budget is used up: something goes round without end")
        return super().time()

    def check(self) -> None:
        """Raise the first thing that a call-back raised."""
        if self.errors:
            raise self.errors[0]

    def _note(self, _loop: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        error = context.get("exception")
        self.errors.append(error if isinstance(error, BaseException) else Violation(str(context.get("message"))))


def play(main: Coroutine[object, object, _T], turns: int = TURNS) -> _T:
    """Run a coroutine to its end in virtual time; raises also what a call-back raised meanwhile."""
    loop = BudgetLoop(turns)
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        try:
            result = runner.run(main)
        finally:
            loop.left = sys.maxsize
    loop.check()
    return result


def the_loop() -> BudgetLoop:
    """The running loop."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, BudgetLoop)
    return loop


class LogReader(logging.Handler):
    """Makes the text of every log line, so that one which cannot be made is a finding; and remembers the templates."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.templates: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Take one line."""
        record.getMessage()
        self.templates.add(f"log: {record.msg}")

    def take(self) -> set[str]:
        """The templates since the last call."""
        templates, self.templates = self.templates, set()
        return templates


def read_logs() -> LogReader:
    """Read the log lines of the whole package instead of printing them."""
    logger = logging.getLogger("msbot")
    for handler in logger.handlers:
        if isinstance(handler, LogReader):
            return handler
    reader = LogReader()
    logger.addHandler(reader)
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    return reader
