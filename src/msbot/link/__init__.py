"""Links carry whole, opaque packets between this process and its peers.

A link knows nothing of DDS-XRCE. One link serves many peers (a UDP socket, a CAN bus); a peer is any hashable
value the link chose, and only the link can describe it in words. Everything arrives by call-back in the event
loop's thread; nothing is queued between the wire and the handler.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol, runtime_checkable

Peer = Hashable
"""Who a packet came from or goes to; chosen by the link, opaque to everybody else."""


class Signal(Enum):
    """What a link tells its owner besides packets."""

    LINK_UP = "link up"
    LINK_DOWN = "link down"
    PEER_JOINED = "peer joined"
    PEER_GONE = "peer gone"
    PEER_BACK = "peer back"
    """A peer that had gone is there again: the same one, as far as the link can tell (a serial port's name)."""
    STOP = "stop"


PacketHandler = Callable[[bytes, Peer, float], None]
"""`(packet, peer, now)`; must not block and must not raise."""

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
    """True when headers are shortened: request ids by rule, and a message for each sample, take least there."""


MOST_REASONS = 64
"""Different reasons that are counted; some have a number of the sender's in their words."""
OTHER_REASONS = "(others)"


@dataclass(slots=True)
class LinkCounters:
    """What happened on a link since it was opened."""

    packets_in: int = 0
    packets_out: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    """Packets or frames that were not delivered or not sent, by reason in words."""

    def drop(self, reason: str) -> None:
        """Count one dropped packet or frame under its reason, or under `(others)` when there are very many."""
        if reason not in self.dropped and len(self.dropped) >= MOST_REASONS:
            reason = OTHER_REASONS
        self.dropped[reason] = self.dropped.get(reason, 0) + 1


class Link(Protocol):
    """One way to one or many peers (see the module docstring)."""

    info: LinkInfo
    counters: LinkCounters
    tap: Tap | None
    """Called with every packet when set; None costs nothing."""
    remote: Peer | None
    """The peer of a link that has only one (the client side); None on a link that serves many."""

    def on_packet(self, handler: PacketHandler) -> None:
        """Set the one handler for incoming packets."""

    def on_signal(self, handler: SignalHandler) -> None:
        """Set the one handler for signals."""

    def on_room(self, handler: Callable[[Peer | None], None]) -> None:
        """Set the one handler that is called when `has_room` turns true again (None = for all peers)."""

    def has_room(self, peer: Peer) -> bool:
        """Whether `send` to that peer would be taken now."""

    def send(self, packet: bytes, peer: Peer) -> None:
        """Hand over one packet; never blocks.

        Raises:
            LinkFull: the peer's queue is full.
            LinkDown: the link is not open.
        """

    def describe(self, peer: Peer) -> str:
        """The peer in words, for example `127.0.0.1:40123` or `CAN node 7`."""

    async def run(self) -> None:
        """Serve the link until cancelled; closes it on the way out.

        Raises:
            LinkDown: it cannot be opened or has gone for good; the text names the remedy.
        """


@runtime_checkable
class BurstLink(Protocol):
    """What a link offers besides if it can tell where a burst of packets ends.

    Who answers all of them at once then saves a turn of the event loop for each burst.
    """

    def on_burst_end(self, handler: Callable[[], None]) -> None:
        """Set the one handler that is called after the last packet of every burst, however it was received."""


# The links stand below because they need the words above.
from msbot.link.address import open_link  # noqa: E402
from msbot.link.can_address import CanSettings, open_can_bus  # noqa: E402
from msbot.link.can_bits import FrameBits, frame_bits  # noqa: E402
from msbot.link.can_bus import BusState, CanBus, CanBusInfo, FrameTap  # noqa: E402
from msbot.link.can_cost import BEACONS_HZ, Cost, Framing, beacon_cost, message_cost  # noqa: E402
from msbot.link.can_end import CanEnd, Codec  # noqa: E402
from msbot.link.can_frames import Frame  # noqa: E402
from msbot.link.can_ids import CanIds  # noqa: E402
from msbot.link.can_legacy_link import CanLegacyLink  # noqa: E402
from msbot.link.can_link import CanMasterLink, CanPartLink  # noqa: E402
from msbot.link.can_nodes import MemoryNodeIds, NodeIds  # noqa: E402
from msbot.link.canfd_eprosima import CanFdEprosimaLink  # noqa: E402
from msbot.link.faults import LossyLink  # noqa: E402
from msbot.link.inproc import InprocEnd, InprocHub, inproc_pair  # noqa: E402
from msbot.link.pty import PtyServerLink  # noqa: E402
from msbot.link.serial import SerialClientLink, SerialServerLink  # noqa: E402
from msbot.link.sim_driver import SimBusDriver  # noqa: E402
from msbot.link.sim_events import BusCounters  # noqa: E402
from msbot.link.simbus import SimBus  # noqa: E402
from msbot.link.tcp import TcpClientLink, TcpServerLink  # noqa: E402
from msbot.link.udp import UdpClientLink, UdpServerLink  # noqa: E402
from msbot.link.virtual_time import VirtualTimeLoop, run_virtual  # noqa: E402

__all__ = [
    "BEACONS_HZ",
    "MOST_REASONS",
    "OTHER_REASONS",
    "BurstLink",
    "BusCounters",
    "BusState",
    "CanBus",
    "CanBusInfo",
    "CanEnd",
    "CanFdEprosimaLink",
    "CanIds",
    "CanLegacyLink",
    "CanMasterLink",
    "CanPartLink",
    "CanSettings",
    "Codec",
    "Cost",
    "Frame",
    "FrameBits",
    "FrameTap",
    "Framing",
    "InprocEnd",
    "InprocHub",
    "Link",
    "LinkCounters",
    "LinkInfo",
    "LossyLink",
    "MemoryNodeIds",
    "NodeIds",
    "PacketHandler",
    "Peer",
    "PtyServerLink",
    "SerialClientLink",
    "SerialServerLink",
    "Signal",
    "SignalHandler",
    "SimBus",
    "SimBusDriver",
    "Tap",
    "TcpClientLink",
    "TcpServerLink",
    "UdpClientLink",
    "UdpServerLink",
    "VirtualTimeLoop",
    "beacon_cost",
    "frame_bits",
    "inproc_pair",
    "message_cost",
    "open_can_bus",
    "open_link",
    "run_virtual",
]
