"""What the two ends of the CAN link share: the face of a `Link`, and one peer's packets as frames.

Base of `CanMasterLink` and `CanPartLink` for the sake of common code only; nobody else uses it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from msbot.errors import LocalProtocolError, RemoteProtocolError
from msbot.link import LinkCounters, LinkInfo, PacketHandler, Peer, Signal, SignalHandler, Tap
from msbot.link.can_bus import BusState, CanBus, CanBusInfo, FrameTap
from msbot.link.can_frames import COUNTER, REPEAT_S, Frame, Joiner, split
from msbot.link.can_ids import CAN_FD, COMPRESSION, CanIds, stop_words
from msbot.link.can_port import CanPort
from msbot.link.handlers import ignore_packet, ignore_room, ignore_signal

NOT_SENT: Final = "still waiting when the peer's address ended"
BUS_LEFT: Final = "still waiting when the controller left the bus"


@dataclass(frozen=True, slots=True)
class Codec:
    """A pair of exact inverses that shortens packets; used with peers that know it (`can_ids.COMPRESSION`)."""

    compress: Callable[[bytes], bytes]
    decompress: Callable[[bytes], bytes]
    """Raises RemoteProtocolError on bytes that no packet gives."""


class CanWire:
    """One peer: its packets cut into frames, and its frames joined to packets."""

    __slots__ = ("_codec", "_counters", "_fast", "_fd", "_next", "_send_id", "joiner")

    def __init__(
        self, send_id: int, *, use: int, info: CanBusInfo, mtu: int, counters: LinkCounters, codec: Codec | None
    ) -> None:
        """Begin anew with a peer.

        Args:
            send_id: identifier of the frames to it.
            use: the capabilities both sides agreed on.
            info: the bus.
            mtu: largest packet in bytes.
            counters: where drops are counted.
            codec: used when `use` says so.
        """
        self._send_id = send_id
        self._fd = bool(use & CAN_FD)
        self._fast = self._fd and info.data_bits_per_second is not None
        self._codec = codec if use & COMPRESSION else None
        self._counters = counters
        self._next = 0
        # A counter cannot come round sooner than 64 full frames, which are longer than 100 bits (but for FD).
        rate = None if self._fd else info.bits_per_second
        repeat_s = 6400 / rate if rate else REPEAT_S
        longest = mtu if self._codec is None else mtu + 1  # a packet that has no short form gets one octet longer
        self.joiner = Joiner(longest, dropped=counters.dropped, repeat_s=repeat_s)

    def cut(self, packet: bytes) -> list[Frame]:
        """The frames of a packet."""
        if self._codec is not None:
            packet = self._codec.compress(packet)
        parts = split(packet, self._next, self._fd)
        self._next = self._next + len(parts) & COUNTER
        send_id, fd, fast = self._send_id, self._fd, self._fast
        return [Frame(send_id, part, False, fd, fast) for part in parts]

    def unpack(self, message: bytes) -> bytes | None:
        """The packet in a whole message; None (and counted) when it is none."""
        if self._codec is None:
            return message
        try:
            return self._codec.decompress(message)
        except RemoteProtocolError as error:
            self._counters.drop(str(error))
            return None


class CanEnd(ABC):
    """The face of a `Link` on a CAN bus."""

    remote: Peer | None = None

    def __init__(self, bus: CanBus, *, ids: CanIds, mtu: int, codec: Codec | None, queue_frames: int) -> None:
        """Connect with the controller."""
        bits_per_second, compresses = bus.info.bits_per_second, codec is not None
        self.info = LinkInfo(bus.info.name, mtu, bits_per_second, shared_bus=True, compresses=compresses)
        self.counters = LinkCounters()
        self.tap: Tap | None = None
        self.foreign = 0
        """Frames of other equipment on the bus, which are none of our business."""
        self._ids = ids
        self._codec = codec
        self._packet_handler: PacketHandler = ignore_packet
        self._signal_handler: SignalHandler = ignore_signal
        self._room_handler: Callable[[Peer | None], None] = ignore_room
        self._port = CanPort(bus, self, ids=ids, queue_frames=queue_frames)

    def on_frame(self, tap: FrameTap) -> None:
        """Call `tap` with every frame that this end sends or receives."""
        self._port.frame_tap = tap

    @property
    def bus_state(self) -> BusState:
        """Fault confinement state of the controller."""
        return self._port.state

    def on_packet(self, handler: PacketHandler) -> None:
        """See `Link`."""
        self._packet_handler = handler

    def on_signal(self, handler: SignalHandler) -> None:
        """See `Link`."""
        self._signal_handler = handler

    def on_room(self, handler: Callable[[Peer | None], None]) -> None:
        """See `Link`."""
        self._room_handler = handler

    def has_room(self, peer: Peer) -> bool:
        """See `Link`; False as well while the peer has no address."""
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
        if self.tap is not None:
            self.tap(now, "out", peer, packet)
        self.counters.packets_out += 1
        self.counters.bytes_out += len(packet)
        self._port.queue.put(peer, frames)
        self._port.pump(now)

    def send_stop(self, reason: int = 0) -> None:
        """Say STOP to everybody on the bus, before all other frames; the reason is a byte (`can_ids.STOP_REASONS`).

        Raises:
            LinkDown: the link is not on the bus.
        """
        self._port.send_stop(reason)

    @abstractmethod
    def describe(self, peer: Peer) -> str:
        """See `Link`."""

    async def run(self) -> None:
        """See `Link`."""
        await self._port.run()

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
        if packet is None:
            return
        self.counters.packets_in += 1
        self.counters.bytes_in += len(packet)
        if self.tap is not None:
            self.tap(now, "in", peer, packet)
        self._packet_handler(packet, peer, now)

    def _forget_waiting(self, peer: int) -> None:
        self._count_frames(NOT_SENT, self._port.queue.clear(peer))

    def _count_frames(self, reason: str, frames: int) -> None:
        if frames:
            self.counters.dropped[reason] = self.counters.dropped.get(reason, 0) + frames

    # What the port tells (`PortOwner`), as far as both ends do the same

    def stopped(self, reason: int, now: float) -> None:
        """See `PortOwner`."""
        self._signal_handler(Signal.STOP, None, stop_words(reason), now)

    def room_again(self, peer: int) -> None:
        """See `PortOwner`."""
        self._room_handler(peer)

    @abstractmethod
    def drained(self, now: float) -> None:
        """See `PortOwner`."""

    @abstractmethod
    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""

    @abstractmethod
    def bus_up(self, now: float) -> None:
        """See `PortOwner`."""

    @abstractmethod
    def bus_down(self, reason: str, lost_frames: int, now: float) -> None:
        """See `PortOwner`."""

    @abstractmethod
    def timer(self) -> float | None:
        """See `PortOwner`."""

    @abstractmethod
    def handle_timer(self, now: float) -> None:
        """See `PortOwner`."""
