"""Accepts connections in the event loop, and pauses when the system is out of file descriptors or memory.

While a process has no file descriptor left, asyncio's own servers retry in a tight loop and log every failure. Here a
failure is counted once per pause and logged once, and everything else keeps running.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from msbot.runtime.tally import Tally

if TYPE_CHECKING:
    import ssl

_log = logging.getLogger(__name__)

PAUSE_S = 0.5
"""Pause after the system had no descriptor or memory for another connection."""

PER_TURN = 64
"""Connections accepted before the rest of the loop gets its turn."""

EXHAUSTED = "connection waits: the system has no more file descriptors"
BROKEN = "connection broke before it was accepted"

_NO_MORE = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


class Acceptor:
    """Hands over every connection made to a listening socket."""

    def __init__(self, listening: socket.socket, take: Callable[[socket.socket], None], dropped: Tally) -> None:
        """Begin at once, in the running loop.

        Args:
            listening: the socket; the caller closes it, after `stop`.
            take: gets each connection as a non-blocking socket.
            dropped: where failures are counted.
        """
        listening.setblocking(False)
        self._listening = listening
        self._take = take
        self._dropped = dropped
        self._loop = asyncio.get_running_loop()
        self._pause: asyncio.TimerHandle | None = None
        self._listen()

    def stop(self) -> None:
        """Stop accepting."""
        self._loop.remove_reader(self._listening)
        if self._pause is not None:
            self._pause.cancel()
            self._pause = None

    def _listen(self) -> None:
        self._pause = None
        self._loop.add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        for _ in range(PER_TURN):
            try:
                connection, _ = self._listening.accept()
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno in _NO_MORE:
                    if EXHAUSTED not in self._dropped:
                        _log.warning("no more connections can be accepted for now: %s", error.strerror)
                    self._dropped.count(EXHAUSTED)
                    self._loop.remove_reader(self._listening)
                    self._pause = self._loop.call_later(PAUSE_S, self._listen)
                    return
                self._dropped.count(BROKEN)
                continue
            connection.setblocking(False)
            _send_at_once(connection)
            self._take(connection)


class ProtocolAcceptor:
    """Gives every connection made to a listening socket a protocol; TLS is negotiated for each on its own.

    asyncio's own server forgets a connection that comes in while it is closed: nobody closes that one.

    Args:
        listening: the socket; the caller closes it, after `run`.
        make: makes the protocol of a new connection.
        dropped: where failures are counted.
        tls: the certificate; None: none.
        handshake_s: how long the negotiation may take.
    """

    def __init__(
        self,
        listening: socket.socket,
        make: Callable[[], asyncio.Protocol],
        dropped: Tally,
        *,
        tls: ssl.SSLContext | None = None,
        handshake_s: float = 60.0,
    ) -> None:
        self._listening = listening
        self._make = make
        self._dropped = dropped
        self._tls = tls
        self._handshake_s = handshake_s if tls else None
        self._beginning: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Accept until cancelled; a connection that has no protocol by then is closed."""
        acceptor = Acceptor(self._listening, self._take, self._dropped)
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            acceptor.stop()
            for task in self._beginning:
                task.cancel()
            await asyncio.gather(*self._beginning, return_exceptions=True)

    def _take(self, connection: socket.socket) -> None:
        task = asyncio.get_running_loop().create_task(self._begin(connection))
        self._beginning.add(task)
        task.add_done_callback(partial(self._begun, connection))

    async def _begin(self, connection: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        # A peer that fails at TLS, or is gone again, is not worth reporting.
        with contextlib.suppress(OSError):
            await loop.connect_accepted_socket(
                self._make, connection, ssl=self._tls, ssl_handshake_timeout=self._handshake_s
            )
            return
        connection.close()

    def _begun(self, connection: socket.socket, task: asyncio.Task[None]) -> None:
        self._beginning.discard(task)
        if task.cancelled():  # perhaps before its first step
            connection.close()


def _send_at_once(connection: socket.socket) -> None:
    """Have the system not wait for more before it sends little: an answer in two pieces took 40 ms longer (Nagle).

    asyncio does this only for sockets that were made with a protocol number.
    """
    if connection.family in (socket.AF_INET, socket.AF_INET6):
        with contextlib.suppress(OSError):  # it is gone already, and found out when it is read
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
