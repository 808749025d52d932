"""Comparing clocks: one request, four timestamps (XRCE 1.0 §8.3.5.15 and 16; the arithmetic of NTP, RFC 5905 §8)."""

from __future__ import annotations

from msbot.xrce.messages.message import TimestampReply
from msbot.xrce.sessions.events import TimeSynchronised

CIRCLE_NS = 2**32 * 1_000_000_000
"""Seconds are sent as 32 bits, so times come round again after 136 years (the first time in 2038)."""


def answers(reply: TimestampReply, asked_ns: int) -> bool:
    """Whether it is the reply to the request sent at that time."""
    return (asked_ns - reply.originate_ns) % CIRCLE_NS == 0


def compare_clocks(reply: TimestampReply, asked_ns: int, arrived_ns: int) -> TimeSynchronised:
    """The offset of our clock from the agent's (agent time = own time - offset), and the round-trip time.

    The result is exact if both ways take equally long; it is wrong by at most half of the round trip.
    """
    receive_ns = _nearest(reply.receive_ns, asked_ns)
    transmit_ns = _nearest(reply.transmit_ns, asked_ns)
    offset_ns = ((asked_ns + arrived_ns) - (receive_ns + transmit_ns)) // 2
    return TimeSynchronised(offset_ns, (arrived_ns - asked_ns) - (transmit_ns - receive_ns))


def _nearest(time_ns: int, reference_ns: int) -> int:
    """Of the times that look the same on the wire, the one nearest to the reference."""
    circles = (reference_ns - time_ns + CIRCLE_NS // 2) // CIRCLE_NS
    return time_ns + circles * CIRCLE_NS
