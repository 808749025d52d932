"""Pages are made one after another, and so many are open at a time: whoever asks for pages without end holds nobody up.

Making a page takes the robot's loop tens of milliseconds and keeps about a megabyte. Between two of them everything
else has its turn, STOP among it. Who has many pages open loses those that no browser has connected to, and gets no more
when all are connected; who has asked many times and not waited for the answer gets none either.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter, deque
from collections.abc import Iterable

from nicegui import Client
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from msbot.runtime.tally import Tally
from msbot.web.access.sessions import Session

MOST_WAITING = 8
"""Pages that one session may be waiting for."""
MOST_OPEN = 40
"""Pages that one session may have open."""
MOST_IN_ALL = 400
LONGEST_S = 0.3
"""A page that waits, for the database for instance, lets others go first after that time."""
NOT_CONNECTED_S = 5.0
"""How long a page that is being loaded is left alone; it connects within that time."""
WAITING = "so many of your pages are being made: wait until they are there"
OPEN = "so many of your pages are open: close some of them"


class PageTurns:
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
        self.refused = Tally()
        """Pages that were not made, by reason in words."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through in its turn."""
        session = scope.get("state", {}).get("session")
        if scope["type"] != "http" or not isinstance(session, Session) or not _is_page(scope["path"]):
            await self._app(scope, receive, send)
            return
        words = self._refusal(session)
        if words:
            self.refused.count(words)
            await _refuse(send, words)
            return
        turn = await self._begin(session)

        async def answer(message: Message) -> None:
            self._end(turn)  # it is made: whoever reads it slowly holds nobody up
            await send(message)

        try:
            await self._app(scope, receive, answer)
        finally:
            self._end(turn)

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


async def _refuse(send: Send, words: str) -> None:
    headers = [
        (b"content-type", b"text/plain; charset=utf-8"), (b"retry-after", b"1"), (b"cache-control", b"no-store"),
    ]  # fmt: skip
    await send({"type": "http.response.start", "status": 429, "headers": headers})
    await send({"type": "http.response.body", "body": f"{words[0].upper()}{words[1:]}.\n".encode()})
