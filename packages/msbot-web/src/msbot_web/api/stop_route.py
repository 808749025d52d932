"""The call of STOP: it is there before all others, waits for nothing that can run out, and no body makes it refused.

It needs no thread, and answers when STOP is stored, or when it is known that it cannot be. What is odd about the body
is dropped: it holds nothing but the reason. Who may say STOP is checked as everywhere.

A page whose answer is late says its STOP again, under the same name of the press. While that STOP holds, it is answered
as it was. When somebody has ended it since, the same press is no new STOP, and is refused in words; after `PRESS_S` it
is one.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from msbot.operations.table import OPERATIONS
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import read_program_json
from msbot_web.access.access_middleware import STOP_PATH
from msbot_web.api.dependencies import session_of
from msbot_web.language import language_of
from msbot_web.models.common_models import PROBLEMS
from msbot_web.models.robot_models import StopResult
from msbot_web.service import Service
from msbot_xrce.lazy import dataclass

STOP = OPERATIONS["stop"]

PRESS_HEADER = "x-stop-press"
MOST_PRESSES = 64
"""Presses of STOP that are known again."""
LONGEST_PRESS = 64
"""Longest name of a press, in characters; a longer one is none."""
PRESS_S = 30.0
"""How long a press is known again after its STOP is over; a page says one again every second until it has an answer."""
MOST_BODY = 32 * 1024
"""Octets that are read of a body: the longest reason fits, whatever letters it is of."""
BODY_S = 0.25
"""How long a body is waited for."""

_BODY = {
    "requestBody": {
        "description": "The reason, if there is one. Whatever is odd about a body is dropped, and STOP is said.",
        "content": {
            "application/json": {
                "schema": {
                    "type": "object",
                    "properties": {one.name: {"type": "string", "description": one.help} for one in STOP.arguments},
                }
            }
        },
    }
}


@dataclass(slots=True)
class _Press:
    """A press of STOP that has a name."""

    at: float
    saying: asyncio.Task[StopResult]


def make_stop_api(service: Service) -> APIRouter:
    """The call of STOP alone."""
    router = APIRouter(responses=PROBLEMS)
    call = StopRoute(service)

    async def stop(request: Request) -> StopResult | Response:
        return await call(request)

    stop.__doc__ = STOP.summary
    router.add_api_route(
        STOP_PATH, stop, methods=["POST"], name=STOP.name, response_model=StopResult, openapi_extra=_BODY
    )
    return router


class StopRoute:
    """See the module's docstring."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._presses: dict[tuple[str, str], _Press] = {}

    async def __call__(self, request: Request) -> StopResult | Response:
        """Say STOP, and answer."""
        session = session_of(request)
        name = request.headers.get(PRESS_HEADER, "")
        if not 0 < len(name) <= LONGEST_PRESS:  # no name is a reason to refuse a STOP
            return await self._say(request)
        named, now = (session.name, name), asyncio.get_running_loop().time()
        press = self._presses.get(named)
        if press is not None and press.saying.done() and not self._holds(press.saying.result().stop):
            if now - press.at < PRESS_S:
                return _over(request)
            press = None
        if press is None:
            press = self._presses[named] = _Press(now, asyncio.ensure_future(self._say(request)))
            press.saying.add_done_callback(partial(self._ended, named))
            while len(self._presses) > MOST_PRESSES:
                del self._presses[next(iter(self._presses))]
        else:
            press.at = now
        return await asyncio.shield(press.saying)

    def _ended(self, named: tuple[str, str], saying: asyncio.Task[StopResult]) -> None:
        """What was not said may be tried again; it is told to who waits, if somebody still does."""
        if saying.cancelled() or saying.exception() is not None:
            self._presses.pop(named, None)

    def _holds(self, number: int) -> bool:
        status = self._service.operations.stopping.status
        return status.stopped and number >= status.first

    async def _say(self, request: Request) -> StopResult:
        given = await _given(request)
        who = self._service.asker(session_of(request))
        outcome = await self._service.operations.do(
            STOP.name, who=who, **{one.name: given.get(one.name) for one in STOP.arguments}
        )
        return StopResult.model_validate({"words": outcome.words, **outcome.answer})


async def _given(request: Request) -> Mapping[str, Any]:
    """What the body says, as far as it makes sense and comes in time."""
    octets = b""
    try:
        async with asyncio.timeout(BODY_S):
            async for piece in request.stream():
                octets += piece
                if len(octets) > MOST_BODY:
                    break
    except (TimeoutError, ClientDisconnect):
        pass  # whoever has sent this much means STOP
    try:
        found = read_program_json(octets)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _over(request: Request) -> Response:
    words = said("This STOP was said before, and somebody has ended it since: the robot may move. Press STOP again")
    return JSONResponse({"error": language_of(request).translate(words)}, 409)
