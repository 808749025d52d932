"""UDP over IPv4 and IPv6: one datagram is one packet (DDS-XRCE over UDP, seen on the wire with eProsima's agent).

The sockets are served by the event loop's reader call-backs and drained in one call; asyncio's datagram transport
costs several times as much per packet.
"""

from __future__ import annotations

import asyncio
import errno
import select
import socket
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Hashable
from functools import partial

from msbot_agent.link.base import BaseLink
from msbot_agent.link.contract import LinkInfo, Peer, PeerDirectory, Signal
from msbot_agent.link.net.batched_receive import BATCH, LINGER_S, AdaptivePolling, BatchedReceiver, batched_receiver
from msbot_agent.link.net.host_address import (
    Address,
    addresses_of,
    cannot_listen,
    cannot_reach,
    joined,
    serve_both_kinds,
)
from msbot_agent.link.net.stranger_filter import StrangerFilter
from msbot_agent.process.direct_loop import gathering_of
from msbot_agent.process.gathering import Gathering
from msbot_xrce.errors import LinkDown, LinkFull

UDP_MTU = 65507
"""Largest payload of a datagram over IPv4; DDS-XRCE clients announce much less."""

QUEUE_PACKETS = 512
"""Packets that may wait for the kernel; beyond, `send` raises LinkFull."""

DRAIN_PACKETS = 256
"""Datagrams in a burst, after which it is answered."""

LONGEST_BURST_S = 0.005
"""A burst is answered after this time, too: what costs much, such as logins, must not keep everything else waiting."""

STAY_S = 0.001
"""How long bursts that follow each other are taken in one call-back."""

ALONE = 8
"""After so many datagrams that came one by one, the next is answered before anybody looks for another."""

RECEIVE_BUFFER_BYTES = 1 << 20
"""Requested from the kernel, for bursts; it gives less where `net.core.rmem_max` is smaller."""

NOBODY_LISTENS = "nobody listens at the peer's port"

_PASSING = {
    errno.ECONNREFUSED: NOBODY_LISTENS,
    errno.EHOSTUNREACH: "the peer's host cannot be reached",
    errno.ENETUNREACH: "the peer's network cannot be reached",
    errno.ENETDOWN: "the network interface is down",
    errno.EMSGSIZE: "longer than a datagram may be",
    errno.EPERM: "forbidden by the firewall",
    errno.EACCES: "forbidden: a broadcast address",
    errno.ENOBUFS: "the network interface's queue is full",
    errno.ENOMEM: "the system has no memory for it at present",
    errno.EINVAL: "the peer's address is none to send to",  # port 0, for example, which anybody can put into a datagram
    errno.EADDRNOTAVAIL: "the network interface has lost its address",
    errno.EHOSTDOWN: "the peer's host is down",
    errno.ENETRESET: "the peer's network was reset",
    errno.ENODEV: "the network interface has vanished",
    errno.ENXIO: "the network interface has vanished",
}
"""Errors of one datagram or one peer, in words; the socket itself is fine."""


class _UdpLink(BaseLink, ABC):
    """What server and client have in common; their only signals are LINK_UP and LINK_DOWN."""

    def __init__(self, host: str, port: int, *, remote: Peer | None = None, linger_s: float = 0.0) -> None:
        info = LinkInfo(f"udp:{joined(host, port)}", UDP_MTU, keeps_order=False, in_bursts=True)
        super().__init__(info, remote=remote)
        self._host = host
        self._port = port
        self._socket: socket.socket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended: asyncio.Future[None] | None = None
        self._transmit: Callable[[bytes, Peer], object]
        self.unread_at = float("-inf")
        """See `BacklogLink`; never where the system gives datagrams one by one."""
        self._queue: deque[tuple[bytes, Peer]] = deque()
        self._was_full = False
        self._lingering = AdaptivePolling(linger_s)
        self._look: Callable[[], object]  # whether the socket has something
        self._batches: BatchedReceiver | None = None
        self._has_come_together = False  # whether the latest burst had more than one datagram
        self._alone = 0  # how many of the latest came one by one, and no other came while they were answered
        self._gathering: Gathering | None = None
        self._strangers: StrangerFilter | None = None
        self._takes: Callable[[Peer, float], bool] | None = None  # asked about each datagram during a flood

    @property
    def port(self) -> int:
        """The port of this side while the link is open (useful after asking for port 0), else 0."""
        return int(self._socket.getsockname()[1]) if self._socket is not None else 0

    def has_room(self, peer: Peer) -> bool:  # noqa: ARG002 - one queue serves all peers
        """Whether `send` would succeed now."""
        return self._socket is not None and len(self._queue) < QUEUE_PACKETS

    def send(self, packet: bytes, peer: Peer) -> None:
        """Send at once if the kernel accepts the packet, else queue it.

        Raises:
            LinkFull: the queue is full.
            LinkDown: the link is not open.
        """
        if self._loop is None or self._socket is None:
            raise LinkDown(f"{self.info.name} is not open: start its run() first")
        if not self._queue:
            # As `_hand_over`, without calls: this is done for every packet.
            try:
                self._transmit(packet, peer)
            except BlockingIOError:
                self._loop.add_writer(self._socket, self._send_queued, self._socket, self._loop)
            except OSError as error:
                self._tolerate(error)
                return
            else:
                counters = self.counters
                counters.packets_out += 1
                counters.bytes_out += len(packet)
                if self.tap is not None:
                    self.tap(self._loop.time(), "out", peer, packet)
                return
        elif len(self._queue) >= QUEUE_PACKETS:
            raise LinkFull(f"{self.info.name}: {QUEUE_PACKETS} packets wait for the network")
        self._queue.append((packet, peer))
        self._was_full = len(self._queue) >= QUEUE_PACKETS

    def origin(self, peer: Peer) -> Hashable:
        """See `Link`: the address without the port."""
        return peer[0] if isinstance(peer, tuple) else peer

    def describe(self, peer: Peer) -> str:
        """The peer's address, `127.0.0.1:40123` or `[::1]:40123`."""
        match peer:
            case (str() as host, int() as port, *_):
                return joined(host, port)
        return str(peer)

    async def run(self) -> None:
        """Open the socket and serve it until cancelled; it may run again afterwards.

        Raises:
            LinkDown: the socket cannot be opened or fails for good; the text names the remedy.
        """
        loop = asyncio.get_running_loop()
        opened = await self._open(loop)
        self._loop, self._socket, self._ended = loop, opened, loop.create_future()
        self._transmit = self._transmitter(opened)
        self._look = _looker(opened)
        self._batches = batched_receiver(opened)
        self._gathering = gathering_of(loop)
        self._strangers = self._stranger_filter(opened)
        loop.add_reader(opened, self._drain, opened, loop)
        self._signal_handler(Signal.LINK_UP, None, "opened", loop.time())
        try:
            await self._ended
        finally:
            loop.remove_reader(opened)
            loop.remove_writer(opened)
            if self._strangers is not None:
                self._strangers.stop()
            opened.close()
            self._loop, self._socket, self._ended, self._batches = None, None, None, None
            self._strangers = self._takes = None
            if self._queue:
                self.counters.dropped.count("the link was closed before the network took it", len(self._queue))
            self._queue.clear()
            self._signal_handler(Signal.LINK_DOWN, None, "closed", loop.time())

    async def _open(self, loop: asyncio.AbstractEventLoop) -> socket.socket:
        found = await addresses_of(loop, self.info.name, self._host, self._port, kind=socket.SOCK_DGRAM)
        family, kind, protocol, address = found[0]
        try:
            opened = socket.socket(family, kind, protocol)
        except OSError as error:
            raise self._why_not(error) from error
        try:
            opened.setblocking(False)
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            self._take_address(opened, address)
        except OSError as error:
            opened.close()
            raise self._why_not(error) from error
        return opened

    def _stranger_filter(self, opened: socket.socket) -> StrangerFilter | None:  # noqa: ARG002 - a client has none
        return None

    @abstractmethod
    def _take_address(self, opened: socket.socket, address: Address) -> None:
        """Bind or connect the new socket."""

    @abstractmethod
    def _transmitter(self, opened: socket.socket) -> Callable[[bytes, Peer], object]:
        """The function that gives one packet to the kernel: the socket's own method where possible."""

    @abstractmethod
    def _why_not(self, error: OSError) -> LinkDown:
        """Why the socket cannot be opened, and what to do."""

    def _drain(self, opened: socket.socket, loop: asyncio.AbstractEventLoop) -> bool:
        """Take burst after burst, as long as the next is there when one has been answered; whether the loop's gathering
        was told."""
        clock, lingering, look, counters = loop.time, self._lingering, self._look, self.counters
        start = clock()
        lingering.woken(start)
        gathering = self._gathering
        if gathering is not None and gathering.delay_s:
            self._alone = 0
        strangers = self._strangers
        if strangers is not None and start >= strangers.next_at:
            strangers.update(start)
            self._takes = strangers.takes if strangers.is_on else None
        while True:
            before = counters.packets_in
            try:
                is_fine = self._take_burst(opened, clock)
            finally:
                self._burst_end_handler()
            now = clock()
            pause_s = 0.0 if gathering is None else gathering.turn(now, counters.packets_in - before)
            if not is_fine or pause_s or now - start > STAY_S:
                break
            if look():
                self._alone = 0
            elif not lingering.watch(look, clock):
                break
        return gathering is not None

    def _take_burst(self, opened: socket.socket, clock: Callable[[], float]) -> bool:
        """Take what waits in the socket; False: it has failed."""
        if self._has_come_together and self._batches is not None:
            return self._take_batches(self._batches, clock)
        remote, look = self.remote, self._look
        for _ in range(DRAIN_PACKETS):
            try:
                packet, peer = opened.recvfrom(UDP_MTU)
            except BlockingIOError:
                break
            except OSError as error:
                if not self._tolerate(error):
                    return False
                continue
            now = clock()
            if self._takes is None or self._takes(peer, now):
                # As `_received`, without a call: this is done for every packet.
                peer = peer if remote is None else remote
                counters = self.counters
                counters.packets_in += 1
                counters.bytes_in += len(packet)
                if self.tap is not None:
                    self.tap(now, "in", peer, packet)
                self._packet_handler(packet, peer, now)
            if self._alone >= ALONE:
                break
            if not look():  # a quarter of what it costs to be refused
                self._alone += 1
                break
            if self._batches is not None:
                is_fine = self._take_batches(self._batches, clock)
                self._has_come_together = True
                return is_fine
        return True

    def _take_batches(self, batches: BatchedReceiver, clock: Callable[[], float]) -> bool:
        """Take a burst, or the rest of one, many datagrams at a time; False: the socket has failed."""
        remote, takes = self.remote, self._takes
        until = clock() + LONGEST_BURST_S
        for _ in range(DRAIN_PACKETS // BATCH):
            try:
                packets = batches.receive()
            except OSError as error:
                if not self._tolerate(error):
                    return False
                continue
            now = clock()
            counters = self.counters
            for packet, sender in packets:
                if takes is not None and not takes(sender, now):
                    continue
                # As `_received`, without a call: this is done for every packet.
                peer = sender if remote is None else remote
                counters.packets_in += 1
                counters.bytes_in += len(packet)
                if self.tap is not None:
                    self.tap(now, "in", peer, packet)
                self._packet_handler(packet, peer, now)
            if len(packets) < BATCH:
                self._has_come_together = len(packets) > 1
                return True
            if now > until:
                break
        self.unread_at = clock()
        return True

    def _tolerate(self, error: OSError) -> bool:
        """Count an error that is transient; end `run` on any other."""
        if reason := _PASSING.get(error.errno or 0):
            self.counters.dropped.count(reason)
            return True
        if self._ended is not None and not self._ended.done():
            self._ended.set_exception(LinkDown(f"{self.info.name} failed: {error.strerror}: start it again"))
        return False

    def _hand_over(self, packet: bytes, peer: Peer) -> bool:
        """Whether the packet is done with: the kernel accepted it, or refused it for good."""
        try:
            self._transmit(packet, peer)
        except BlockingIOError:
            return False
        except OSError as error:
            self._tolerate(error)
            return True
        if self._loop is not None:
            self._sent(packet, peer, 0.0 if self.tap is None else self._loop.time())
        return True

    def _send_queued(self, opened: socket.socket, loop: asyncio.AbstractEventLoop) -> None:
        while self._queue:
            if not self._hand_over(*self._queue[0]):
                return
            self._queue.popleft()
        loop.remove_writer(opened)
        if self._was_full:
            self._was_full = False
            self._room_handler(None)


def _looker(opened: socket.socket) -> Callable[[], object]:
    """What says at once whether a socket has something to read."""
    if not hasattr(select, "poll"):  # Windows
        return lambda: select.select([opened], (), (), 0)[0]
    readable = select.poll()
    readable.register(opened, select.POLLIN)
    return partial(readable.poll, 0)


class UdpServerLink(_UdpLink):
    """One socket for many peers; a peer is its socket address. Satisfies `Link`.

    Args:
        host: address or name to listen at; `0.0.0.0` for every IPv4 interface, `::` for IPv6 too.
        port: 1 to 65535, or 0 for any free one (see `port`).
        linger_s: how long at most to wait awake for a packet that is likely to follow at once (see `AdaptivePolling`).
    """

    def __init__(self, host: str, port: int, *, linger_s: float = LINGER_S) -> None:
        super().__init__(host, port, linger_s=linger_s)
        self._known: PeerDirectory | None = None

    def put_first(self, known: PeerDirectory) -> None:
        """See `PriorityLink`; to be said before it is opened."""
        self._known = known

    def _stranger_filter(self, opened: socket.socket) -> StrangerFilter | None:
        if self._known is None:
            return None
        return StrangerFilter(opened, self.info.name, self._known, self.counters.dropped)

    def _take_address(self, opened: socket.socket, address: Address) -> None:
        serve_both_kinds(opened, self._host)
        opened.bind(address)

    def _transmitter(self, opened: socket.socket) -> Callable[[bytes, Peer], object]:
        return opened.sendto  # type: ignore[return-value]  # peers are what recvfrom gave

    def _why_not(self, error: OSError) -> LinkDown:
        return cannot_listen(self.info.name, self._host, self._port, error, lister="ss -ulnp")


class UdpClientLink(_UdpLink):
    """A socket that talks to one server, its `remote`. Satisfies `Link`."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(host, port, remote=(host, port))

    def _take_address(self, opened: socket.socket, address: Address) -> None:
        opened.connect(address)

    def _transmitter(self, opened: socket.socket) -> Callable[[bytes, Peer], object]:
        def transmit(packet: bytes, peer: Peer) -> None:  # noqa: ARG001 - there is only one
            try:
                opened.send(packet)
            except ConnectionRefusedError:
                # The kernel reports the loss of an earlier packet here and has not sent this one.
                self.counters.dropped.count(NOBODY_LISTENS)
                opened.send(packet)

        return transmit

    def _why_not(self, error: OSError) -> LinkDown:
        return cannot_reach(self.info.name, self._host, error)
