"""READ_DATA: how many samples, for how long, how fast."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.agent.topic_attachment import NEVER, ReadTask
from msbot_xrce.messages import DeliveryControl
from tests.effort import tries


def control(samples: int = 0xFFFF, elapsed_s: int = 0, rate: int = 0, pace_ms: int = 0) -> DeliveryControl:
    return DeliveryControl(samples, elapsed_s, rate, pace_ms)


def deliver_all(task: ReadTask, sizes: list[int], now: float) -> list[float]:
    """The times at which samples that wait from the beginning go, until the task lets none go any more."""
    times = []
    for size in sizes:
        for _ in range(5):
            ready_at = task.ready_at(size, now)
            if ready_at <= now or ready_at == NEVER:
                break
            now = ready_at
        if ready_at == NEVER:
            break
        assert ready_at <= now, "the promised time must hold"
        task.sent(size, now)
        times.append(now)
    return times


def test_no_control_means_exactly_one_sample() -> None:
    task = ReadTask(1, 0x80, None, 0.0)
    assert task.limited
    assert deliver_all(task, [4, 4, 4], 0.0) == [0.0]
    assert task.finished


def test_unlimited_read_has_no_limits_to_look_at() -> None:
    task = ReadTask(1, 0x80, control(), 0.0)
    assert not task.limited
    assert deliver_all(task, [10_000] * 100, 5.0) == [5.0] * 100


def test_max_samples_ends_the_read() -> None:
    assert deliver_all(ReadTask(1, 1, control(samples=3), 0.0), [1] * 9, 0.0) == [0.0, 0.0, 0.0]


def test_no_samples_is_a_read_that_is_finished_before_it_begins() -> None:
    assert ReadTask(1, 0, control(samples=0), 0.0).finished


def test_elapsed_time_ends_the_read() -> None:
    task = ReadTask(1, 1, control(elapsed_s=2), 10.0)
    assert task.ready_at(4, 11.9) == 11.9
    assert task.ready_at(4, 12.0) == NEVER


def test_pace_keeps_a_distance_between_samples() -> None:
    times = deliver_all(ReadTask(1, 1, control(pace_ms=250), 0.0), [4] * 4, 1.0)
    assert times == [1.0, 1.25, 1.5, 1.75]


def test_pace_that_reaches_beyond_the_elapsed_time_ends_the_read() -> None:
    assert deliver_all(ReadTask(1, 1, control(elapsed_s=1, pace_ms=600), 0.0), [4] * 9, 0.0) == [0.0, 0.6]


def test_byte_rate_is_kept_after_one_seconds_worth() -> None:
    times = deliver_all(ReadTask(1, 1, control(rate=1000), 0.0), [500] * 6, 0.0)
    assert times == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.5, 2.0])


def test_a_sample_larger_than_the_rate_goes_and_delays_the_next() -> None:
    times = deliver_all(ReadTask(1, 1, control(rate=100), 0.0), [300, 50], 0.0)
    assert times == pytest.approx([0.0, 2.5])


@settings(deadline=None, max_examples=tries(100, 2000))
@given(
    st.integers(1, 5000), st.lists(st.integers(0, 3000), min_size=1, max_size=60), st.sampled_from([0.0, 1e6, 123.456])
)
def test_no_second_carries_more_than_the_rate_and_one_burst(rate: int, sizes: list[int], start: float) -> None:
    times = deliver_all(ReadTask(1, 1, control(rate=rate), start), sizes, start)
    assert len(times) == len(sizes), "nothing gets stuck"
    for first, begin in enumerate(times):
        within = sum(size for size, at in zip(sizes[first:], times[first:], strict=True) if at < begin + 1.0)
        assert within <= 2 * rate + max(sizes) + 1
