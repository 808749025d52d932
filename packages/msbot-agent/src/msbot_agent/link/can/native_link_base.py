"""What the two ends of the native CAN link have in common: sending packets through the `CanWire` of each peer, and
STOP."""

from __future__ import annotations

from abc import abstractmethod
from typing import Final

from msbot_agent.link.can.can_link_base import CanEnd
from msbot_agent.link.can.controller import CanBus
from msbot_agent.link.can.peer_framing import CanWire, Codec
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_agent.link.contract import Peer
from msbot_xrce.errors import LocalProtocolError

NOT_SENT: Final = "still waiting when the peer's address ended"


class NativeEnd(CanEnd):
    """Base of `CanMasterLink` and `CanPartLink`."""

    def __init__(
        self, bus: CanBus, *, ids: CanIds, mtu: int, codec: Codec | None, queue_frames: int, remote: Peer | None = None
    ) -> None:
        """Connect with the controller."""
        super().__init__(bus, mtu=mtu, remote=remote, ids=ids, compresses=codec is not None, queue_frames=queue_frames)
        self._codec = codec

    def has_room(self, peer: Peer) -> bool:
        """See `Link`; also False while the peer has no address."""
        return isinstance(peer, int) and self._wire(peer) is not None and self._port.queue.has_room(peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`.

        Raises:
            LinkFull: the peer's queue is full.
            LinkDown: the link is not on the bus, or the peer has no address.
            LocalProtocolError: the packet is empty or longer than `info.mtu`.
        """
        self._port.check_up()
        wire = self._wire(peer) if isinstance(peer, int) else None
        if wire is None or not isinstance(peer, int):
            raise self._no_address(peer)
        if len(packet) > self.info.mtu:
            raise LocalProtocolError(f"a packet of {len(packet)} bytes is longer than the link's {self.info.mtu}")
        self._port.check_room(peer, self.describe(peer))
        frames = wire.cut(packet)
        now = self._port.now()
        self._sent(packet, peer, now)
        self._port.queue.put(peer, frames)
        self._port.pump(now)

    def send_stop(self, reason: int = 0) -> None:
        """Send STOP to every node on the bus, before all other frames; the reason is a byte (`STOP_REASONS`).

        Raises:
            LinkDown: the link is not on the bus.
        """
        self._port.send_stop(reason)

    @abstractmethod
    def _wire(self, peer: int) -> CanWire | None:
        """The wire to a peer that has an address."""

    def _new_wire(self, send_id: int, use: int) -> CanWire:
        info, counters = self._port.bus.info, self.counters
        return CanWire(send_id, use=use, info=info, mtu=self.info.mtu, counters=counters, codec=self._codec)

    @abstractmethod
    def _no_address(self, peer: Peer) -> Exception:
        """Why there is no wire to that peer."""

    def _deliver(self, message: bytes, peer: int, wire: CanWire, now: float) -> None:
        packet = wire.unpack(message)
        if packet is not None:
            self._received(packet, peer, now)

    def _forget_waiting(self, peer: int) -> None:
        self._count_frames(NOT_SENT, self._port.queue.clear(peer))
