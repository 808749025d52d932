"""The CAN link of the thesis' firmware (R29): one component on a bus, identifiers 0x123 up and 0x120 down.

For boards whose firmware cannot be changed. It cannot do the following, which is why there is a native mode
(`native_link.py`): more than one component, addresses, messages beyond 1792 bytes, and the certainty that a message
arrives as it was sent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from msbot_agent.link.can.can_link_base import CanEnd
from msbot_agent.link.can.controller import CanBus, CanBusInfo
from msbot_agent.link.can.protocol.frame_queue import QUEUE_FRAMES
from msbot_agent.link.can.protocol.frames import COUNTER, REPEAT_S, Frame, FrameJoiner, split
from msbot_agent.link.can.protocol.ids import CAN_FD, COMPRESSION, CanIds
from msbot_agent.link.can.protocol.legacy_frames import DOWN, MTU, UP, LegacyJoiner, split_legacy
from msbot_agent.link.contract import LinkCounters, Peer
from msbot_xrce.errors import ConfigError, LinkDown, RemoteProtocolError
from msbot_xrce.lazy import dataclass

MASTER: Final = 0
"""The peer that a component sees."""
COMPONENT: Final = 1
"""The peer that a master sees."""

_WORDS: Final = {MASTER: "the master", COMPONENT: "the CAN component"}


class CanLegacyLink(CanEnd):
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
            bus: the controller; only classic frames are used.
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
        super().__init__(bus, mtu=MTU, remote=MASTER if component else None, queue_frames=queue_frames)
        self._peer = MASTER if component else COMPONENT
        self._send_id, self._receive_id = (up, down) if component else (down, up)
        self._joiner = LegacyJoiner(
            is_whole, dropped=self.counters.dropped, repeat_s=_repeat_s(bus.info.bits_per_second)
        )

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
        self._sent(packet, peer, now)
        self._port.queue.put(self._peer, [Frame(self._send_id, part) for part in parts])
        self._port.pump(now)

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        return _WORDS[self._peer] if peer == self._peer else f"nobody ({peer})"

    # What the port calls (`PortOwner`).

    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""
        if frame.can_id != self._receive_id or frame.extended or frame.remote or frame.error or frame.fd:
            self.foreign += 1
            return
        packet = self._joiner.receive(frame.data, now)
        if packet is not None:
            self._received(packet, self._peer, now)


def _repeat_s(bits_per_second: int | None) -> float:
    # The longest frame has 135 bits; its repetition follows at once, behind an error frame at most.
    return REPEAT_S if bits_per_second is None else 400 / bits_per_second


# The framing for one peer on a CAN bus: cuts its packets into frames, and joins its frames into packets.


@dataclass(frozen=True, slots=True)
class Codec:
    """Shortens packets and restores them exactly; used with peers that support it (`COMPRESSION`)."""

    compress: Callable[[bytes], bytes]
    decompress: Callable[[bytes], bytes]
    """Raises RemoteProtocolError for bytes that are not the short form of a packet."""


class PeerFraming:
    """One peer: cuts its packets into frames, and joins its frames into packets."""

    __slots__ = ("_codec", "_counters", "_fast", "_fd", "_next", "_send_id", "joiner")

    def __init__(
        self, send_id: int, *, use: int, info: CanBusInfo, mtu: int, counters: LinkCounters, codec: Codec | None
    ) -> None:
        """Start over with a peer.

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
        # The counter cannot wrap within 64 full frames, each longer than 100 bits (except with FD).
        rate = None if self._fd else info.bits_per_second
        repeat_s = 6400 / rate if rate else REPEAT_S
        longest = mtu if self._codec is None else mtu + 1  # a packet that has no short form gets one octet longer
        self.joiner = FrameJoiner(longest, dropped=counters.dropped, repeat_s=repeat_s)

    def split(self, packet: bytes) -> list[Frame]:
        """The frames of a packet."""
        if self._codec is not None:
            packet = self._codec.compress(packet)
        parts = split(packet, self._next, self._fd)
        self._next = self._next + len(parts) & COUNTER
        send_id, fd, fast = self._send_id, self._fd, self._fast
        return [Frame(send_id, part, False, fd, fast) for part in parts]

    def unpack(self, message: bytes) -> bytes | None:
        """The packet in a whole message; None (and counted) when it holds none."""
        if self._codec is None:
            return message
        try:
            return self._codec.decompress(message)
        except RemoteProtocolError as error:
            self._counters.dropped.count(str(error))
            return None
