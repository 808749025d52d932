"""The state of a stream, for people who watch a session."""

from __future__ import annotations

from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.streams.sequence_numbers import NOTHING_YET


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
    """Reliable: outgoing messages that wait for the window, or incoming ones that came early and wait for a gap."""


def last_number(sequence_nr: int) -> int | None:
    """The number as shown to people; the one before 0 becomes None: there was no message yet (or exactly 65,536)."""
    return None if sequence_nr == NOTHING_YET else sequence_nr
