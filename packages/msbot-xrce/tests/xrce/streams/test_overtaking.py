"""How a session sees that its network lets packets overtake each other."""

from __future__ import annotations

import pytest

from msbot_xrce.streams.receiving_in_order import ReliableInput
from msbot_xrce.streams.reordering import DELAY_MAX_S, MARGIN, MEMORY_S, ReorderingDetector
from msbot_xrce.streams.round_trip import RoundTrip
from msbot_xrce.streams.settings import Memory, SessionCounters

STREAM = 0x80


class Rig:
    """A stream of a session whose ACKNACKs are told by hand."""

    def __init__(self) -> None:
        self.stream = ReliableInput(16, Memory(1 << 20), SessionCounters())
        self.round_trip = RoundTrip()
        self.overtaking = ReorderingDetector(self.round_trip)

    def take(self, number: int, now: float) -> None:
        self.overtaking.note(STREAM, self.stream, number, now)
        if self.stream.accept(number, b"x"):
            while self.stream.next_held() is not None:
                pass

    def tell(self, now: float) -> None:
        self.stream.acknack_sent(*self.stream.missing(), now)


def test_what_comes_late_before_anything_was_reported_was_overtaken() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    assert not rig.overtaking.is_seen(1.0)
    rig.take(0, 1.02)
    assert rig.overtaking.is_seen(1.02)
    assert rig.overtaking.delay_s == pytest.approx(0.02 * MARGIN)
    assert not rig.overtaking.is_seen(1.03 + MEMORY_S)


def test_what_comes_once_for_a_report_was_lost_and_what_comes_twice_was_overtaken() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    rig.tell(1.0)
    rig.take(0, 1.005)
    rig.tell(1.005)
    assert not rig.overtaking.is_seen(1.005)
    rig.take(0, 1.02)
    assert rig.overtaking.delay_s == pytest.approx(0.02 * MARGIN)


def test_reports_of_what_comes_later_do_not_count() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    rig.tell(1.0)
    rig.take(0, 1.001)
    for _ in range(10):
        rig.stream.acknack_sent(2, 1, 1.002)  # asks for message 2
    rig.take(0, 1.02)
    assert rig.overtaking.is_seen(1.02)


def test_what_comes_for_a_report_that_was_under_way_when_it_was_lost_was_not_overtaken() -> None:
    rig = Rig()
    rig.round_trip.learn(0.0025)
    rig.take(1, 1.0)
    rig.tell(1.0)  # about 0; the client sends 2, which is lost, and 3 before it has this
    rig.take(3, 1.002)
    for number in (0, 1, 2, 3):
        rig.take(number, 1.005)
    assert not rig.overtaking.is_seen(1.005)
    rig.tell(1.005)
    rig.take(5, 1.1)  # long after the latest report
    rig.take(4, 1.11)
    assert rig.overtaking.is_seen(1.11)


def test_what_comes_in_the_same_burst_needs_no_time_between_acknowledgements() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    rig.take(0, 1.0)
    assert not rig.overtaking.is_seen(1.0)


def test_the_delay_is_bounded_and_the_longest_counts() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    rig.take(0, 1.05)
    rig.take(3, 2.0)
    rig.take(2, 2.01)
    assert rig.overtaking.delay_s == pytest.approx(0.05 * MARGIN)
    rig.take(5, 3.0)
    rig.take(4, 9.0)
    assert rig.overtaking.delay_s == DELAY_MAX_S


def test_a_missing_message_is_only_late_for_that_time() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    rig.take(0, 1.02)
    rig.take(3, 2.0)
    unripe, ripe_at = rig.overtaking.unripe(STREAM, rig.stream, 2.01)
    assert unripe == {2}
    assert ripe_at == pytest.approx(2.03)
    assert rig.overtaking.unripe(STREAM, rig.stream, 2.04) == (frozenset(), None)


def test_what_a_heartbeat_announces_is_watched_and_a_leap_is_not() -> None:
    rig = Rig()
    rig.overtaking.announced(STREAM, rig.stream, 0, 1.0)
    rig.take(0, 1.01)
    assert rig.overtaking.is_seen(1.01)
    rig.overtaking.announced(STREAM, rig.stream, 30_000, 2.0)
    assert rig.overtaking.unripe(STREAM, rig.stream, 2.0)[0] == frozenset()
