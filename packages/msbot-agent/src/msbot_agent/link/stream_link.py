"""What links over byte streams have in common: TCP connections, serial lines, pseudo terminals.

A stream (one connection, one port) cuts incoming data into packets and frames outgoing ones; one stream may carry
several peers. The link knows which peer is on which stream, and has the methods of `Link`. A stream has no task of its
own: its transport calls it.
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Iterable

from msbot_agent.link.base import BaseLink
from msbot_agent.link.contract import LinkInfo, Peer, Signal
from msbot_xrce.errors import LinkDown, LinkFull


class Stream(ABC):
    """One open byte stream; base of asyncio protocols, whose transport calls its methods."""

    write_limit: int
    """Bytes that may wait for the other side before there is no room."""

    def __init__(self, link: StreamLink) -> None:
        self.link = link
        self.full = False
        """Whether the other side is not taking data now."""
        self.transport: asyncio.Transport | None = None
        self.closed: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Done when it has closed; the reason in words."""

    @abstractmethod
    def decode(self, data: bytes) -> Iterable[tuple[Peer, bytes]]:
        """Take octets; returns `(peer, packet)` for each packet that is now whole."""

    @abstractmethod
    def encode(self, packet: bytes, peer: Peer) -> bytes:
        """One packet for a peer, as sent over the stream."""

    @abstractmethod
    def opened(self) -> None:
        """The transport is open."""

    @abstractmethod
    def peers(self) -> Iterable[Peer]:
        """The peers on the stream."""

    def abort(self) -> None:
        """Close at once; waiting data is lost."""
        if self.transport is not None:
            self.transport.abort()

    # Called by the transport (`asyncio.BaseProtocol`).

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The stream is open."""
        assert isinstance(transport, asyncio.Transport)
        transport.set_write_buffer_limits(high=self.write_limit, low=0)
        self.transport = transport
        self.opened()

    def data_received(self, data: bytes) -> None:
        """Octets came in."""
        for peer, packet in self.decode(data):
            self.link.received(packet, peer)

    def pause_writing(self) -> None:
        """The other side does not keep up."""
        self.full = True

    def resume_writing(self) -> None:
        """The other side has caught up."""
        self.full = False
        for peer in tuple(self.peers()):
            self.link.room_again(peer)

    def connection_lost(self, exc: Exception | None) -> None:
        """The stream is closed, by either side."""
        self.transport = None
        if not self.closed.done():
            words = "closed" if exc is None else f"broken: {getattr(exc, 'strerror', None) or exc}"
            self.closed.set_result(words)
            self.link.stream_closed(self, words)


class StreamLink(BaseLink, ABC):
    """A `Link` over streams."""

    def __init__(self, info: LinkInfo, *, remote: Peer | None = None) -> None:
        super().__init__(info, remote=remote)
        self._streams: dict[Peer, Stream] = {}

    def has_room(self, peer: Peer) -> bool:
        """See `Link`; False for a peer without a connection."""
        stream = self._streams.get(peer)
        return stream is not None and not stream.full

    def send(self, packet: bytes, peer: Peer) -> None:
        """Hand over one packet; never blocks.

        Raises:
            LinkFull: too much is waiting for the peer already.
            LinkDown: the peer has no connection.
        """
        stream = self._streams.get(peer)
        if stream is None or stream.transport is None or stream.transport.is_closing():
            raise LinkDown(f"{self.info.name}: there is no connection with {self.describe(peer)}")
        if stream.full:
            raise LinkFull(f"{self.info.name}: {self.describe(peer)} does not take its data")
        stream.transport.write(stream.encode(packet, peer))
        self._sent(packet, peer, asyncio.get_running_loop().time())

    @abstractmethod
    def describe(self, peer: Peer) -> str:
        """See `Link`."""

    @abstractmethod
    async def run(self) -> None:
        """See `Link`."""

    # Called by streams.

    def received(self, packet: bytes, peer: Peer) -> None:
        """A whole packet has come."""
        self._received(packet, peer, asyncio.get_running_loop().time())

    def room_again(self, peer: Peer) -> None:
        """A slow peer has caught up."""
        self._room_handler(peer)

    @abstractmethod
    def stream_closed(self, stream: Stream, words: str) -> None:
        """A stream has ended; `words` say why."""

    # For subclasses.

    def _tell(self, signal: Signal, peer: Peer | None, words: str) -> None:
        self._signal_handler(signal, peer, words, asyncio.get_running_loop().time())

    async def _close(self, streams: Iterable[Stream]) -> None:
        """Close streams, and wait until their transports are done; their peers are not reported as gone."""
        closing = set(streams)
        self._streams.clear()
        for stream in closing:
            stream.abort()
        if closing:
            await asyncio.wait([stream.closed for stream in closing])
