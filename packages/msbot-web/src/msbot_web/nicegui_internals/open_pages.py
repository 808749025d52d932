"""Pages that are open, each belonging to the session it was opened by.

NiceGUI treats anybody who knows a page's number as its owner. Here every message of a websocket is checked against the
session of that very socket, and has to be what a page of ours sends; when a session ends or its role changes, the
server closes its pages and sockets. A page whose connection is lost is kept for a while, one that was left or closed is
not.
"""

from __future__ import annotations

import asyncio
import copy
import inspect
import logging
from collections.abc import Awaitable, Callable
from typing import cast
from urllib.parse import parse_qs

from nicegui import Client, core
from socketio.exceptions import ConnectionRefusedError

from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.nicegui_internals.page_sockets import COMPLAINTS, NONSENSE, is_well_formed

MADE_ANEW = "Implicit handshake failed"
"""NiceGUI's own words to a browser whose page is not there any more, or is not its own: it loads the page again."""
LEFT = "left"
"""What `page.js` says when its page is left: nobody will come back to it."""
_CHECKED = ("handshake", "event", "javascript_response", "ack", "log")
"""What a browser can say of a page; each names it by `client_id`."""

_log = logging.getLogger(__name__)
_Handler = Callable[..., object]


class OpenPages:
    """See the module's docstring; to be made once in a process, as NiceGUI's own things are.

    Args:
        accounts: who is signed in.
    """

    def __init__(self, accounts: Accounts) -> None:
        self._accounts = accounts
        self._sockets: dict[str, Session] = {}
        self.refused = 0
        """Messages about pages of other people."""
        handlers = core.sio.handlers["/"]
        for name in _CHECKED:
            core.sio.on(name, self._checked(name, self._console if name == "log" else handlers[name]))
        core.sio.on(LEFT, self._checked(LEFT, self._leave))
        core.sio.on("connect", self._connected(handlers["connect"]))
        core.sio.on("disconnect", self._disconnected(handlers["disconnect"]))
        accounts.sessions.on_end(self._close_pages)

    def may_use(self, client_id: str, session: Session | None) -> bool:
        """Whether a page belongs to that session."""
        client = Client.instances.get(client_id)
        return client is not None and session is not None and _session_of(client) is session

    def _connected(self, handler: _Handler) -> _Handler:
        async def connect(sid: str, environ: object = None, *rest: object) -> object:
            if not isinstance(environ, dict):
                return False
            scope = cast("dict[str, dict[str, object]]", environ.get("asgi.scope", {}))
            session = scope.get("state", {}).get("session")
            query = _query_of(environ)
            client_id = query.get("client_id", "")
            if not isinstance(session, Session):
                self.refused += 1
                return False
            if client_id and not self.may_use(client_id, session):
                self.refused += 1
                raise ConnectionRefusedError(MADE_ANEW)
            if query.get("implicit_handshake") == "true" and not is_well_formed("handshake", query):
                COMPLAINTS.count(NONSENSE, "handshake")
                raise ConnectionRefusedError(MADE_ANEW)
            self._sockets[sid] = session
            return await _call(handler, sid, environ, *rest)

        return connect

    def _disconnected(self, handler: _Handler) -> _Handler:
        async def disconnect(sid: str, *rest: object) -> object:
            self._sockets.pop(sid, None)
            return await _call(handler, sid, *rest[: len(inspect.signature(handler).parameters) - 1])

        return disconnect

    def _checked(self, name: str, handler: _Handler) -> _Handler:
        async def checked(sid: str, message: object = None, *rest: object) -> object:
            session = self._sockets.get(sid)
            client_id = message.get("client_id") if isinstance(message, dict) else None
            if session is None or not self._accounts.holds(session) or not self.may_use(str(client_id), session):
                self.refused += 1
                return False
            fits = isinstance(client_id, str) and not rest and is_well_formed(name, cast("dict[str, object]", message))
            if not fits:
                COMPLAINTS.count(NONSENSE, name)
                return False
            try:
                return await _call(handler, sid, message)
            except (LookupError, TypeError, ValueError) as error:  # what was clicked is gone, or was never there
                COMPLAINTS.count(NONSENSE, f"{name}: {type(error).__name__}")
                return False

        return checked

    @staticmethod
    def _console(_sid: str, message: dict[str, object]) -> None:
        """Note what a browser complains of; NiceGUI would write anything, of any length and level."""
        _log.info("a browser of the page says: %.200s", message.get("message", ""))

    @staticmethod
    def _leave(_sid: str, message: dict[str, str]) -> None:
        """Have the page closed as soon as its connection is."""
        client = Client.instances[message["client_id"]]
        client.page = copy.copy(client.page)  # of its own: the original is that of all pages of this address
        client.page.reconnect_timeout = 0.0

    def _close_pages(self, session: Session) -> None:
        """Close a session's pages soon, but let running actions of these pages finish."""
        asyncio.get_running_loop().call_soon(self._close_now, session)

    def _close_now(self, session: Session) -> None:
        for client in [one for one in Client.instances.values() if _session_of(one) is session]:
            # What waits for a browser to come back would delete it again.
            for waiting in client._delete_tasks.values():  # noqa: SLF001 - NiceGUI has no other way
                waiting.cancel()
            client.delete()
        for sid in [sid for sid, owner in self._sockets.items() if owner is session]:
            task = asyncio.get_running_loop().create_task(core.sio.disconnect(sid))
            _TASKS.add(task)
            task.add_done_callback(_TASKS.discard)


_TASKS: set[asyncio.Task[None]] = set()


def _session_of(client: Client) -> object:
    """Who opened a page; the guard has put the session there."""
    return client.request.scope.get("state", {}).get("session")


def _query_of(environ: dict[str, object]) -> dict[str, str]:
    """The query with which a websocket came; of a name that comes twice the first, as NiceGUI reads it."""
    return {name: values[0] for name, values in parse_qs(str(environ.get("QUERY_STRING", ""))).items()}


async def _call(handler: _Handler, *arguments: object) -> object:
    result = handler(*arguments)
    return await cast("Awaitable[object]", result) if inspect.isawaitable(result) else result
