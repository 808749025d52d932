"""Load over the last second."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.load_meter import LoadMeter


def test_load_is_that_of_the_last_second() -> None:
    meter = LoadMeter()
    assert meter.load(5.0) == 0
    meter.add(0.0, 0.25)
    meter.add(0.5, 0.75)
    assert meter.load(1.0) == pytest.approx(0.5)
    assert meter.load(1.1) == pytest.approx(0.4)
    assert meter.load(1.5) == pytest.approx(0.25)
    assert meter.load(3.0) == 0


def test_a_span_that_is_not_over_counts_as_far_as_it_is() -> None:
    meter = LoadMeter()
    meter.add(0.0, 0.3)
    assert meter.load(0.2) == pytest.approx(0.2)
    assert meter.load(1.0, since=0.9) == pytest.approx(0.4)
    assert meter.load(1.0, since=1.2) == pytest.approx(0.3)
    assert meter.load(5.0, since=1.2) == 1.0


def test_only_the_last_second_is_kept() -> None:
    meter = LoadMeter()
    for number in range(1000):
        meter.add(number / 100, number / 100 + 0.005)
    assert len(meter._spans) <= 101
    assert meter.load(10.0) == pytest.approx(0.5)


@given(st.lists(st.tuples(st.floats(0, 0.5), st.floats(0.001, 0.5)), min_size=1, max_size=30), st.floats(0, 1))
def test_load_is_the_plain_overlap(spans: list[tuple[float, float]], later: float) -> None:
    meter, kept, now = LoadMeter(), [], 0.0
    for pause, length in spans:
        start, now = now + pause, now + pause + length
        meter.add(start, now)
        kept.append((start, now))
    now += later
    plain = sum(max(0.0, end - max(start, now - 1)) for start, end in kept)
    assert meter.load(now) == pytest.approx(min(1.0, plain), abs=1e-9)
