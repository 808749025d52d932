"""How a stream stands, for people who watch a session."""

from __future__ import annotations

from dataclasses import dataclass

from msbot.xrce.streams.sequence_numbers import NOTHING_YET


@dataclass(frozen=True, slots=True)
class StreamState:
    """One stream of a session in one direction."""

    stream_id: int
    outgoing: bool
    last: int | None
    """Number of the newest message sent, or handled; None = none yet."""
    unacked: int = 0
    """Reliable and outgoing: messages on their way or missing."""
    waiting: int = 0
    """Reliable: outgoing what waits for the window, incoming what came early and waits for the gap before it."""


def last_number(sequence_nr: int) -> int | None:
    """The number as a person wants it; the one before 0 means that there was none (or 65,536 exactly)."""
    return None if sequence_nr == NOTHING_YET else sequence_nr
