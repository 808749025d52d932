"""What every kind of link has in common: its counters, its tap, and the handlers of its owner."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from msbot_agent.link.contract import (
    LinkCounters,
    LinkInfo,
    PacketHandler,
    Peer,
    RoomHandler,
    Signal,
    SignalHandler,
    Tap,
)


class BaseLink:
    """Base of all links; each kind adds how to open, to send, and to describe a peer (see `Link`)."""

    def __init__(self, info: LinkInfo, *, remote: Peer | None = None) -> None:
        """Make a link without handlers; `remote` is the only peer of a client's side."""
        self.info = info
        self.counters = LinkCounters()
        self.tap: Tap | None = None
        self.remote = remote
        self._packet_handler: PacketHandler = _ignore_packet
        self._signal_handler: SignalHandler = _ignore_signal
        self._room_handler: RoomHandler = _ignore_room
        self._burst_end_handler: Callable[[], None] = _ignore_burst_end

    def attach(
        self,
        *,
        packet: PacketHandler | None = None,
        signal: SignalHandler | None = None,
        room: RoomHandler | None = None,
        burst_end: Callable[[], None] | None = None,
    ) -> None:
        """See `Link`."""
        self._packet_handler = packet or self._packet_handler
        self._signal_handler = signal or self._signal_handler
        self._room_handler = room or self._room_handler
        self._burst_end_handler = burst_end or self._burst_end_handler

    def origin(self, peer: Peer) -> Hashable:
        """See `Link`; by default each peer is its own origin."""
        return peer

    # For subclasses.

    def _received(self, packet: bytes, peer: Peer, now: float) -> None:
        """Count a packet that has come, and pass it on."""
        counters = self.counters
        counters.packets_in += 1
        counters.bytes_in += len(packet)
        if self.tap is not None:
            self.tap(now, "in", peer, packet)
        self._packet_handler(packet, peer, now)

    def _sent(self, packet: bytes, peer: Peer, now: float) -> None:
        """Count a packet that was accepted for sending."""
        counters = self.counters
        counters.packets_out += 1
        counters.bytes_out += len(packet)
        if self.tap is not None:
            self.tap(now, "out", peer, packet)


def _ignore_packet(packet: bytes, peer: Peer, now: float) -> None:
    """Nobody listens to packets."""


def _ignore_signal(signal: Signal, peer: Peer | None, words: str, now: float) -> None:
    """Nobody listens to signals."""


def _ignore_room(peer: Peer | None) -> None:
    """Nobody waits for room."""


def _ignore_burst_end() -> None:
    """Nobody waits for the end of a burst."""
