"""Errors of pages in the log: the same one is written once a minute, with how often it came meanwhile.

A page's function that fails is a mistake of ours, and its traceback is wanted; but whoever opens that page could write
it as often as they like.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from msbot_xrce.counting import amount

SAY_S = 60.0
MOST_PLACES = 64
"""Places in the code that are remembered."""


class RepeatedErrorFilter(logging.Filter):
    """Lets the same error from the same place through once in `SAY_S`."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._places: dict[tuple[str, str, int], tuple[float, int]] = {}
        """When an error was written there, and how many were held back since."""

    def filter(self, record: logging.LogRecord) -> bool:
        """See `logging.Filter`."""
        error = record.exc_info[1] if record.exc_info else record.msg
        if not isinstance(error, BaseException):
            return True
        place, now = _place_of(error), self._clock()
        said_at, held = self._places.pop(place, (-SAY_S, 0))
        if now - said_at < SAY_S:
            self._places[place] = said_at, held + 1
            return False
        self._places[place] = now, 0
        if len(self._places) > MOST_PLACES:
            del self._places[next(iter(self._places))]
        if held:
            record.msg, record.args = (
                "%s (and %s before, since it was said last)",
                (record.getMessage(), amount(held, "time")),
            )
        return True


def limit_repeated_errors() -> None:
    """Have NiceGUI's log do so."""
    log = logging.getLogger("nicegui")
    if not any(isinstance(one, RepeatedErrorFilter) for one in log.filters):
        log.addFilter(RepeatedErrorFilter())


def _place_of(error: BaseException) -> tuple[str, str, int]:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return type(error).__name__, "", 0
    return type(error).__name__, trace.tb_frame.f_code.co_filename, trace.tb_lineno
