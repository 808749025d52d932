"""Errors of pages in the log: the same one is written once a minute, with how often it came; who leaves is none.

A page's function that fails is a mistake of ours, and its traceback is wanted; but whoever opens that page could write
it as often as they like. What a browser says with an event, and none of our pages could have said, is no mistake of
ours: it is counted like other nonsense.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import nicegui
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from msbot_web.nicegui_internals.page_sockets import COMPLAINTS, NONSENSE
from msbot_xrce.counting import amount

SAY_S = 60.0
MOST_PLACES = 64
"""Places in the code that are remembered."""


class NotFromOurPage(Exception):
    """An event came with something that no page of ours sends."""


@contextmanager
def read_from_browser() -> Iterator[None]:
    """Around what takes apart that with which an event came: what does not fit is the browser's fault.

    Raises:
        NotFromOurPage: it does not fit.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise NotFromOurPage(type(error).__name__) from error


_DOES_NOT_FIT = (LookupError, TypeError, ValueError, OverflowError, AttributeError)
_EVENTS = "handle_event"
"""The function of NiceGUI that has an event handled."""
_NICEGUI = str(Path(nicegui.__file__).parent)


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
        if isinstance(error, NotFromOurPage) or _is_of_nicegui_alone(error):
            kind = str(error) if isinstance(error, NotFromOurPage) else type(error).__name__
            COMPLAINTS.count(NONSENSE, f"event: {kind}")
            return False
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


_RECEIVE = "msbot.receive"
_HANDLED = "msbot.handled"


class HandledErrors:
    """Around the pages: an error that has been handled is not raised again, and whoever handles one can ask who waits.

    Starlette hands its last handler a request that cannot hear the visitor, and raises the error once more after it.

    Args:
        app: the pages.
        log: where it is said that visitors have left, once a minute with their number.
        clock: seconds.
    """

    def __init__(self, app: ASGIApp, log: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._app = app
        self._log = log
        self._clock = clock
        self._said_at = -SAY_S
        self.left = 0
        """Visitors who left before their page was made."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        state = scope.setdefault("state", {})
        state[_RECEIVE] = receive
        try:
            await self._app(scope, receive, send)
        except Exception:
            if _HANDLED not in state:
                raise
            if state[_HANDLED] == "left":
                self._count()

    def _count(self) -> None:
        self.left += 1
        now = self._clock()
        if now - self._said_at >= SAY_S:
            self._said_at = now
            self._log.info("%s left before the page was made", amount(self.left, "visitor"))


async def somebody_waits(request: Request) -> bool:
    """Whether the visitor of a request whose page could not be made is still there; `HandledErrors` is told."""
    state = request.scope.setdefault("state", {})
    receive: Receive | None = state.get(_RECEIVE)
    waits = receive is None or not await Request(request.scope, receive).is_disconnected()
    state[_HANDLED] = "told" if waits else "left"
    return waits


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


def _is_of_nicegui_alone(error: BaseException) -> bool:
    """Whether NiceGUI's own elements could not take apart that with which an event came: no code of ours had a part."""
    trace, is_event = error.__traceback__, False
    while trace is not None:
        code = trace.tb_frame.f_code
        is_nicegui = code.co_filename.startswith(_NICEGUI)
        is_event = is_event or (is_nicegui and code.co_name == _EVENTS)
        if is_event and not is_nicegui:
            return False
        trace = trace.tb_next
    return is_event and isinstance(error, _DOES_NOT_FIT)
