"""Logging: to a terminal, to the journal, as JSON; bounded.

`LogLimiter` decides which lines are written and which only counted, so that nobody can fill a log. A kind is what one
place in the code says, or one text word for word. Of each kind a few lines are written; further ones are counted, and
the count is told when a period ends. As long as more keep coming, none of them is written, and each period is twice
as long as the one before, up to an hour: a flood of days is some dozens of lines. A kind of which nothing came for a
whole period is written again.
"""

from __future__ import annotations

import json
import logging
import os
import re
import sys
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Final, Generic, TextIO, TypeVar

from msbot_agent.process.user_folders import room_of
from msbot_xrce.lazy import dataclass

SAME = 5
REPEAT_S = 60.0
"""How often the same text is written in that time."""
BURST = 20
"""Lines of one kind, from one place in the code, that are written within `BURST_S` unless told otherwise."""
BURST_S = 10.0
LONGEST_S = 3600.0
MOST_KINDS = 256
"""Texts and places that are remembered; beyond, the oldest are forgotten."""

K = TypeVar("K")


@dataclass(slots=True)
class _Kind:
    until: float
    span_s: float
    written: int = 0
    held: int = 0
    example: str = ""


class _Kinds(Generic[K]):
    """Texts, or places."""

    def __init__(self, allowed: int, first_s: float) -> None:
        self._allowed = allowed
        self._first_s = first_s
        self._kinds: dict[K, _Kind] = {}

    def __len__(self) -> int:
        return len(self._kinds)

    def is_exhausted(self, key: K, text: str, now: float) -> bool:
        """Whether one more line is not written; it is counted then."""
        kind = self._kinds.get(key)
        if kind is None:
            if len(self._kinds) >= MOST_KINDS:
                del self._kinds[next(iter(self._kinds))]
            kind = self._kinds[key] = _Kind(now + self._first_s, self._first_s)
        if kind.written < self._allowed:
            return False
        kind.held += 1
        kind.example = text
        return True

    def wrote(self, key: K) -> None:
        """A line was written."""
        if (kind := self._kinds.get(key)) is not None:
            kind.written += 1

    def over(self, now: float) -> Iterator[str]:
        """What is to be told of the periods that have ended."""
        for key in [key for key, kind in self._kinds.items() if kind.until <= now]:
            kind = self._kinds[key]
            if not kind.held:
                del self._kinds[key]
                continue
            yield f"({kind.held} more like it were not written) {kind.example}"
            kind.held, kind.written = 0, self._allowed
            kind.span_s = min(2 * kind.span_s, LONGEST_S)
            kind.until = now + kind.span_s


class LogLimiter:
    """See the module's docstring."""

    def __init__(self, burst: int = BURST) -> None:
        """`burst`: lines from one place in the code that are written within `BURST_S`."""
        self._texts: _Kinds[tuple[str, str]] = _Kinds(SAME, REPEAT_S)
        self._places: _Kinds[tuple[str, int]] = _Kinds(burst, BURST_S)

    def __len__(self) -> int:
        """How many kinds are remembered."""
        return len(self._texts) + len(self._places)

    def writes(self, record: logging.LogRecord) -> bool:
        """Whether the record is to be written."""
        place, now = (record.pathname, record.lineno), record.created
        text = record.getMessage()
        words = (record.name, text)
        if self._places.is_exhausted(place, text, now) or self._texts.is_exhausted(words, text, now):
            return False
        self._places.wrote(place)
        self._texts.wrote(words)
        return True

    def overdue_counts(self, now: float) -> list[logging.LogRecord]:
        """The counts that are to be written now; `inf`: all that are outstanding."""
        told = [*self._texts.over(now), *self._places.over(now)]
        return [logging.LogRecord("msbot", logging.WARNING, "", 0, words, None, None) for words in told]


def write_by_root_alone() -> None:
    """Take away the handlers that libraries have given their own loggers: their lines go where all others go, and are
    bounded as those are."""
    for logger in list(logging.root.manager.loggerDict.values()):
        if isinstance(logger, logging.Logger):
            for handler in list(logger.handlers):
                if isinstance(handler, logging.StreamHandler):
                    logger.removeHandler(handler)
                    logger.propagate = True


# Log lines for a terminal: input from strangers cannot forge or colour a line, and floods are only counted.
#
# Log lines contain names, addresses and texts from outside. Control characters (escape sequences, line breaks, marks
# that change the direction of writing) are shown as `\x1b`, so that one event is one line and no outsider controls
# the terminal. How many lines of one kind are written is bounded (`log_limiter`); the others are counted.


_UNSAFE = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """The text with every control character made visible, on one line."""
    return _UNSAFE.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


class EscapingFormatter(logging.Formatter):
    """One record, one line; a traceback keeps its lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """See `logging.Formatter`."""
        record.message = plain(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: object) -> str:
        """See `logging.Formatter`."""
        return "\n".join(map(plain, super().formatException(ei).split("\n")))  # type: ignore[arg-type]


class TerminalHandler(logging.StreamHandler[TextIO]):
    """Writes to standard error unless told otherwise."""

    def __init__(
        self, line: str = "%(asctime)s %(message)s", stream: TextIO | None = None, *, burst: int = BURST
    ) -> None:
        """`burst`: lines of one kind that are written in a row."""
        super().__init__(stream or sys.stderr)
        self.setFormatter(EscapingFormatter(line, datefmt="%H:%M:%S"))
        self._limiter = LogLimiter(burst)

    def emit(self, record: logging.LogRecord) -> None:
        """Write the record, or only count it; the count is written when the period ends."""
        for due in self._limiter.overdue_counts(record.created):
            super().emit(due)
        # What says `log_forms.ALWAYS` is written however much of it there is.
        if getattr(record, "msbot_always", False) or self._limiter.writes(record):
            super().emit(record)

    def close(self) -> None:
        """Write the counts that are still outstanding."""
        for due in self._limiter.overdue_counts(float("inf")):
            super().emit(due)
        super().close()


# Other forms of log lines than that for a terminal: JSON for programs, and what systemd's journal understands.


FIELDS: Final = "msbot_fields"
"""Attribute of a record with values that belong to its message, for programs."""
ALWAYS: Final = "msbot_always"
"""Attribute of a record that is written however many like it there are."""

_PRIORITIES: Final = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))


class JsonFormatter(logging.Formatter):
    """One record, one JSON object on one line; anything but ASCII is escaped, so nothing can break out of it."""

    def format(self, record: logging.LogRecord) -> str:
        """See `logging.Formatter`."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "room": room_of(record.name),
            "logger": record.name,
            "message": record.getMessage(),
        }
        fields = getattr(record, FIELDS, None)
        if isinstance(fields, Mapping):
            line.update(fields)
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class JournalFormatter(EscapingFormatter):
    """Lines with their priority in front, as systemd's journal takes them from standard error (sd-daemon(3))."""

    def __init__(self) -> None:
        super().__init__("%(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """See `logging.Formatter`; each line of a traceback has its priority, too."""
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).split("\n"))


def goes_to_journal(stream: TextIO) -> bool:
    """Whether standard output or standard error is connected to systemd's journal (systemd.exec(5),
    JOURNAL_STREAM)."""
    device, _, number = os.environ.get("JOURNAL_STREAM", "").partition(":")
    if not (device.isdecimal() and number.isdecimal()):
        return False
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):  # closed, or no file, as in tests
        return False
    return (status.st_dev, status.st_ino) == (int(device), int(number))
