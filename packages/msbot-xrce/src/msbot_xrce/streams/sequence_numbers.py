"""Arithmetic on sequence numbers: 16 bits that wrap from 65535 to 0 (XRCE 1.0 §8.3.2, RFC 1982).

The state "nothing yet" is the number before the first one, 65535. Two numbers exactly 32768 apart have no order:
neither is after the other (seen on the wire: an agent refuses 0x7FFF as the first number of a best-effort stream and
takes 0x7FFE).
"""

from __future__ import annotations

from msbot_xrce.lazy import dataclass

NOTHING_YET = 0xFFFF
"""The "last number handled" before the first message of a stream, which has number 0."""

HALF = 0x8000
"""Distances from here on mean "behind"."""


def distance(start: int, end: int) -> int:
    """The number of steps forward from `start` to `end`, 0 to 65535."""
    return (end - start) & 0xFFFF


def is_after(sequence_nr: int, reference: int) -> bool:
    """Whether the number comes later than the reference in serial-number arithmetic."""
    return 0 < (sequence_nr - reference) & 0xFFFF < HALF


# The state of a stream, for people who watch a session.


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
