"""TCP links: a 16-bit length in front of every packet (`byte_frames`), one connection for each peer.

eProsima's DDS-XRCE clients use this over IPv4 and IPv6 (seen on the wire). The link reports a closed connection
(PEER_GONE), and every connection is a new peer; the owner decides whether a peer that closed its connection is gone for
good.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Hashable, Iterable

from msbot_agent.link.byte_frames import MAX_PACKET, TcpReceiver, encode_tcp
from msbot_agent.link.contract import LinkInfo, Peer, PeerDirectory, Signal
from msbot_agent.link.net.connection_budget import MAX_CONNECTIONS, ConnectionBudget
from msbot_agent.link.net.host_address import Address, addresses_of, cannot_listen, joined, serve_both_kinds
from msbot_agent.link.stream_link import Stream, StreamLink
from msbot_agent.pace import Acceptor, ConnectionPace
from msbot_xrce.errors import LinkDown

logger = logging.getLogger(__name__)

FIRST_PACKET_S = 10.0
"""A connection without a whole packet by then is closed."""

WRITE_LIMIT = 64 * 1024
"""Octets that may wait for one peer, in addition to those in the kernel."""

READ_OCTETS = 16 * 1024
"""Octets read from one connection before the others get their turn."""

RECONNECT_S = 0.5
"""Pause between two attempts of a client to reach its server."""

CONNECT_S = 3.0
"""Time for one attempt; in a network that swallows packets, the system would wait for minutes."""

CONNECTIONS_OF_ADDRESS_S, CONNECTIONS_S = 100.0, 200.0
"""Connections a second from one address where no part with a place is, and from all such addresses."""

VANISHED = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 25_000}
"""Socket options: the silent loss of a peer (power, cable) is noticed after 25 s at the latest. The system probes only
a connection on which nothing waits; octets that nobody acknowledges it would repeat for a quarter of an hour."""

UNANSWERED_S = 10.0
"""A client whose packets have had no answer for so long makes a new connection: what is between it and the server may
have forgotten the old one, and still take its octets."""

BROKEN_AT_ONCE = "connection broke as soon as it was made"
TOO_MANY = "connection refused: too many are open"
MADE_ROOM = "idle connection closed: it made room for another one"
SILENT = "connection closed: no packet came"


class TcpStream(Stream, asyncio.BufferedProtocol):
    """One connection."""

    write_limit = WRITE_LIMIT

    def __init__(self, link: TcpServerLink | TcpClientLink, peer: Peer = None) -> None:
        """`peer` is the other side as the link knows it; None = known by its address."""
        super().__init__(link)
        self.peer = peer
        self.heard_at: float | None = None
        """When its last whole packet came; None = none yet."""
        self._owner = link
        self._receiver = TcpReceiver()
        self._buffer = link.read_buffer

    def opened(self) -> None:
        """See `Stream`."""
        assert self.transport is not None
        connection = self.transport.get_extra_info("socket")
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for name, value in VANISHED.items():
                if hasattr(socket, name):
                    connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
            address = connection.getpeername()
        except OSError:
            self.link.counters.dropped.count(BROKEN_AT_ONCE)
            self.abort()
        else:
            self._owner.stream_opened(self, address)

    def peers(self) -> Iterable[Peer]:
        """See `Stream`."""
        return (self.peer,)

    def decode(self, data: bytes) -> Iterable[tuple[Peer, bytes]]:
        """See `Stream`."""
        packets = self._receiver.receive(data)
        if packets:
            self._owner.stream_spoke(self)
        peer = self.peer
        return [(peer, packet) for packet in packets]

    def encode(self, packet: bytes, peer: Peer) -> bytes:  # noqa: ARG002 - there is only one
        """See `Stream`."""
        return encode_tcp(packet)

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - asyncio's signature
        """Where the transport puts the next octets; all connections of a link share it."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """This many octets came in."""
        self.data_received(bytes(memoryview(self._buffer)[:nbytes]))


class TcpServerLink(StreamLink):
    """Listens at one address; a peer is `(host, port, number of the connection)`. Satisfies `Link`.

    Args:
        host: address or name to listen at; `0.0.0.0` for every IPv4 interface, `::` for IPv6 too.
        port: 1 to 65535, or 0 for any free one (see `port`).
        max_connections: beyond, one that never sent anything is closed, else an idle one, else the newcomer.
    """

    def __init__(self, host: str, port: int, *, max_connections: int = MAX_CONNECTIONS) -> None:
        super().__init__(LinkInfo(f"tcp:{joined(host, port)}", MAX_PACKET))
        self.read_buffer = bytearray(READ_OCTETS)
        self._host = host
        self._port = port
        self._budget: ConnectionBudget[TcpStream] = ConnectionBudget(max_connections)
        self._opening: set[asyncio.Task[object]] = set()
        self._count = 0
        self._listening: socket.socket | None = None
        self._pace: ConnectionPace | None = None

    def put_first(self, known: PeerDirectory) -> None:
        """See `PriorityLink`; to be said before it is opened."""
        self._pace = ConnectionPace(CONNECTIONS_OF_ADDRESS_S, CONNECTIONS_S, known.has_a_part)

    @property
    def port(self) -> int:
        """The port while the link is open (useful after asking for port 0), else 0."""
        return int(self._listening.getsockname()[1]) if self._listening is not None else 0

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
        """Listen until cancelled; it may run again afterwards.

        Raises:
            LinkDown: it cannot listen at the address; the text names the remedy.
        """
        loop = asyncio.get_running_loop()
        self._listening = await self._listen(loop)
        # The socket is closed here, too: asyncio forgets it when this is cancelled while the server starts.
        with self._listening:
            acceptor = Acceptor(self._listening, self._take, self.counters.dropped, pace=self._pace)
            self._tell(Signal.LINK_UP, None, "opened")
            try:
                await loop.create_future()
            finally:
                acceptor.stop()
                self._listening = None
                for opening in self._opening:
                    opening.cancel()
                await asyncio.gather(*self._opening, return_exceptions=True)
                await self._close(self._streams.values())
                self._tell(Signal.LINK_DOWN, None, "closed")

    def stream_opened(self, stream: TcpStream, address: Address) -> None:
        """A connection is open, unless there are too many already and none of them makes room."""
        loop = asyncio.get_running_loop()
        if self._budget.is_full(address[0]):
            idle = self._budget.who_makes_room(address[0], loop.time())
            self.counters.dropped.count(TOO_MANY if idle is None else MADE_ROOM)
            if idle is None:
                stream.abort()
                return
            self._budget.remove(idle, self.origin(idle.peer))
            idle.abort()
        self._count += 1
        stream.peer = (*address[:2], self._count)
        self._streams[stream.peer] = stream
        self._budget.add(stream, address[0])
        loop.call_later(FIRST_PACKET_S, self._look_at, stream)
        self._tell(Signal.PEER_JOINED, stream.peer, "connected")

    def stream_spoke(self, stream: TcpStream) -> None:
        """A whole packet has come."""
        if stream.heard_at is None:
            self._budget.first_packet_received(stream, self.origin(stream.peer))
        stream.heard_at = asyncio.get_running_loop().time()

    def stream_closed(self, stream: Stream, words: str) -> None:
        """See `StreamLink`."""
        for peer in stream.peers():
            if self._streams.pop(peer, None) is not None:
                assert isinstance(stream, TcpStream)
                self._budget.remove(stream, self.origin(peer))
                self._tell(Signal.PEER_GONE, peer, f"connection {words}")

    def _take(self, connection: socket.socket) -> None:
        opening = asyncio.get_running_loop().create_task(self._open(connection))
        self._opening.add(opening)
        opening.add_done_callback(self._opening.discard)

    async def _open(self, connection: socket.socket) -> None:
        try:
            await asyncio.get_running_loop().connect_accepted_socket(lambda: TcpStream(self), connection)
        except BaseException:
            connection.close()
            raise

    def _look_at(self, stream: TcpStream) -> None:
        if stream.heard_at is None and stream.transport is not None:
            self.counters.dropped.count(SILENT)
            stream.abort()

    async def _listen(self, loop: asyncio.AbstractEventLoop) -> socket.socket:
        found = await addresses_of(loop, self.info.name, self._host, self._port, kind=socket.SOCK_STREAM)
        family, kind, protocol, address = found[0]
        try:
            listening = socket.socket(family, kind, protocol)
        except OSError as error:
            raise self._why_not(error) from error
        try:
            listening.setblocking(False)
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            serve_both_kinds(listening, self._host)
            listening.bind(address)
            listening.listen()
        except OSError as error:
            listening.close()
            raise self._why_not(error) from error
        return listening

    def _why_not(self, error: OSError) -> LinkDown:
        return cannot_listen(self.info.name, self._host, self._port, error, lister="ss -tlnp")


class TcpClientLink(StreamLink):
    """Keeps one connection to a server, its `remote`, and reopens it whenever it breaks. Satisfies `Link`.

    LINK_UP and LINK_DOWN say when the connection opens and breaks. A server that is not there is tried again; one that
    answers nothing for `UNANSWERED_S`, however often the owner sends, counts as a broken connection.
    """

    def __init__(self, host: str, port: int) -> None:
        super().__init__(LinkInfo(f"tcp:{joined(host, port)}", MAX_PACKET), remote=(host, port))
        self.read_buffer = bytearray(READ_OCTETS)
        self._host = host
        self._port = port
        self._waits_since: float | None = None
        """When the first packet was sent that has had no answer."""
        self._given_up = ""
        """Why it closed the connection itself."""

    def describe(self, peer: Peer) -> str:  # noqa: ARG002 - there is only one
        """The server's address."""
        return joined(self._host, self._port)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `StreamLink`."""
        now = asyncio.get_running_loop().time()
        stream = self._streams.get(peer)
        if stream is not None and self._waits_since is not None and now - self._waits_since > UNANSWERED_S:
            self._given_up = f"given up: no answer for {UNANSWERED_S:g} s"
            stream.abort()
        super().send(packet, peer)
        if self._waits_since is None:
            self._waits_since = now

    async def run(self) -> None:
        """Keep the connection until cancelled; it may run again afterwards.

        Raises:
            LinkDown: there is no such host.
        """
        loop = asyncio.get_running_loop()
        # The name is looked up again for each attempt; only before the first one is a failure the user's mistake.
        await addresses_of(loop, self.info.name, self._host, self._port, kind=socket.SOCK_STREAM)
        try:
            while True:
                stream = await self._connect(loop)
                if stream is not None:
                    await asyncio.wait([stream.closed])
                await asyncio.sleep(RECONNECT_S)
        finally:
            was_open = bool(self._streams)
            await self._close(self._streams.values())
            if was_open:
                self._tell(Signal.LINK_DOWN, self.remote, "closed")

    def stream_opened(self, stream: TcpStream, address: Address) -> None:
        """The connection is open, unless it is connected to itself.

        That happens (RFC 9293 3.5, figure 7) when the system gives the attempt the same port that it connects to.
        """
        assert stream.transport is not None
        if stream.transport.get_extra_info("sockname") == address:
            stream.abort()
            return
        self._streams[self.remote] = stream
        self._waits_since, self._given_up = None, ""
        self._tell(Signal.LINK_UP, self.remote, "connected")

    def stream_spoke(self, stream: TcpStream) -> None:  # noqa: ARG002 - there is only one
        """A whole packet has come: the server is there."""
        self._waits_since = None

    def stream_closed(self, stream: Stream, words: str) -> None:  # noqa: ARG002 - there is only one
        """See `StreamLink`."""
        if self._streams.pop(self.remote, None) is not None:
            self._tell(Signal.LINK_DOWN, self.remote, f"connection {self._given_up or words}")

    async def _connect(self, loop: asyncio.AbstractEventLoop) -> TcpStream | None:
        """Make one attempt; None if it failed."""
        try:
            async with asyncio.timeout(CONNECT_S):
                _, stream = await loop.create_connection(lambda: TcpStream(self, self.remote), self._host, self._port)
        except OSError as error:
            logger.debug("%s: no connection: %s", self.info.name, error)
            return None
        return stream
