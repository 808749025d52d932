"""Log lines for a terminal: input from strangers cannot forge or colour a line, and floods are only counted.

Log lines contain names, addresses and texts from outside. Control characters (escape sequences, line breaks, marks that
change the direction of writing) are shown as `\\x1b`, so that one event is one line and no outsider controls the
terminal. How many lines of one kind are written is bounded (`log_limiter`); the others are counted.
"""

from __future__ import annotations

import logging
import re
import sys
from typing import TextIO

from msbot_agent.log.log_limiter import BURST, LogLimiter

_UNSAFE = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """The text with every control character made visible, on one line."""
    return _UNSAFE.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


class PlainFormatter(logging.Formatter):
    """One record, one line; a traceback keeps its lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """See `logging.Formatter`."""
        record.message = plain(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: object) -> str:
        """See `logging.Formatter`."""
        return "\n".join(map(plain, super().formatException(ei).split("\n")))  # type: ignore[arg-type]


class TerminalHandler(logging.StreamHandler[TextIO]):
    """Writes to standard error unless told otherwise (see the module docstring)."""

    def __init__(
        self, line: str = "%(asctime)s %(message)s", stream: TextIO | None = None, *, burst: int = BURST
    ) -> None:
        """`burst`: lines of one kind that are written in a row."""
        super().__init__(stream or sys.stderr)
        self.setFormatter(PlainFormatter(line, datefmt="%H:%M:%S"))
        self._limiter = LogLimiter(burst)

    def emit(self, record: logging.LogRecord) -> None:
        """Write the record, or only count it; the count is written when the period ends."""
        for due in self._limiter.over(record.created):
            super().emit(due)
        # What says `log_forms.ALWAYS` is written however much of it there is.
        if getattr(record, "msbot_always", False) or self._limiter.writes(record):
            super().emit(record)

    def close(self) -> None:
        """Write the counts that are still outstanding."""
        for due in self._limiter.over(float("inf")):
            super().emit(due)
        super().close()
