"""Links carry whole, opaque packets between this process and its peers.

A link knows nothing of DDS-XRCE. One link serves many peers (a UDP socket, a CAN bus); a peer is any hashable
value the link chose, and only the link can describe it in words. Everything arrives by call-back in the event
loop's thread; nothing is queued between the wire and the handler.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import field
from enum import Enum
from typing import Protocol, runtime_checkable

from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass

Peer = Hashable
"""Who a packet came from or goes to; chosen by the link, opaque to everybody else."""


class Signal(Enum):
    """What a link reports to its owner, apart from packets."""

    LINK_UP = "link up"
    LINK_DOWN = "link down"
    PEER_JOINED = "peer joined"
    PEER_GONE = "peer gone"
    PEER_BACK = "peer back"
    """A peer that had gone is back: the same one, as far as the link can tell (by a serial port's name)."""
    STOP = "stop"


PacketHandler = Callable[[bytes, Peer, float], None]
"""`(packet, peer, now)`; must not block and must not raise."""

RoomHandler = Callable[[Peer | None], None]
"""`(peer)`: there is room again for packets to that peer; None = to all peers."""

SignalHandler = Callable[[Signal, Peer | None, str, float], None]
"""`(signal, peer or None, reason in words, now)`."""

Tap = Callable[[float, str, Peer, bytes], None]
"""`(now, "in" | "out", peer, packet)`; for monitors and recorders."""


@dataclass(frozen=True, slots=True)
class LinkInfo:
    """What never changes while a link is open."""

    name: str
    """Address string as the user wrote it, for example `udp:127.0.0.1:8888` or `sim:500000`."""
    mtu: int
    """Largest packet in bytes."""
    bits_per_second: int | None = None
    """Bit rate of the medium where it limits the traffic; None = fast."""
    shared_bus: bool = False
    """True when every peer hears and delays every other (CAN)."""
    compresses: bool = False
    """True when headers are compressed: request ids by rule, and one message per sample, are then the shortest."""
    keeps_order: bool = True
    """False when a packet may overtake another one on its way (UDP)."""
    in_bursts: bool = False
    """True when the link signals the end of every burst of packets: an owner that answers the whole burst at once then
    saves a turn of the event loop per packet."""
    sparse_acknacks: bool = False
    """True when nothing is lost between two ends of MsBOT: one ACKNACK then speaks for several messages."""


@dataclass(slots=True)
class LinkCounters:
    """What happened on a link since it was opened."""

    packets_in: int = 0
    packets_out: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    dropped: Tally = field(default_factory=Tally)
    """Packets or frames that were not delivered or not sent, by reason in words."""


class PeerDirectory(Protocol):
    """Whom a link's owner knows, for a link that must choose during a flood of packets."""

    @property
    def stranger_count(self) -> int:
        """How many packets of peers without a session the owner has had so far."""

    def knows(self, peer: Peer) -> bool:
        """Whether that peer has a session."""

    def has_a_part(self, origin: Hashable) -> bool:
        """Whether a peer with a place in the robot is, or was lately, at that origin (`Link.origin`)."""

    def preferred_peers(self, most: int) -> Iterable[Peer]:
        """The peers whose packets go before those of strangers, at most so many: those with a place in the robot
        first."""


@runtime_checkable
class PriorityLink(Protocol):
    """A link that can put the packets of known peers before those of strangers."""

    def put_first(self, known: PeerDirectory) -> None:
        """Do so from now on, or from when it is opened."""


@runtime_checkable
class BacklogLink(Protocol):
    """A link that knows when it could not read all that had come."""

    unread_at: float
    """When a burst last ended with more left in the system, on the clock of packets; minus infinity: never."""


class Link(Protocol):
    """One way to one or many peers (see the module docstring)."""

    info: LinkInfo
    counters: LinkCounters
    tap: Tap | None
    """If set, called with every packet; None costs nothing."""
    remote: Peer | None
    """The peer of a link that has only one (the client side); None on a link that serves many."""

    def attach(
        self,
        *,
        packet: PacketHandler | None = None,
        signal: SignalHandler | None = None,
        room: RoomHandler | None = None,
        burst_end: Callable[[], None] | None = None,
    ) -> None:
        """Set those of the owner's handlers that are given; each replaces the previous one.

        Args:
            packet: is called with each packet that comes in.
            signal: is called when something happens to the link or its peers.
            room: is called when `has_room` becomes true again.
            burst_end: is called after the last packet of every burst, if `info.in_bursts`.
        """

    def has_room(self, peer: Peer) -> bool:
        """Whether `send` to that peer would succeed now."""

    def send(self, packet: bytes, peer: Peer) -> None:
        """Hand over one packet; never blocks.

        Raises:
            LinkFull: the peer's queue is full.
            LinkDown: the link is not open.
        """

    def origin(self, peer: Peer) -> Hashable:
        """A value shared by all peers on one machine or wire: a computer's address, a port, a node."""

    def describe(self, peer: Peer) -> str:
        """The peer in words, for example `127.0.0.1:40123` or `CAN node 7`."""

    async def run(self) -> None:
        """Serve the link until cancelled; closes it on the way out.

        Raises:
            LinkDown: it cannot be opened or has gone for good; the text names the remedy.
        """


# The person behind a peer: known where the page's server has asked who is there, and nowhere else.
#
# Whatever is spoken inside such a connection stays that person's: a part behind a relay that came in by it, and a
# part at an agent that came in by it, too.


@dataclass(frozen=True, slots=True)
class ConnectionUser:
    """The person behind a connection."""

    person: str
    address: str
    """The computer's address, without the port."""
    pupil: str = ""
    """The pupil whose rights everything from there has, whom a teacher may hold; empty: it is no pupil's."""


def user_of_connection(peer: Peer) -> ConnectionUser | None:
    """The person behind a peer; None: nobody has asked."""
    visitor = getattr(peer, "visitor", None)
    return visitor if isinstance(visitor, ConnectionUser) else None


def pupil_of_connection(peer: Peer) -> str:
    """The pupil behind a peer; empty: it is somewhere else, or somebody else's."""
    visitor = user_of_connection(peer)
    return "" if visitor is None else visitor.pupil
