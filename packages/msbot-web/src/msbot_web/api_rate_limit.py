"""How often the API may be called: by one person or program, and from one address. STOP may always be said.

A call takes the robot's loop a millisecond or two, some much more. A program that asks again and again without a pause
would have the loop for itself; here it is told when to ask next, which costs little.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Hashable

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from msbot_agent.pace import SteadyRate
from msbot_agent.text.sentence import said
from msbot_web.access.sessions import Session
from msbot_web.language import language_of
from msbot_xrce.counting import Tally, amount

CALLS_PER_S = 50.0
"""For a person in all browsers, for each API token, and for a guest."""
BURST = 500.0
"""Calls that may come at once after a pause."""
ADDRESS_CALLS_PER_S = 200.0
ADDRESS_BURST = 1000.0
"""A whole school may come from one address."""
SAY_S = 60.0
PERSON, ADDRESS = "a person or program", "an address"

_log = logging.getLogger(__name__)


class ApiRateLimit:
    """ASGI middleware, see the module's docstring.

    Args:
        app: everything behind it; the guard in front of it has put the session into the request's state.
        paths: how the paths begin that are counted.
        but: the one path that begins like these and is never refused.
        clock: seconds, monotonic.
    """

    def __init__(self, app: ASGIApp, paths: tuple[str, ...], but: str, clock: Callable[[], float]) -> None:
        self._app = app
        self._paths = paths
        self._but = but
        self._clock = clock
        self._people = SteadyRate(CALLS_PER_S, BURST)
        self._addresses = SteadyRate(ADDRESS_CALLS_PER_S, ADDRESS_BURST)
        self._told_at = -math.inf
        self.refused = Tally()
        """Calls that were not answered, by who has called too often."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or say when to ask again."""
        path = scope["path"] if scope["type"] == "http" else ""
        if not path.startswith(self._paths) or path == self._but:
            await self._app(scope, receive, send)
            return
        now, session = self._clock(), scope.get("state", {}).get("session")
        address = (scope.get("client") or ("",))[0]
        calls = [(self._addresses, address, ADDRESS)]
        if isinstance(session, Session):
            calls.append((self._people, _caller(session), PERSON))
        wait_s, pace, who = max(((pace.wait_s(caller, now), pace, who) for pace, caller, who in calls), key=_first)
        if wait_s > 0.0:
            self._count(who, session, address, now)
            await _refuse(scope, send, wait_s, pace, who)
            return
        for pace, caller, _ in calls:
            pace.note(caller, now)
        await self._app(scope, receive, send)

    def _count(self, who: str, session: object, address: str, now: float) -> None:
        self.refused.count(who)
        if now - self._told_at >= SAY_S:
            self._told_at = now
            name = session.name if isinstance(session, Session) else "somebody"
            _log.warning(
                "the API is called too often by %s from %s: %s refused so far",
                name,
                address,
                amount(sum(self.refused.values()), "call"),
            )


def _first(one: tuple[float, SteadyRate, str]) -> float:
    return one[0]


def _caller(session: Session) -> Hashable:
    """What belongs together: a person's browsers; each of their programs and each guest stands alone."""
    return session.program or (session.key if session.guest_of else (session.name, session.is_lasting))


async def _refuse(scope: Scope, send: Send, wait_s: float, pace: SteadyRate, who: str) -> None:
    seconds, per_s = math.ceil(wait_s), f"{pace.per_s:g}"
    words = (
        said(
            "more than {per_s} calls a second come from your address: ask again in {seconds} s",
            per_s=per_s,
            seconds=seconds,
        )
        if who is ADDRESS
        else said(
            "you make more than {per_s} calls a second: ask again in {seconds} s, and less often",
            per_s=per_s,
            seconds=seconds,
        )
    )
    headers = [(b"content-type", b"application/json"), (b"retry-after", str(seconds).encode())]
    body = json.dumps({"error": language_of(HTTPConnection(scope)).translate(words)}).encode()
    await send({"type": "http.response.start", "status": 429, "headers": headers})
    await send({"type": "http.response.body", "body": body})
