"""Pages are made one after another, and so many are open at a time: whoever asks for pages without end holds nobody up.

Making a page takes the robot's loop tens of milliseconds and keeps about a megabyte. Between two of them everything
else has its turn, STOP among it. Who has many pages open loses those that no browser has connected to, and gets no more
when all are connected; who has asked many times and not waited for the answer gets none either.

After a restart all pages of a class want to be made anew at once. They ask for their turn first (`/turn`) and are told
when it is, so that each stays on the screen, with STOP, until the robot has time for the next.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter, deque
from collections.abc import Iterable

from nicegui import Client
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from msbot_web.access.access_middleware import TURN_PATH
from msbot_web.access.content_policy import refuse
from msbot_web.access.sessions import Session
from msbot_xrce.counting import Tally

MOST_WAITING = 8
"""Pages that one session may be waiting for."""
MOST_OPEN = 40
"""Pages that one session may have open."""
MOST_IN_ALL = 400
LONGEST_S = 0.3
"""A page that waits, for the database for instance, lets others go first after that time."""
NOT_CONNECTED_S = 5.0
"""How long a page that is being loaded is left alone; it connects within that time."""
LEAST_STEP_S, LONGEST_STEP_S = 0.03, 0.25
"""Between two turns that are given: as long as making a page has taken lately."""
LONGEST_TURN_S = 10.0
"""Turns are given so far ahead; who asks then is told to ask again."""
WAITING = "too many of your pages are being loaded: wait until they are there"
OPEN = "too many of your pages are open: close some of them"
LATER = "too many pages are being loaded: try again in a moment"


class PageAdmission:
    """ASGI middleware, see the module's docstring.

    Args:
        app: everything behind it; the guard in front of it has put the session into the request's state.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._holder: asyncio.Future[None] | None = None
        self._patience: asyncio.TimerHandle | None = None
        self._queue: deque[asyncio.Future[None]] = deque()
        self._waiting: Counter[int] = Counter()
        """By session."""
        self._made_s = LEAST_STEP_S
        """How long making a page takes, by the last ones."""
        self._next_turn_at = 0.0
        self._given: dict[int, deque[float]] = {}
        """By session: the turns to come that it was given."""
        self.refused = Tally()
        """Pages that were not made, by reason in words."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through in its turn."""
        session = scope.get("state", {}).get("session")
        if scope["type"] != "http" or not isinstance(session, Session):
            await self._app(scope, receive, send)
            return
        if scope["path"] == TURN_PATH:
            await self._give_turn(scope, send, session)
            return
        if not _is_page(scope["path"]):
            await self._app(scope, receive, send)
            return
        words = self._refusal(session)
        if words:
            self.refused.count(words)
            await refuse(scope, send, 429, words, session=session, headers=[(b"retry-after", b"1")])
            return
        turn = await self._begin(session)
        loop = asyncio.get_running_loop()
        began, is_made = loop.time(), False

        async def answer(message: Message) -> None:
            nonlocal is_made
            if not is_made:
                is_made = True
                self._made_s += (min(loop.time() - began, LONGEST_S) - self._made_s) / 8
            self._end(turn)  # it is made: whoever reads it slowly holds nobody up
            await send(message)

        try:
            await self._app(scope, receive, answer)
        finally:
            self._end(turn)

    async def _give_turn(self, scope: Scope, send: Send, session: Session) -> None:
        words = self._refusal(session)  # a page would be refused: it need not come for that
        wait_s = None if words else self.turn_s(session, asyncio.get_running_loop().time())
        if wait_s is None:
            words = words or LATER
            self.refused.count(words)
            await refuse(scope, send, 429, words, session=session, headers=[(b"retry-after", b"2")])
            return
        body = json.dumps({"wait_ms": round(1000 * wait_s)}).encode()
        headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": body})

    def turn_s(self, session: Session, now: float) -> float | None:
        """When a page of that session would be made, in seconds from now; None: nobody can say yet.

        Who asks again and again pushes nobody back: beyond `MOST_WAITING` turns to come it is told its last one.
        """
        for one in [one for one, turns in self._given.items() if turns[-1] < now]:
            del self._given[one]
        own = self._given.setdefault(id(session), deque())
        while own and own[0] < now:
            own.popleft()
        if len(own) >= MOST_WAITING:
            return own[-1] - now
        at = max(now, self._next_turn_at)
        if at - now > LONGEST_TURN_S:
            if not own:
                del self._given[id(session)]
            return None
        self._next_turn_at = at + min(max(self._made_s, LEAST_STEP_S), LONGEST_STEP_S)
        own.append(at)
        return at - now

    def _refusal(self, session: Session) -> str:
        if self._waiting[id(session)] >= MOST_WAITING:
            return WAITING
        own = [one for one in Client.instances.values() if _session_of(one) is session]
        if len(own) >= MOST_OPEN and not _close_one(own):
            return OPEN
        if len(Client.instances) >= MOST_IN_ALL and not _close_one(_of_the_one_with_most(Client.instances.values())):
            return OPEN
        return ""

    async def _begin(self, session: Session) -> asyncio.Future[None]:
        turn = asyncio.get_running_loop().create_future()
        self._queue.append(turn)
        self._waiting[id(session)] += 1
        try:
            if self._holder is None:
                self._next()
            await turn
        except asyncio.CancelledError:
            self._end(turn)
            raise
        finally:
            self._waiting[id(session)] -= 1
            if not self._waiting[id(session)]:
                del self._waiting[id(session)]
        return turn

    def _end(self, turn: asyncio.Future[None]) -> None:
        if self._holder is turn:
            self._next()

    def _next(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
        self._holder = self._patience = None
        while self._queue:
            turn = self._queue.popleft()
            if not turn.done():
                turn.set_result(None)
                self._holder = turn
                self._patience = asyncio.get_running_loop().call_later(LONGEST_S, self._end, turn)
                return


def _is_page(path: str) -> bool:
    """Whether NiceGUI makes a page for that path; the handbook's pictures are none."""
    rooms = {route.split("/")[1] for route in Client.page_routes.values()}
    return path.split("/")[1] in rooms and not path.startswith("/handbook/pictures/")


def _session_of(client: Client) -> object:
    return client.request.scope.get("state", {}).get("session")


def _of_the_one_with_most(clients: Iterable[Client]) -> list[Client]:
    by_session: dict[int, list[Client]] = {}
    for client in clients:
        by_session.setdefault(id(_session_of(client)), []).append(client)
    return max(by_session.values(), key=len)


def _close_one(clients: list[Client]) -> bool:
    """Close the oldest that no browser is connected to; False: there is none."""
    now = time.time()  # as NiceGUI's own
    for client in clients:
        if not client.has_socket_connection and client.created < now - NOT_CONNECTED_S:
            client.delete()
            return True
    return False
