"""Handlers of a link that nobody has set yet: they do nothing."""

from __future__ import annotations

from msbot.link import Peer, Signal


def ignore_packet(packet: bytes, peer: Peer, now: float) -> None:
    """Nobody listens to packets."""


def ignore_signal(signal: Signal, peer: Peer | None, words: str, now: float) -> None:
    """Nobody listens to signals."""


def ignore_room(peer: Peer | None) -> None:
    """Nobody waits for room."""


def ignore_burst_end() -> None:
    """Nobody waits for the end of a burst."""
