"""A steady rate with pauses made up for, for each of many."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.pace import MOST_CALLERS, SteadyRate, TokenBucket
from msbot_web.access.sessions import MOST_SESSIONS


@given(st.lists(st.tuples(st.floats(0.0, 3.0), st.sampled_from("ab")), max_size=60))
def test_nobody_makes_more_calls_than_allowed_in_any_time_and_who_waits_is_let_in(
    calls: list[tuple[float, str]],
) -> None:
    pace, now = SteadyRate(2.0, 5.0), 0.0
    made: dict[str, list[float]] = {"a": [], "b": []}
    for pause_s, caller in calls:
        now += pause_s
        wait_s = pace.wait_s(caller, now)
        if wait_s == 0.0:
            pace.note(caller, now)
            made[caller].append(now)
            continue
        assert not _fits([*made[caller], now], 2.0, 5.0), "it would have been one too many"
        assert pace.wait_s(caller, now + wait_s) == pytest.approx(0.0, abs=1e-9)
    assert all(_fits(times, 2.0, 5.0) for times in made.values())


def _fits(times: list[float], per_s: float, burst: float) -> bool:
    """Whether in no stretch of time there are more than `burst` calls and those that were made up for in it."""
    return all(
        last - first + 1 <= burst + (times[last] - times[first]) * per_s + 1e-6
        for first in range(len(times))
        for last in range(first, len(times))
    )


@given(st.floats(0.1, 1000.0), st.integers(1, 200))
def test_who_keeps_to_the_rate_never_waits(per_s: float, calls: int) -> None:
    pace = SteadyRate(per_s, 1.0)
    for number in range(calls):
        assert pace.wait_s("a", number / per_s) == pytest.approx(0.0, abs=1e-6)
        pace.note("a", number / per_s)


def test_the_callers_that_are_remembered_are_bounded_and_the_latest_are_kept() -> None:
    pace = SteadyRate(1.0, 1.0, most=3)
    for caller in "abcad":
        pace.note(caller, 0.0)
    assert [pace.wait_s(caller, 0.0) for caller in "abcd"] == [2.0, 0.0, 1.0, 1.0]
    assert MOST_CALLERS >= MOST_SESSIONS


def test_something_may_count_as_many_calls() -> None:
    pace = SteadyRate(2.0, 3.0)
    pace.note("a", 0.0, 10.0)
    assert pace.wait_s("a", 0.0) == 4.0
    assert pace.wait_s("a", 4.0) == 0.0


def test_a_bucket_may_begin_empty_and_keeps_what_was_saved_when_its_rate_changes() -> None:
    bucket = TokenBucket(10.0, 2.0, 0.0, is_full=False)
    assert not bucket.take(0.0)
    assert bucket.take(0.25)  # 2 were saved, the most that it holds
    bucket.change(100.0, 20.0)
    assert [bucket.take(0.35) for _ in range(12)] == [True] * 11 + [False]
    assert bucket.missing(0.35) == pytest.approx(1.0)
    bucket.change(1.0, 1.0)
    bucket.spend(0.35, 5.0)
    assert bucket.missing(0.35) == pytest.approx(6.0)
    assert not bucket.take(6.3)
    assert bucket.take(6.4)
