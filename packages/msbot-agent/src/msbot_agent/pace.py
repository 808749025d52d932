"""Rate limits, and limits of connections.

An `Acceptor` accepts connections in the event loop, and pauses when the system is out of file descriptors or memory.
While a process has no file descriptor left, asyncio's own servers retry in a tight loop and log every failure. Here a
failure is counted once per pause and logged once, and everything else keeps running. A listener that must not be
locked out, because STOP comes that way, reserves descriptors for such a time, and closes what is needed least as long
as there is such a connection: then the next one is accepted in the next turn of the loop, not after the pause.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import os
import socket
from collections.abc import Callable, Hashable
from functools import partial
from typing import TYPE_CHECKING

from msbot_xrce.counting import Tally

if TYPE_CHECKING:
    import ssl


# How often each of many callers may do something: at a steady rate, and after a pause more at once.
#
# Pure: time is handed in.


MOST_CALLERS = 1000
"""Callers whose calls are counted at a time: the one that has called longest ago is forgotten."""


class TokenBucket:
    """What may happen so often a second, and after a pause so often at once.

    Args:
        per_s: how often for ever.
        burst: how often at once.
        now: the present time.
        is_full: whether it begins as after a pause.
    """

    __slots__ = ("_at", "_burst", "_per_s", "_spent")

    def __init__(self, per_s: float, burst: float, now: float, *, is_full: bool = True) -> None:
        self._per_s = per_s
        self._burst = burst
        self._spent = 0.0 if is_full else burst
        """What is not made up for yet."""
        self._at = now

    def missing(self, now: float, amount: float = 1.0) -> float:
        """How much is missing before so much more may happen; not more than 0: nothing."""
        return max(0.0, self._spent - (now - self._at) * self._per_s) + amount - self._burst

    def spend(self, now: float, amount: float = 1.0) -> None:
        """So much happens, even if it is too much."""
        self._spent = max(0.0, self._spent - (now - self._at) * self._per_s) + amount
        self._at = now

    def take(self, now: float) -> bool:
        """Whether it may happen once more now; then it does."""
        if self.missing(now) > 0.0:
            return False
        self.spend(now)
        return True

    def change(self, per_s: float, burst: float) -> None:
        """Another rate from now on; what was saved stays, as far as there is room for it."""
        self._spent = max(0.0, self._spent + burst - self._burst)
        self._per_s, self._burst = per_s, burst


class SteadyRate:
    """See the comment above: a token bucket for each caller.

    Args:
        per_s: calls a second that each may make for ever.
        burst: calls that each may make at once.
        most: callers remembered; whoever is forgotten may make `burst` calls again.
    """

    def __init__(self, per_s: float, burst: float, most: int = MOST_CALLERS) -> None:
        self.per_s = per_s
        self._burst = burst
        self._most = most
        self._buckets: dict[Hashable, TokenBucket] = {}
        """Who has called last comes last."""

    def wait_s(self, caller: Hashable, now: float) -> float:
        """How long that caller has to wait for the next call; 0: not at all."""
        return self._missing_s(caller, now, 1.0)

    def debt_s(self, caller: Hashable, now: float) -> float:
        """How long that caller has to rest to make up for what was too much; 0: not at all."""
        return self._missing_s(caller, now, 0.0)

    def note(self, caller: Hashable, now: float, calls: float = 1.0) -> None:
        """A call is made, or something that counts as so many."""
        bucket = self._buckets.pop(caller, None)
        if bucket is None:
            bucket = TokenBucket(self.per_s, self._burst, now)
            if len(self._buckets) >= self._most:
                del self._buckets[next(iter(self._buckets))]
        bucket.spend(now, calls)
        self._buckets[caller] = bucket

    def _missing_s(self, caller: Hashable, now: float, calls: float) -> float:
        bucket = self._buckets.get(caller)
        missing = calls - self._burst if bucket is None else bucket.missing(now, calls)
        return max(0.0, missing / self.per_s)


# How many connections a second a server takes, before it has read a word of any. Pure: time is handed in.
#
# A connection costs a server most at its beginning: negotiations, headers, a first page. Strangers are bounded by their
# address and in all, so that a flood costs a bounded part of the time. Addresses that are known (a part with a place, a
# browser that is signed in) have a share of their own, which no stranger can use up.


BURST_S = 5.0
"""After a pause, as many connections as come in this time may come at once."""
KNOWN_TIMES = 4.0
"""A known address may make so many times as many connections as an unknown one."""
MOST_ADDRESSES = 4096

_EVERYBODY = "everybody"


class ConnectionPace:
    """See the comment above.

    Args:
        of_address: connections a second from one unknown address.
        in_all: from all unknown addresses together.
        knows: whether an address is known.
        is_shared: whether an address passes on what others ask, as a trusted proxy does: it has no bound, because one
            stranger would use up everybody's; the proxy can bound strangers itself.
    """

    def __init__(
        self,
        of_address: float,
        in_all: float,
        knows: Callable[[str], bool],
        is_shared: Callable[[str], bool] = lambda _: False,
    ) -> None:
        self._is_shared = is_shared
        self._of_address = SteadyRate(of_address, of_address * BURST_S, MOST_ADDRESSES)
        self._in_all = SteadyRate(in_all, in_all * BURST_S, 1)
        known = KNOWN_TIMES * of_address
        self._known = SteadyRate(known, known * BURST_S, MOST_ADDRESSES)
        self._knows = knows

    def takes(self, address: str, now: float) -> bool:
        """Whether a connection that has come from there is taken; if not, it is to be closed at once."""
        if self._is_shared(address):
            return True
        bounds = (
            [(self._known, address)]
            if self._knows(address)
            else [(self._of_address, address), (self._in_all, _EVERYBODY)]
        )
        if any(rate.wait_s(caller, now) > 0.0 for rate, caller in bounds):
            return False
        for rate, caller in bounds:
            rate.note(caller, now)
        return True


_log = logging.getLogger(__name__)

PAUSE_S = 0.5
"""Longest pause after the system had no descriptor or memory for another connection."""
FIRST_PAUSE_S = 0.001
"""The first one; each further one is twice as long."""

PER_TURN = 8
"""Connections that begin before the rest of the loop gets its turn: a negotiation of TLS takes a millisecond or two."""
LOOKED_AT = 64
"""Connections that are accepted in a turn, those included that are closed at once."""
MOST_BEGINNING = 64
"""Connections that negotiate TLS at a time; a further one takes the place of the oldest, which has had half a second
at the pace at which strangers are taken."""

EXHAUSTED = "connection waits: the system has no more file descriptors"
BROKEN = "connection broke before it was accepted"
TOO_FAST = "connection closed: strangers make too many in a second"

_NO_DESCRIPTOR = (errno.EMFILE, errno.ENFILE)
_NO_MORE = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


class Acceptor:
    """Hands over every connection made to a listening socket."""

    def __init__(
        self,
        listening: socket.socket,
        take: Callable[[socket.socket], None],
        dropped: Tally,
        *,
        pace: ConnectionPace | None = None,
        reserved: int = 0,
        make_room: Callable[[], bool] = lambda: False,
    ) -> None:
        """Begin at once, in the running loop.

        Args:
            listening: the socket; the caller closes it, after `stop`.
            take: gets each connection as a non-blocking socket.
            dropped: where failures are counted.
            pace: which connections are taken at all; None: all.
            reserved: descriptors that are held for connections that come when the process has no others left.
            make_room: called then, to close what is needed least; False: there is nothing.
        """
        listening.setblocking(False)
        self._listening = listening
        self._take = take
        self._dropped = dropped
        self._pace_of_strangers = pace
        self._loop = asyncio.get_running_loop()
        self._pause: asyncio.TimerHandle | None = None
        self._pause_s = FIRST_PAUSE_S
        self._most_reserved = reserved
        self._reserved: list[int] = []
        self._make_room = make_room
        self._refilling: asyncio.TimerHandle | None = None
        self._reserve()
        self._listen()

    def stop(self) -> None:
        """Stop accepting."""
        self._loop.remove_reader(self._listening)
        for timer in (self._pause, self._refilling):
            if timer is not None:
                timer.cancel()
        self._pause = self._refilling = None
        while self._reserved:
            os.close(self._reserved.pop())

    def _reserve(self) -> None:
        """Hold the descriptors again that were used; what must wait for others to be closed is tried again."""
        self._refilling = None
        try:
            while len(self._reserved) < self._most_reserved:
                self._reserved.append(os.open(os.devnull, os.O_RDONLY))
        except OSError:
            self._refilling = self._loop.call_later(PAUSE_S, self._reserve)

    def _use_reserve(self) -> bool:
        """Set a reserved descriptor free; False: there is none."""
        if not self._reserved:
            return False
        os.close(self._reserved.pop())
        self._make_room()
        if self._refilling is None:
            self._refilling = self._loop.call_later(PAUSE_S, self._reserve)
        return True

    def _listen(self) -> None:
        self._pause = None
        self._loop.add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        taken = 0
        for _ in range(LOOKED_AT):
            try:
                connection, address = self._listening.accept()
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno in _NO_MORE:
                    if EXHAUSTED not in self._dropped:
                        _log.warning("no more connections can be accepted for now: %s", error.strerror)
                    self._dropped.count(EXHAUSTED)
                    if error.errno in _NO_DESCRIPTOR:
                        if self._use_reserve():
                            continue
                        if self._make_room():
                            return  # its descriptor is free in the next turn
                    self._loop.remove_reader(self._listening)
                    self._pause = self._loop.call_later(self._pause_s, self._listen)
                    self._pause_s = min(2 * self._pause_s, PAUSE_S)
                    return
                self._dropped.count(BROKEN)
                continue
            self._pause_s = FIRST_PAUSE_S
            if not self._is_taken(address):
                connection.close()
                continue
            connection.setblocking(False)
            _send_at_once(connection)
            self._take(connection)
            taken += 1
            if taken == PER_TURN:
                return

    def _is_taken(self, address: object) -> bool:
        if self._pace_of_strangers is None or not isinstance(address, tuple):
            return True
        if self._pace_of_strangers.takes(address[0], self._loop.time()):
            return True
        if TOO_FAST not in self._dropped:
            _log.warning("strangers make too many connections: some are closed at once, latest from %s", address[0])
        self._dropped.count(TOO_FAST)
        return False


class ProtocolServer:
    """Gives every connection made to a listening socket a protocol; TLS is negotiated for each on its own.

    asyncio's own server forgets a connection that comes in while it is closed: nobody closes that one.

    Args:
        listening: the socket; the caller closes it, after `run`.
        make: makes the protocol of a new connection.
        dropped: where failures are counted.
        tls: the certificate; None: none.
        handshake_s: how long the negotiation may take.
        pace: which connections are taken at all; None: all.
        reserved: see `Acceptor`.
        make_room: see `Acceptor`.
    """

    def __init__(
        self,
        listening: socket.socket,
        make: Callable[[], asyncio.Protocol],
        dropped: Tally,
        *,
        tls: ssl.SSLContext | None = None,
        handshake_s: float = 60.0,
        pace: ConnectionPace | None = None,
        reserved: int = 0,
        make_room: Callable[[], bool] = lambda: False,
    ) -> None:
        self._reserved = reserved
        self._make_room = make_room
        self._listening = listening
        self._make = make
        self._dropped = dropped
        self._tls = tls
        self._handshake_s = handshake_s if tls else None
        self._pace = pace
        self._beginning: dict[asyncio.Task[None], None] = {}
        """In the order in which they came."""

    async def run(self) -> None:
        """Accept until cancelled; a connection that has no protocol by then is closed."""
        acceptor = Acceptor(
            self._listening,
            self._take,
            self._dropped,
            pace=self._pace,
            reserved=self._reserved,
            make_room=self._close_one,
        )
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            acceptor.stop()
            for task in self._beginning:
                task.cancel()
            await asyncio.gather(*self._beginning, return_exceptions=True)

    def _close_one(self) -> bool:
        return self._make_room() or self._drop_oldest()

    def _drop_oldest(self) -> bool:
        """Close the connection that negotiates TLS for longest; False: there is none, or none waits for its peer."""
        oldest = next(iter(self._beginning), None) if self._tls else None
        if oldest is None:
            return False
        del self._beginning[oldest]
        return oldest.cancel()

    def _take(self, connection: socket.socket) -> None:
        if len(self._beginning) >= MOST_BEGINNING:
            self._drop_oldest()
        task = asyncio.get_running_loop().create_task(self._begin(connection))
        self._beginning[task] = None
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
        self._beginning.pop(task, None)
        if task.cancelled():  # perhaps before its first step
            connection.close()


def _send_at_once(connection: socket.socket) -> None:
    """Have the system not wait for more before it sends little: an answer in two pieces took 40 ms longer (Nagle).

    asyncio does this only for sockets that were made with a protocol number.
    """
    if connection.family in (socket.AF_INET, socket.AF_INET6):
        with contextlib.suppress(OSError):  # it is gone already, and found out when it is read
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
