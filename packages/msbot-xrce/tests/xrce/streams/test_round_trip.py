"""How long to wait before asking."""

from __future__ import annotations

import pytest

from msbot_xrce.streams.round_trip import MEMORY_S, RoundTrip


def patience(trip: RoundTrip, now: float = 0.0, unanswered: int = 0) -> float:
    return trip.patience_s(now, 0.2, 0.005, unanswered)


def test_without_a_loss_the_longest_wait_counts() -> None:
    trip = RoundTrip()
    assert patience(trip) == 0.2
    trip.measure(0.001)
    assert patience(trip, unanswered=3) == 0.2


def test_without_a_measurement_the_longest_wait_counts_whatever_was_lost() -> None:
    trip = RoundTrip()
    trip.note_loss(0.0)
    assert patience(trip) == 0.2


@pytest.mark.parametrize(
    ("took_s", "wait_s"), [(0.0001, 0.005), (0.01, 0.03), (0.05, 0.15), (0.1, 0.2), (0.15, 0.3), (9, 1.0)]
)
def test_after_a_loss_the_wait_follows_the_round_trip(took_s: float, wait_s: float) -> None:
    trip = RoundTrip()
    trip.measure(took_s)
    trip.note_loss(0.0)
    assert patience(trip) == pytest.approx(wait_s)


def test_after_two_repetitions_each_question_without_an_answer_doubles_the_wait() -> None:
    trip = RoundTrip()
    trip.measure(0.001)
    trip.note_loss(0.0)
    assert [patience(trip, unanswered=count) for count in range(10)] == [
        0.005,
        0.005,
        0.005,
        0.01,
        0.02,
        0.04,
        0.08,
        0.16,
        0.2,
        0.2,
    ]
    assert patience(trip, unanswered=10**9) == 0.2


def test_a_loss_is_forgotten() -> None:
    trip = RoundTrip()
    trip.measure(0.001)
    trip.note_loss(1.0)
    assert patience(trip, now=1.0 + MEMORY_S - 0.1) < 0.2
    assert patience(trip, now=1.0 + MEMORY_S) == 0.2


def test_measurements_are_smoothed_and_their_spread_counts() -> None:
    trip = RoundTrip()
    trip.note_loss(0.0)
    trip.measure(0.010)
    for _ in range(100):
        trip.measure(0.010)
    assert trip.smoothed_s == pytest.approx(0.010)
    assert patience(trip) == pytest.approx(0.020), "twice the round trip at least"
    trip.measure(0.030)
    assert trip.smoothed_s == pytest.approx(0.0125)
    assert patience(trip) == pytest.approx(0.0125 + 4 * 0.005)
