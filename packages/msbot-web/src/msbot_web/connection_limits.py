"""The connections of the page: how many may be open, and how long they may be slow.

A connection that says nothing is closed after a while. When there are too many, an idle one makes room: first one that
never asked anything, then a stranger's, last that of somebody who is signed in, over which STOP may come; among equals
the one that has been idle longest. So connections that are only held open neither use up the robot's file descriptors
nor keep people out.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from typing import Any

from uvicorn.config import Config
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.server import ServerState

from msbot_web.access.access_middleware import STOP_PATH

HEAD_S = 10.0
"""How long a connection may take until its request has come with all its headers; TLS gets as long."""
BODY_S = 20.0
"""How long a request's body may pause."""
IDLE_S = 30
"""How long a connection stays open for its next request. Longer than clients keep theirs (httpx 5 s): who closes first
cannot lose a request, and one that is on its way to a server that is closing is lost."""
MOST_HEAD = 64 * 1024
"""Octets of a request's address and headers; browsers send about one thousand."""
MOST_PER_ADDRESS = 300
"""A class behind one router has one address; each browser opens up to seven connections."""
RESERVED = 4
"""File descriptors that are held for connections that come when the process has no others left: one may bring STOP."""
MOST = 600
"""Connections in all; never more than half of the file descriptors that the process may have."""

SIGNED_IN = 2
"""Rank of a connection over which somebody who is signed in has asked."""

LINGER_S = 2.0
"""How long what still comes on a refused connection is read and thrown away."""
MOST_LINGER = 1024 * 1024
"""Octets of it."""

TOO_LONG = b"HTTP/1.1 431 Request Header Fields Too Large\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"


class ConnectionLimits:
    """Which connections are open; makes room for a new one.

    Args:
        most: connections in all; None: as the system allows.
        is_shared: whether many people come from an address, as from a trusted proxy: it has no limit of its own.
    """

    def __init__(self, most: int | None = None, is_shared: Callable[[str], bool] = lambda _: False) -> None:
        self._is_shared = is_shared
        self._most = min(MOST, _descriptors() // 2) if most is None else most
        self._open: dict[LimitedConnection, str] = {}
        """In the order of their last activity, with their addresses."""
        self.dropped = 0
        """Connections that were closed to make room, or because they said nothing in time."""

    def __len__(self) -> int:
        return len(self._open)

    def begin(self, connection: LimitedConnection, address: str) -> bool:
        """Accept a new connection; False: there is no room, and no idle one that could make room."""
        for one in [one for one in self._open if one.is_closing()]:
            del self._open[one]
        same = [] if self._is_shared(address) else [one for one, where in self._open.items() if where == address]
        if len(same) >= MOST_PER_ADDRESS and not self._drop_idle(same):
            return False
        if len(self._open) >= self._most and not self._drop_idle(list(self._open)):
            return False
        self._open[connection] = address
        return True

    def make_room(self) -> bool:
        """Close an idle connection of a stranger, because the process has no descriptor left; False: there is none."""
        return self._drop_idle([one for one in self._open if one.rank() < SIGNED_IN])

    def active(self, connection: LimitedConnection) -> None:
        """Note that something came from a connection."""
        address = self._open.pop(connection, None)
        if address is not None:
            self._open[connection] = address

    def end(self, connection: LimitedConnection) -> None:
        """Forget a connection."""
        self._open.pop(connection, None)

    def _drop_idle(self, among: list[LimitedConnection]) -> bool:
        idle = (connection for connection in among if connection.is_idle())
        needed_least = min(idle, key=LimitedConnection.rank, default=None)  # the first of equals: idle for longest
        if needed_least is None:
            return False
        needed_least.drop()
        return True


class LimitedConnection(HttpToolsProtocol):
    """A connection with time limits, until it becomes a websocket.

    Args:
        connections: the others.
        config: uvicorn's.
        server_state: uvicorn's.
        app_state: uvicorn's.
    """

    def __init__(
        self, connections: ConnectionLimits, config: Config, server_state: ServerState, app_state: dict[str, Any]
    ) -> None:
        super().__init__(config, server_state, app_state)
        self.timeout_keep_alive = IDLE_S
        self._all = connections
        self._timer: asyncio.TimerHandle | None = None
        self._is_reading_body = False
        self._is_websocket = False
        self._head = 0
        """Octets that have come of a request whose headers are not complete."""
        self._refused: int | None = None
        """Octets that have come since the request was refused; None: it was not."""
        self._is_broken = False
        """Whether nothing that comes can be understood any more, and an answer is still to be given."""

    def is_idle(self) -> bool:
        """Whether no request on it is being processed."""
        return not self._is_websocket and (self.cycle is None or self.cycle.response_complete)

    def rank(self) -> int:
        """How much it is needed: 0 if nothing was asked over it yet, 1 if a stranger asked, `SIGNED_IN` at most."""
        if self.cycle is None:
            return 0
        # The page's guard notes the session of a request in its state.
        return 1 if self.scope.get("state", {}).get("session") is None else SIGNED_IN

    def is_closing(self) -> bool:
        """Whether it is closed, or will be in a moment."""
        return self.transport is None or self.transport.is_closing()

    def drop(self) -> None:
        """Close it without a word, or after the word of refusal that it has had."""
        if self._refused is None:
            self._all.dropped += 1
        self._all.end(self)
        self.transport.abort()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
        if self._all.begin(self, self.client[0] if self.client else ""):
            self._arm(HEAD_S)
        else:
            self.drop()

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        self._disarm()
        self._all.end(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """See `asyncio.Protocol`."""
        if self._refused is not None:
            self._refused += len(data)
            if self._refused > MOST_LINGER:
                self.drop()
            return
        if self._is_broken:
            return
        self._all.active(self)
        if self._is_reading_body:
            self._arm(BODY_S)
        elif self._timer is None and self.is_idle():
            self._arm(HEAD_S)
        if self._is_reading_body:
            super().data_received(data)
            return
        # The parser takes ever longer with each piece of a header that never ends.
        if self._head + len(data) > MOST_HEAD and b"\r\n\r\n" not in data[: max(0, MOST_HEAD - self._head)]:
            self._refuse(TOO_LONG)
            return
        self._head += len(data)
        super().data_received(data)

    def send_400_response(self, msg: str) -> None:
        """Answer what cannot be understood; what uvicorn calls.

        A STOP whose body breaks off is obeyed: whoever said it hears what came of it, as if the body had ended there.
        """
        cycle = self.cycle
        if not self._is_reading_body or cycle is None or self.scope["path"] != STOP_PATH:
            super().send_400_response(msg)
            return
        self._is_broken, self._is_reading_body = True, False
        cycle.keep_alive = False
        cycle.more_body = False
        cycle.message_event.set()

    def _refuse(self, answer: bytes) -> None:
        """Answer, and close when the peer does, or soon: if it were closed while something of the request was unread,
        the system would reset it, and the peer's system would throw the answer away."""
        self._all.dropped += 1
        self._refused = 0
        self._arm(LINGER_S)
        self.transport.write(answer)
        if not self.is_idle():  # what was asked before would be answered after it
            self.transport.close()
        elif self.transport.can_write_eof():  # TLS cannot
            self.transport.write_eof()

    def on_headers_complete(self) -> None:
        """All headers have come; what httptools calls."""
        self._is_reading_body = True
        self._head = 0
        self._arm(BODY_S)
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """The whole request has come; what httptools calls."""
        self._is_reading_body = False
        self._disarm()
        super().on_message_complete()

    def handle_websocket_upgrade(self) -> None:
        """The websocket's own pings look after it from now on."""
        self._is_websocket = True
        self._disarm()
        super().handle_websocket_upgrade()

    def _arm(self, seconds: float) -> None:
        self._disarm()
        self._timer = self.loop.call_later(seconds, self.drop)

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _descriptors() -> int:
    """How many files this process may open."""
    if os.name != "posix":
        return 2 * MOST
    import resource

    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]
