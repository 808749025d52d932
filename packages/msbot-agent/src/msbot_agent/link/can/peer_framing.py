"""The framing for one peer on a CAN bus: cuts its packets into frames, and joins its frames into packets."""

from __future__ import annotations

from collections.abc import Callable

from msbot_agent.link.can.controller import CanBusInfo
from msbot_agent.link.can.protocol.frames import COUNTER, REPEAT_S, Frame, FrameJoiner, split
from msbot_agent.link.can.protocol.ids import CAN_FD, COMPRESSION
from msbot_agent.link.contract import LinkCounters
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import RemoteProtocolError


@dataclass(frozen=True, slots=True)
class Codec:
    """Shortens packets and restores them exactly; used with peers that support it (`COMPRESSION`)."""

    compress: Callable[[bytes], bytes]
    decompress: Callable[[bytes], bytes]
    """Raises RemoteProtocolError for bytes that are not the short form of a packet."""


class CanWire:
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

    def cut(self, packet: bytes) -> list[Frame]:
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
