"""The pages' connections: what may come in them, how fast, and how much may wait for a browser that reads slowly.

They are websockets, or requests one after another (long polling) where something in between lets no websocket through.
Such a connection belongs to the session that began it, whoever else should learn its number.

NiceGUI, socket.io and engine.io expect that the other end is their own JavaScript. Here everything that is not is
counted, said once a minute, and goes no further. A browser that sends too much is read more slowly; one that does not
take what it is sent loses its connection and, when it comes back, its page is there as it was or is made anew.
"""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import Awaitable, Callable, Hashable, Mapping
from functools import partial
from typing import Any, cast
from urllib.parse import parse_qs

from nicegui import core
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from msbot_agent.pace import SteadyRate
from msbot_web.access.access_middleware import SOCKET_PATH
from msbot_web.access.sessions import Session
from msbot_xrce.counting import Tally, amount

MESSAGES_PER_S = 200.0
"""What is read of one browser in all its tabs; a hand that draws moves some sixty times a second."""
BURST = 500.0
OCTETS = 4096
"""A message counts once more for each of so many: a long one takes as long to read as many short ones."""
MOST_WAITING = 2000
"""Packets that may wait for one browser."""
MOST_WAITING_OCTETS = 4 * 1024 * 1024
SEND_S = 20.0
"""How long a browser may take until there is room for the next packet."""
CLOSE_S = 1.0
SAY_S = 60.0
MOST_OF_SESSION = 80
"""Connections of one session by long polling, or on their way to one: each lives without a socket of its own."""
DEEPEST = 32
"""Objects and lists inside of each other with which an event comes."""
LONGEST_NAME = 100
"""Characters of what a browser calls its tab."""
TAB_S = 600.0
"""How long NiceGUI keeps what belongs to a tab; MsBOT keeps nothing there."""
TOO_SLOW = "does not take what it is sent"
NONSENSE = "is not what a page of ours sends"
STATE = "page_socket"
"""Where a request's state has its websocket."""

_BRACKET = re.compile(r"[\[\]{}]")
_DEEPER = {"[": 1, "{": 1, "]": -1, "}": -1}
_log = logging.getLogger(__name__)
_Handler = Callable[..., Any]


class BrowserComplaints:
    """Counts what is wrong with the browsers' ends, and says so at most once a minute for each reason."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.counts = Tally()
        self._clock = clock
        self._said: dict[str, float] = {}

    def count(self, reason: str, detail: str) -> None:
        """Count one; `detail` is one of few."""
        words = f"{reason} ({detail})"
        self.counts.count(words)
        now = self._clock()
        if now - self._said.get(reason, -SAY_S) >= SAY_S:
            self._said[reason] = now
            _log.warning("a browser of the page %s: %s so far", words, amount(self.counts.get(words, 0), "time"))


COMPLAINTS = BrowserComplaints()
"""Of this process, as NiceGUI is there once."""


class PageSocket:
    """One websocket of a page, between the server and engine.io.

    Args:
        receive: what the browser says.
        send: to the browser.
        pace: how much is read of a browser.
        whose: the browser, which may have other websockets.
    """

    def __init__(self, receive: Receive, send: Send, pace: SteadyRate, whose: Hashable) -> None:
        self._receive, self._send, self._clock = receive, send, asyncio.get_running_loop().time
        self._pace, self._whose = pace, whose
        self._is_over = False
        self._listening: asyncio.Timeout | None = None
        self._sending: asyncio.Timeout | None = None

    def end(self) -> None:
        """Close it, whatever it waits for."""
        if not self._is_over:
            self._is_over = True
            for wait in (self._listening, self._sending):
                if wait is not None and not wait.expired():
                    wait.reschedule(0.0)

    async def receive(self) -> Message:
        """What the browser says next, not faster than allowed."""
        if self._is_over:
            return _OVER
        now = self._clock()
        wait_s = self._pace.wait_s(self._whose, now)
        self._pace.note(self._whose, now)  # its turn is taken: others of this browser come after it
        try:
            async with asyncio.timeout(None) as self._listening:
                if wait_s > 0.0:
                    await asyncio.sleep(wait_s)
                message = await self._receive()
        except TimeoutError:
            return _OVER
        finally:
            self._listening = None
        text = message.get("text")
        if isinstance(text, str) and len(text) > OCTETS:
            self._pace.note(self._whose, self._clock(), len(text) / OCTETS)
        if message["type"] == "websocket.receive" and isinstance(text, str) and text[:1] not in _PACKETS:
            COMPLAINTS.count(NONSENSE, "no packet")
            return _OVER
        return message

    async def send(self, message: Message) -> None:
        """Something for the browser.

        Raises:
            OSError: it is over.
        """
        if self._is_over and message["type"] != "websocket.close":
            raise OSError("closed")
        patience = CLOSE_S if self._is_over else SEND_S
        try:
            async with asyncio.timeout(patience) as self._sending:
                await self._send(message)
        except TimeoutError:
            if not self._is_over:
                COMPLAINTS.count(TOO_SLOW, "for a long time")
                self.end()
            if message["type"] != "websocket.close":
                raise OSError("closed") from None
        finally:
            self._sending = None


_EXPECTED = re.compile(
    r"""0(\{.{0,1000}\})?$ | 1$ | 2\d{0,15}\["(handshake|event|javascript_response|ack|log|left)",""", re.VERBOSE
)
"""Messages of socket.io that a page of ours sends: it comes, goes, and says these things. (`connect`, said as one of
them, would be taken for coming.)"""
_OVER: Message = {"type": "websocket.disconnect", "code": 1008}
_PACKETS = tuple("0123456")


class Outgoing(asyncio.Queue[Any]):
    """What waits for one browser: bounded, unlike engine.io's own queue."""

    def __init__(self, on_full: Callable[[], None]) -> None:
        super().__init__()
        self._on_full = on_full
        self.octets = 0

    async def put(self, item: Any) -> None:  # noqa: ANN401 - as its base has it
        """Take one more; drops all of them when there are too many."""
        size = _size(item)
        if item is not None and (self.qsize() >= MOST_WAITING or 0 < self.octets > MOST_WAITING_OCTETS - size):
            COMPLAINTS.count(TOO_SLOW, "too much waits for it")
            while not self.empty():
                self.get_nowait()
                self.task_done()
            self._on_full()
            return
        await super().put(item)

    def _put(self, item: Any) -> None:  # noqa: ANN401
        self.octets += _size(item)
        super()._put(item)

    def _get(self) -> Any:  # noqa: ANN401
        item = super()._get()
        self.octets -= _size(item)
        return item


def _size(packet: object) -> int:
    data = getattr(packet, "data", None)
    return len(data) if isinstance(data, str | bytes) else 0


class PageSockets:
    """ASGI middleware around NiceGUI, see the module's docstring; to be made once in a process.

    Args:
        app: everything behind it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._pace = SteadyRate(MESSAGES_PER_S, BURST)
        self._owners: dict[str, Session] = {}
        """Who began a connection, by engine.io's number of it."""
        handlers = core.sio.eio.handlers
        core.sio.eio.on("connect", self._bounded(handlers["connect"]))
        core.sio.eio.on("disconnect", self._ended(handlers["disconnect"]))
        core.sio.eio.on("message", self._heard(handlers["message"]))
        core.app.storage.max_tab_storage_age = TAB_S

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a connection through."""
        if scope["type"] not in ("http", "websocket") or not scope["path"].startswith(SOCKET_PATH):
            await self._app(scope, receive, send)
            return
        state = scope.setdefault("state", {})
        session = state.get("session")
        words = self._refusal(parse_qs(scope["query_string"].decode("latin-1")), session)
        if words:
            COMPLAINTS.count(NONSENSE, words)
            await _refuse(scope, receive, send, words)
        elif scope["type"] == "websocket":
            socket = state[STATE] = PageSocket(receive, send, self._pace, id(session))
            await self._app(scope, socket.receive, socket.send)
        else:
            await self._app(scope, self._paced(receive, id(session)), send)

    def _refusal(self, query: Mapping[str, list[str]], session: object) -> str:
        """Why a request for a connection goes no further; empty: it does."""
        if "j" in query:
            return "a script of another site could read it"  # JSONP
        if "sid" in query:
            is_own = self._owners.get(query["sid"][0]) is session and isinstance(session, Session)
            return "" if is_own else "no connection of that session"
        own = sum(one is session for one in self._owners.values())
        if own >= MOST_OF_SESSION:  # one that broke while it began said no goodbye
            self._owners = {one: owner for one, owner in self._owners.items() if one in core.sio.eio.sockets}
            own = sum(one is session for one in self._owners.values())
        return "too many connections of one session" if own >= MOST_OF_SESSION else ""

    def _paced(self, receive: Receive, whose: Hashable) -> Receive:
        async def paced() -> Message:
            clock = asyncio.get_running_loop().time
            wait_s = self._pace.wait_s(whose, clock())
            message = await receive()
            if message["type"] == "http.request" and message.get("body"):
                self._pace.note(whose, clock(), 1.0 + len(message["body"]) / OCTETS)
                if wait_s > 0.0:
                    await asyncio.sleep(wait_s)
            return message

        return paced

    def _bounded(self, handler: _Handler) -> _Handler:
        async def connect(eio_sid: str, environ: Mapping[str, Any]) -> object:
            state = environ["asgi.scope"].get("state", {})
            socket, session = state.get(STATE), state.get("session")
            line = core.sio.eio.sockets[eio_sid]
            outgoing = Outgoing(socket.end if isinstance(socket, PageSocket) else partial(_abort, eio_sid))
            while not line.queue.empty():
                outgoing.put_nowait(line.queue.get_nowait())
            line.queue = outgoing
            if isinstance(session, Session):
                self._owners[eio_sid] = session
            return await cast("Awaitable[object]", handler(eio_sid, environ))

        return connect

    def _ended(self, handler: _Handler) -> _Handler:
        async def disconnect(eio_sid: str, *rest: object) -> object:
            self._owners.pop(eio_sid, None)
            return await cast("Awaitable[object]", handler(eio_sid, *rest))

        return disconnect

    @staticmethod
    def _heard(handler: _Handler) -> _Handler:
        async def message(eio_sid: str, data: object) -> None:
            if not isinstance(data, str) or not _EXPECTED.match(data):
                COMPLAINTS.count(NONSENSE, "no message of socket.io")
                return
            try:
                await handler(eio_sid, data)
            except Exception as error:  # whatever socket.io makes of it
                COMPLAINTS.count(NONSENSE, type(error).__name__)

        return message


def _abort(eio_sid: str) -> None:
    """End a connection by long polling, for which too much waits."""
    line = core.sio.eio.sockets.get(eio_sid)
    if line is not None:
        task = asyncio.get_running_loop().create_task(line.close(wait=False, abort=True))
        _TASKS.add(task)
        task.add_done_callback(_TASKS.discard)


async def _refuse(scope: Scope, receive: Receive, send: Send, words: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": words.encode()})


_TASKS: set[asyncio.Task[None]] = set()


def is_well_formed(name: str, message: Mapping[str, object]) -> bool:
    """Whether a message has what NiceGUI takes for granted: each name with a value of its kind.

    Args:
        name: the event: `handshake`, `event`, `javascript_response`, `ack`, `log`, or another one, which needs nothing.
        message: what came with it.
    """
    if name == "handshake":
        number = message.get("next_message_id")
        is_number = number is None or _is_number(number) or (isinstance(number, str) and _is_digits(number))
        names = (message.get("tab_id"), message.get("document_id"), message.get("old_tab_id") or "")
        return is_number and all(isinstance(one, str) and len(one) <= LONGEST_NAME for one in names)
    if name == "event":
        arguments = message.get("args", [])
        return (
            _is_number(message.get("id"))
            and isinstance(message.get("listener_id"), str)
            and isinstance(arguments, list)
            and all(one is None or (isinstance(one, str) and is_shallow(one)) for one in arguments)
        )
    if name == "javascript_response":
        return isinstance(message.get("request_id"), str)
    return name != "ack" or _is_number(message.get("next_message_id"))


def is_shallow(text: str) -> bool:
    """Whether a JSON text nests so little that whatever takes it apart comes to its end."""
    if text.count("[") + text.count("{") <= DEEPEST:
        return True
    without_texts = "".join(text.replace("\\\\", "").replace('\\"', "").split('"')[::2])
    depth = 0
    for bracket in _BRACKET.finditer(without_texts):
        depth += _DEEPER[bracket.group()]
        if depth > DEEPEST:
            return False
    return True


def _is_number(value: object) -> bool:
    return isinstance(value, int) and abs(value) < 1 << 53


def _is_digits(value: str) -> bool:
    return value.isascii() and value.isdigit() and len(value) <= len(str(1 << 53))
