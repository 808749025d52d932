"""The CAN link of the thesis' firmware (R29): one component on a bus, identifiers 0x123 up and 0x120 down.

For boards whose firmware is given. What it cannot do is the reason for the native mode (`can_link`): more than one
component, addresses, messages beyond 1792 bytes, and the certainty that a message is the one that was sent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from msbot.errors import ConfigError, LinkDown
from msbot.link import LinkCounters, LinkInfo, PacketHandler, Peer, Signal, SignalHandler, Tap
from msbot.link.can_bus import BusState, CanBus
from msbot.link.can_end import BUS_LEFT
from msbot.link.can_frames import REPEAT_S, Frame
from msbot.link.can_ids import CanIds, stop_words
from msbot.link.can_legacy import DOWN, MTU, UP, LegacyJoiner, split_legacy
from msbot.link.can_port import CanPort
from msbot.link.can_queue import QUEUE_FRAMES
from msbot.link.handlers import ignore_packet, ignore_room, ignore_signal

MASTER: Final = 0
"""The peer of a component."""
COMPONENT: Final = 1
"""The peer of a master."""

_WORDS: Final = {MASTER: "the master", COMPONENT: "the CAN component"}


class CanLegacyLink:
    """The master's end, or with `component` the component's. Satisfies `Link`."""

    def __init__(
        self,
        bus: CanBus,
        *,
        is_whole: Callable[[bytes], bool],
        component: bool = False,
        up: int = UP,
        down: int = DOWN,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        """Make the link; `run` opens it.

        Args:
            bus: the controller; frames are classic ones.
            is_whole: whether octets are one message from its beginning to its end, which this format cannot tell.
            component: the component's end.
            up: identifier from the component to the master, 11 bits.
            down: identifier from the master to the component; the published agent of the thesis answers with `up`.
            queue_frames: frames that may wait before there is no room.

        Raises:
            ConfigError: an identifier has more than 11 bits, or is that of STOP.
        """
        for can_id in (up, down):
            if not 0 <= can_id <= 0x7FF or can_id == CanIds().stop:
                raise ConfigError(f"CAN identifier {can_id:#x} cannot be used: choose another one from 0 to 0x7ff")
        bits_per_second = bus.info.bits_per_second
        self.info = LinkInfo(bus.info.name, MTU, bits_per_second, shared_bus=True)
        self.counters = LinkCounters()
        self.tap: Tap | None = None
        self.remote: Peer | None = MASTER if component else None
        self.foreign = 0
        """Frames of other equipment."""
        self._peer = MASTER if component else COMPONENT
        self._send_id, self._receive_id = (up, down) if component else (down, up)
        self._joiner = LegacyJoiner(is_whole, dropped=self.counters.dropped, repeat_s=_repeat_s(bits_per_second))
        self._packet_handler: PacketHandler = ignore_packet
        self._signal_handler: SignalHandler = ignore_signal
        self._room_handler: Callable[[Peer | None], None] = ignore_room
        self._port = CanPort(bus, self, ids=CanIds(), queue_frames=queue_frames)

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
        """See `Link`."""
        return peer == self._peer and self._port.is_up and self._port.queue.has_room(self._peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`.

        Raises:
            LinkFull: the queue is full.
            LinkDown: the link is not on the bus, or there is no such peer.
            LocalProtocolError: the packet is empty or longer than 1792 bytes.
        """
        self._port.check_up()
        if peer != self._peer:
            raise LinkDown(f"there is only {_WORDS[self._peer]} at the other end ({self._peer}), not {peer}")
        parts = split_legacy(packet)
        self._port.check_room(self._peer, self.describe(peer))
        now = self._port.now()
        if self.tap is not None:
            self.tap(now, "out", peer, packet)
        self.counters.packets_out += 1
        self.counters.bytes_out += len(packet)
        self._port.queue.put(self._peer, [Frame(self._send_id, part) for part in parts])
        self._port.pump(now)

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        return _WORDS[self._peer] if peer == self._peer else f"nobody ({peer})"

    async def run(self) -> None:
        """See `Link`."""
        await self._port.run()

    # What the port tells (`PortOwner`).

    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""
        if frame.can_id != self._receive_id or frame.extended or frame.remote or frame.error or frame.fd:
            self.foreign += 1
            return
        packet = self._joiner.receive(frame.data, now)
        if packet is None:
            return
        self.counters.packets_in += 1
        self.counters.bytes_in += len(packet)
        if self.tap is not None:
            self.tap(now, "in", self._peer, packet)
        self._packet_handler(packet, self._peer, now)

    def stopped(self, reason: int, now: float) -> None:
        """See `PortOwner`."""
        self._signal_handler(Signal.STOP, None, stop_words(reason), now)

    def room_again(self, peer: int) -> None:
        """See `PortOwner`."""
        self._room_handler(peer)

    def drained(self, now: float) -> None:
        """See `PortOwner`."""

    def bus_up(self, now: float) -> None:
        """See `PortOwner`."""
        self._signal_handler(Signal.LINK_UP, self.remote, "on the bus", now)

    def bus_down(self, reason: str, lost_frames: int, now: float) -> None:
        """See `PortOwner`."""
        for _ in range(lost_frames):
            self.counters.drop(BUS_LEFT)
        self._signal_handler(Signal.LINK_DOWN, self.remote, reason, now)

    def timer(self) -> float | None:
        """See `PortOwner`."""
        return None

    def handle_timer(self, now: float) -> None:
        """See `PortOwner`."""


def _repeat_s(bits_per_second: int | None) -> float:
    # The longest frame has 135 bits; its repetition follows at once, behind an error frame at most.
    return REPEAT_S if bits_per_second is None else 400 / bits_per_second
