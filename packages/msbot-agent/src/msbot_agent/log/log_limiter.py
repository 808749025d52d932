"""Which lines of a log are written, and which only counted, so that nobody can fill it. Pure: time is in the records.

A kind is what one place in the code says, or one text word for word. Of each kind a few lines are written; further ones
are counted, and the count is told when a period ends. As long as more keep coming, none of them is written, and each
period is twice as long as the one before, up to an hour: a flood of days is some dozens of lines. A kind of which
nothing came for a whole period is written again.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Generic, TypeVar

from msbot_xrce.common.lazy_dataclass import dataclass

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

    def over(self, now: float) -> list[logging.LogRecord]:
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
