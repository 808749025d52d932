"""Log lines for a terminal: input from strangers cannot forge or colour a line, and floods are only counted.

Log lines contain names, addresses and texts from outside. Control characters (escape sequences, line breaks, marks that
change the direction of writing) are shown as `\\x1b`, so that one event is one line and no outsider controls the
terminal. More than `SAME` equal lines within a minute, and more than `BURST` lines of one kind within ten seconds, are
counted instead of written; the count follows as a line of its own.
"""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Iterator
from typing import TextIO, TypeVar

from msbot.runtime.lazy_dataclass import dataclass

SAME = 5
REPEAT_S = 60.0
"""How often the same line is written in that time."""

BURST = 20
"""Lines of one kind, from one place in the code, that are written within `BURST_S`."""
BURST_S = 10.0

MOST_KINDS = 256
"""Lines and kinds that are remembered; beyond, the oldest are forgotten."""

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


@dataclass(slots=True)
class _Kind:
    until: float
    written: int = 0
    held: int = 0
    example: str = ""


class TerminalHandler(logging.StreamHandler[TextIO]):
    """Writes to standard error (see the module docstring)."""

    def __init__(self, line: str = "%(asctime)s %(message)s", stream: TextIO | None = None) -> None:
        super().__init__(stream or sys.stderr)
        self.setFormatter(PlainFormatter(line, datefmt="%H:%M:%S"))
        self._lines: dict[tuple[str, str], _Kind] = {}
        self._places: dict[tuple[str, int], _Kind] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Write the record, or only count it; the count is written when the period ends."""
        for due in self._over(record.created):
            super().emit(due)
        if getattr(record, "msbot_always", False):  # see `log_forms.ALWAYS`
            super().emit(record)
            return
        text = record.getMessage()
        same = _kind(self._lines, (record.name, text), record.created + REPEAT_S)
        alike = _kind(self._places, (record.pathname, record.lineno), record.created + BURST_S)
        if same.written >= SAME:
            same.held += 1
            same.example = text
        elif alike.written >= BURST:
            alike.held += 1
            alike.example = text
        else:
            same.written += 1
            alike.written += 1
            super().emit(record)

    def close(self) -> None:
        """Write the counts that are still outstanding."""
        for due in self._over(float("inf")):
            super().emit(due)
        super().close()

    def _over(self, now: float) -> list[logging.LogRecord]:
        return [*_take_over(self._lines, now), *_take_over(self._places, now)]


K = TypeVar("K")


def _kind(kinds: dict[K, _Kind], key: K, until: float) -> _Kind:
    kind = kinds.get(key)
    if kind is None:
        if len(kinds) >= MOST_KINDS:
            del kinds[next(iter(kinds))]
        kind = kinds[key] = _Kind(until)
    return kind


def _take_over(kinds: dict[K, _Kind], now: float) -> Iterator[logging.LogRecord]:
    for key in [key for key, kind in kinds.items() if kind.until <= now]:
        kind = kinds.pop(key)
        if kind.held:
            words = f"({kind.held} more like it were not written) {kind.example}"
            yield logging.LogRecord("msbot", logging.WARNING, "", 0, words, None, None)
