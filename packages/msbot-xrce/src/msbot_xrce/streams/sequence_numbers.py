"""Arithmetic on sequence numbers: 16 bits that wrap from 65535 to 0 (XRCE 1.0 §8.3.2, RFC 1982).

The state "nothing yet" is the number before the first one, 65535. Two numbers exactly 32768 apart have no order:
neither is after the other (seen on the wire: an agent refuses 0x7FFF as the first number of a best-effort stream and
takes 0x7FFE).
"""

from __future__ import annotations

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
