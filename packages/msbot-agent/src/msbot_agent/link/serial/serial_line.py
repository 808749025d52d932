"""Serial lines: frames with addresses (`byte_frames`), so that one line may carry several clients.

What serial ports and pseudo terminals have in common. A peer is `(port, address)`: the port's name and the address
octet that is the source in its frames. When a line breaks, its peers are gone (PEER_GONE). When the port is back, they
are assumed to be back, too (PEER_BACK): a robot whose cable was pulled goes on where it was.
"""

from __future__ import annotations

import asyncio
from abc import abstractmethod
from collections.abc import Hashable, Iterable

from msbot_agent.link.byte_frames import MAX_PACKET, SerialReceiver, encode_serial
from msbot_agent.link.contract import LinkInfo, Peer, Signal
from msbot_agent.link.stream_link import Stream, StreamLink

AGENT_ADDRESS = 0
"""The agent's address on every line (seen on the wire)."""

CLIENT_ADDRESS = 1
"""The usual address of a client."""

WRITE_LIMIT = 1024
"""Octets that may wait in addition to those in the kernel: few, so that data on a slow line stays fresh."""


class SerialLine(Stream, asyncio.Protocol):
    """One open port."""

    write_limit = WRITE_LIMIT

    def __init__(self, link: SerialLineLink, port: str) -> None:
        super().__init__(link)
        self.port = port
        self.known: set[Peer] = set()
        """The peers on the line."""
        self._owner = link
        self._address = link.address
        self._receiver = SerialReceiver(link.address, dropped=link.counters.dropped)

    def opened(self) -> None:
        """See `Stream`."""
        self._owner.line_opened(self)

    def peers(self) -> Iterable[Peer]:
        """See `Stream`."""
        return self.known

    def decode(self, data: bytes) -> Iterable[tuple[Peer, bytes]]:
        """See `Stream`."""
        for source, packet in self._receiver.receive(data):
            peer = (self.port, source)
            if peer in self.known or self._owner.accepts_newcomer(self, source):
                yield peer, packet

    def encode(self, packet: bytes, peer: Peer) -> bytes:
        """See `Stream`."""
        assert isinstance(peer, tuple)
        return encode_serial(packet, self._address, peer[1])


class SerialLineLink(StreamLink):
    """A link over serial lines, seen from one address."""

    def __init__(self, name: str, *, address: int, bits_per_second: int | None = None) -> None:
        super().__init__(LinkInfo(name, MAX_PACKET, bits_per_second))
        self.address = address
        """Own address octet, 0 to 255."""
        self._lines: dict[str, SerialLine] = {}

    def origin(self, peer: Peer) -> Hashable:
        """See `Link`: the port."""
        return peer[0] if isinstance(peer, tuple) else peer

    def describe(self, peer: Peer) -> str:
        """Port and address, `/dev/ttyUSB0 address 1`."""
        match peer:
            case (str() as port, int() as address):
                return f"{port} address {address}"
        return str(peer)

    # Called by lines.

    def line_opened(self, line: SerialLine) -> None:
        """A port is open."""
        self._lines[line.port] = line

    @abstractmethod
    def accepts_newcomer(self, line: SerialLine, source: int) -> bool:
        """A frame came from a new address on this line; returns whether to accept it."""

    async def _close_lines(self) -> None:
        lines = list(self._lines.values())
        self._lines.clear()
        await self._close(lines)


class SerialLineServer(SerialLineLink):
    """The agent's side of serial lines: any address is accepted."""

    def __init__(self, name: str, *, bits_per_second: int | None = None) -> None:
        super().__init__(name, address=AGENT_ADDRESS, bits_per_second=bits_per_second)
        self._gone: dict[str, set[Peer]] = {}
        """Ports that have vanished -> the peers that were on them."""

    def line_opened(self, line: SerialLine) -> None:
        """See `SerialLineLink`."""
        super().line_opened(line)
        for peer in sorted(self._gone.pop(line.port, ()), key=str):
            self._add(line, peer, Signal.PEER_BACK, "its port is there again")

    def accepts_newcomer(self, line: SerialLine, source: int) -> bool:
        """See `SerialLineLink`."""
        self._add(line, (line.port, source), Signal.PEER_JOINED, "heard for the first time")
        return True

    def stream_closed(self, stream: Stream, words: str) -> None:
        """See `StreamLink`."""
        assert isinstance(stream, SerialLine)
        if self._lines.get(stream.port) is not stream:
            return
        del self._lines[stream.port]
        self._gone[stream.port] = stream.known
        for peer in sorted(stream.known, key=str):
            del self._streams[peer]
            self._tell(Signal.PEER_GONE, peer, f"port {words}")

    def _add(self, line: SerialLine, peer: Peer, signal: Signal, words: str) -> None:
        line.known.add(peer)
        self._streams[peer] = line
        self._tell(signal, peer, words)
