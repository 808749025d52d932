"""Parts that connect through the page: one WebSocket each, with one binary message per packet.

The page's server owns the connections and knows which person each belongs to; this link knows neither HTTP nor
sessions. For each connection the server calls `join`, passes packets to `SocketPeer.receive`, sends the packets from
`SocketPeer.next_packet`, and finally calls `SocketPeer.connection_ended`. A server that can also send at once says so
by `SocketPeer.send_by`. A text message from the server is a sentence for the person; a part sends none.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Hashable

from msbot_agent.link.base import BaseLink
from msbot_agent.link.byte_frames import MAX_PACKET
from msbot_agent.link.contract import ConnectionUser, LinkInfo, Peer, Signal
from msbot_agent.link.net.connection_budget import ConnectionRateLimit
from msbot_agent.text.sentence import said
from msbot_xrce.errors import LinkDown, LinkFull

MOST = 256
"""Connections in all."""
MOST_OF_PERSON = 32
MOST_OF_ADDRESS = 128
"""Most connections from one address: a class behind one router shares one."""
WRITE_LIMIT = 64 * 1024
"""Octets that may wait for one peer, in addition to those in the system."""
FIRST_PACKET_S = 10.0
"""A connection without a packet by then is closed."""
SLOW_DOWN_AGAIN_S = 30.0
"""Time before a part that is too fast is told so again."""

TOO_MANY = "connection refused: too many are open"
NO_PACKET = "no packet, but text or more bytes than a packet has"
SILENT = "connection closed: no packet came"


class SocketPeer:
    """One open connection."""

    def __init__(self, link: WebSocketServerLink, visitor: ConnectionUser, now: float) -> None:
        self.visitor = visitor
        self._heard = False
        self._began_at = now
        self._link = link
        self._waiting: deque[bytes] = deque()
        self._octets = 0
        self._is_full = False
        self._more = asyncio.Event()
        self._send_at_once: Callable[[bytes], bool] = _cannot_send
        self._has_nothing = False
        """Whether the network has taken every packet, and the server waits for the next one."""
        self._budget = ConnectionRateLimit()
        self._told_at: float | None = None

    @property
    def has_room(self) -> bool:
        """Whether `put` would succeed."""
        return self._octets < WRITE_LIMIT

    def receive(self, packet: bytes, now: float) -> tuple[float, str]:
        """A binary message has come.

        Returns:
            For how many seconds nothing more may be read, and a sentence for the person or "".

        Raises:
            ValueError: it is not a packet; close the connection with that sentence.
        """
        if not 0 < len(packet) <= MAX_PACKET:
            self._link.counters.dropped.count(NO_PACKET)
            raise ValueError(said("a packet has 1 to {most} bytes, not {size}", most=MAX_PACKET, size=len(packet)))
        self._heard = True
        self._link.peer_brought(packet, self, now)
        pause_s = self._budget.spend(len(packet), now)
        if not pause_s or (self._told_at is not None and now - self._told_at < SLOW_DOWN_AGAIN_S):
            return pause_s, ""
        self._told_at = now
        return pause_s, said("this part sends more than the robot takes from one part: send less often")

    def took_text(self) -> str:
        """A text message has come; returns the sentence with which to close the connection."""
        self._link.counters.dropped.count(NO_PACKET)
        return said("a part sends packets of DDS-XRCE in binary messages, and no text")

    def is_silent(self, now: float) -> bool:
        """Whether no packet came in time, so that it must be closed."""
        if self._heard or now - self._began_at < FIRST_PACKET_S:
            return False
        self._link.counters.dropped.count(SILENT)
        return True

    def send_by(self, send_at_once: Callable[[bytes], bool]) -> None:
        """Send packets by this function while nothing waits; it returns False when the packet has to wait."""
        self._send_at_once = send_at_once

    def put(self, packet: bytes) -> None:
        """Send a packet, or queue it for sending; there must be room."""
        if self._has_nothing and self._send_at_once(packet):
            return
        self._has_nothing = False
        self._waiting.append(packet)
        self._octets += len(packet)
        self._is_full = not self.has_room
        self._more.set()

    async def next_packet(self) -> bytes:
        """The next packet to send; a call also says that the network has taken the previous one."""
        while not self._waiting:
            self._more.clear()
            self._has_nothing = True
            await self._more.wait()
        packet = self._waiting.popleft()
        self._octets -= len(packet)
        if self._is_full and not self._waiting:
            self._is_full = False
            self._link.peer_has_room(self)
        return packet

    def connection_ended(self, words: str) -> None:
        """The connection has ended, on either side."""
        self._link.peer_gone(self, words)


def _cannot_send(_packet: bytes) -> bool:
    """Nobody can send at once."""
    return False


class WebSocketServerLink(BaseLink):
    """Satisfies `Link`; a peer is a `SocketPeer`.

    Args:
        name: the link's address, as parts write it.
    """

    def __init__(self, name: str) -> None:
        super().__init__(LinkInfo(name, MAX_PACKET, sparse_acknacks=True))
        self._peers: set[SocketPeer] = set()
        self._is_open = False

    def join(self, visitor: ConnectionUser) -> SocketPeer:
        """A connection is open.

        Raises:
            LinkFull: there are too many; the text says which limit.
            LinkDown: the robot does not serve parts now.
        """
        if not self._is_open:
            raise LinkDown(said("the robot starts or ends just now: try again in a moment"))
        of_person = sum(peer.visitor.person == visitor.person for peer in self._peers)
        of_address = sum(peer.visitor.address == visitor.address for peer in self._peers)
        for count, most, whose in (
            (of_person, MOST_OF_PERSON, visitor.person),
            (of_address, MOST_OF_ADDRESS, visitor.address),
            (len(self._peers), MOST, said("the robot")),
        ):
            if count >= most:
                self.counters.dropped.count(TOO_MANY)
                raise LinkFull(
                    said("{whose} has {count} parts on the page already: end one first", whose=whose, count=count)
                )
        now = self._now()
        peer = SocketPeer(self, visitor, now)
        self._peers.add(peer)
        self._signal_handler(Signal.PEER_JOINED, peer, "connected", now)
        return peer

    def has_room(self, peer: Peer) -> bool:
        """See `Link`; False for a peer that has gone."""
        return peer in self._peers and isinstance(peer, SocketPeer) and peer.has_room

    def send(self, packet: bytes, peer: Peer) -> None:
        """Hand over one packet; never blocks.

        Raises:
            LinkFull: too much is waiting for the peer already.
            LinkDown: the peer has gone.
        """
        if peer not in self._peers or not isinstance(peer, SocketPeer):
            raise LinkDown(f"{self.info.name}: there is no connection with {self.describe(peer)}")
        if not peer.has_room:
            raise LinkFull(f"{self.info.name}: {self.describe(peer)} does not take its data")
        peer.put(packet)
        self._sent(packet, peer, self._now())

    def origin(self, peer: Peer) -> Hashable:
        """See `Link`: the person."""
        return peer.visitor.person if isinstance(peer, SocketPeer) else peer

    def describe(self, peer: Peer) -> str:
        """`ann at 192.168.1.30`."""
        return f"{peer.visitor.person} at {peer.visitor.address}" if isinstance(peer, SocketPeer) else str(peer)

    async def run(self) -> None:
        """Serve until cancelled; it may run again afterwards. The page's server closes the connections."""
        self._is_open = True
        self._signal_handler(Signal.LINK_UP, None, "opened", self._now())
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self._is_open = False
            self._peers.clear()
            self._signal_handler(Signal.LINK_DOWN, None, "closed", self._now())

    # Called by peers.

    def peer_brought(self, packet: bytes, peer: SocketPeer, now: float) -> None:
        """A packet has come."""
        if peer in self._peers:
            self._received(packet, peer, now)

    def peer_has_room(self, peer: SocketPeer) -> None:
        """A slow peer has caught up."""
        if peer in self._peers:
            self._room_handler(peer)

    def peer_gone(self, peer: SocketPeer, words: str) -> None:
        """A connection has ended."""
        if peer in self._peers:
            self._peers.discard(peer)
            self._signal_handler(Signal.PEER_GONE, peer, words, self._now())

    @staticmethod
    def _now() -> float:
        return asyncio.get_running_loop().time()
