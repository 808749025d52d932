"""Comparing clocks."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.messages.message import Timestamp, TimestampReply
from msbot_xrce.sessions.events import TimeSynchronised
from msbot_xrce.sessions.time_sync import answers, compare_clocks

SECOND = 1_000_000_000


def over_the_wire(reply: TimestampReply) -> TimestampReply:
    octets = reply.encode()
    return TimestampReply.decode(octets, 4, len(octets), octets[1])


def test_offset_and_round_trip_of_an_agent_5_s_ahead() -> None:
    asked, there, arrived = 100 * SECOND, 105 * SECOND + 2_000_000, 100 * SECOND + 5_000_000
    reply = TimestampReply(there + 1_000_000, there, asked)
    assert compare_clocks(reply, asked, arrived) == TimeSynchronised(-5 * SECOND, 4_000_000)


def test_replies_to_other_questions_are_told_apart() -> None:
    assert answers(TimestampReply(0, 0, 7), 7)
    assert not answers(TimestampReply(0, 0, 7), 8)


@given(st.integers(SECOND, 2**33 * SECOND), st.integers(-SECOND, SECOND), st.integers(0, SECOND), st.integers(0, 1000))
def test_32_bits_of_seconds_are_enough(asked: int, ahead: int, way: int, pause: int) -> None:
    octets = Timestamp(asked).encode()
    originate = Timestamp.decode(octets, 4, len(octets), octets[1]).transmit_ns
    received = asked + way + ahead
    reply = over_the_wire(TimestampReply(received + pause, received, originate))
    assert answers(reply, asked)
    assert compare_clocks(reply, asked, asked + 2 * way + pause) == TimeSynchronised(-ahead, 2 * way)
