"""Asking again."""

from __future__ import annotations

from msbot_xrce.streams.round_trip import Retries


def is_asking(retries: Retries) -> bool:
    return retries.next_at is not None


def test_tries_are_one_period_apart_and_end_after_the_limit() -> None:
    retries = Retries(1.0, 3)
    retries.begin(10.0)
    assert (retries.count, retries.next_at) == (1, 11.0)
    assert retries.take(11.0)
    assert retries.take(12.5)
    assert (retries.count, retries.next_at) == (3, 13.5)
    assert not retries.take(13.5)
    assert not is_asking(retries)


def test_an_answer_ends_them_and_they_can_begin_anew() -> None:
    retries = Retries(0.5, None)
    retries.begin(0.0)
    for _ in range(1000):
        assert retries.take(0.5)
    retries.end()
    assert not is_asking(retries)
    retries.begin(7.0)
    assert (retries.count, retries.next_at) == (1, 7.5)
