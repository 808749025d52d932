"""Comparing clocks: one request, four timestamps (XRCE 1.0 §8.3.5.15 and 16; the arithmetic of NTP, RFC 5905 §8)."""

from __future__ import annotations

from collections.abc import Callable

from msbot_xrce.messages.message import Timestamp, TimestampReply
from msbot_xrce.sessions.events import TimeSynchronised

CIRCLE_NS = 2**32 * 1_000_000_000
"""Seconds are sent as 32 bits, so times come round again after 136 years (the first time in 2038)."""


class ClockComparison:
    """Asks for the agent's time, and takes one reply to the latest question."""

    __slots__ = ("_asked_ns", "_epoch_ns")

    def __init__(self, epoch_ns: Callable[[], int]) -> None:
        """Compare that clock, nanoseconds since 1970, with the agent's."""
        self._epoch_ns = epoch_ns
        self._asked_ns: int | None = None

    def ask(self) -> Timestamp:
        """The question, to be sent at once."""
        self._asked_ns = self._epoch_ns()
        return Timestamp(self._asked_ns)

    def take(self, reply: TimestampReply) -> TimeSynchronised | None:
        """What a reply that has just come says; None: it does not answer the latest question, or that is answered."""
        asked_ns = self._asked_ns
        if asked_ns is None or not answers(reply, asked_ns):
            return None
        self._asked_ns = None
        return compare_clocks(reply, asked_ns, self._epoch_ns())


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
