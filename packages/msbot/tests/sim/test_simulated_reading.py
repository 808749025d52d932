"""How a reading follows its source, step by step."""

from __future__ import annotations

import math
from random import Random
from statistics import mean, stdev

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.config import Reading, Scalar
from msbot.sim.simulated_reading import SimulatedReading, as_number, number


class Follower:
    """A gauge and its sources."""

    def __init__(self, reading: Reading, **values: Scalar) -> None:
        self.gauge = SimulatedReading(reading, Random(1))
        self.values: dict[str, Scalar] = {"source": 0.0, **values}
        self.now = 0.0
        self.came_at: float | None = None

    def after(self, step_s: float, source: Scalar | None = None, *, final: bool = True) -> Scalar:
        """The reading after some time, with the source at that value."""
        self.now += step_s
        if source is not None:
            self.values["source"] = source
            self.came_at = self.now
        return self.gauge.update(self.values, self.now, step_s, self.came_at, final=final)


def follower(**steps: object) -> Follower:
    return Follower(Reading("r", follows="source", **steps))  # type: ignore[arg-type]  # a test's shorthand


STEPS: list[tuple[dict[str, object], Scalar, Scalar]] = [
    ({}, 4.2, 4.2),
    ({}, True, True),
    ({}, "text", "text"),
    ({"scale": 2.0, "offset": 1.0}, 3.0, 7.0),
    ({"scale": 2.0}, True, 2.0),
    ({"scale": 2.0}, "4", 8.0),
    ({"divide_by": 4.0, "offset": 2.0}, 2.0, 1.0),
    ({"divide_by": 0.0}, 2.0, 2.0),
    ({"least": 0.0, "most": 5.0}, 9.0, 5.0),
    ({"least": 0.0, "most": 5.0}, -9.0, 0.0),
    ({"wrap": 360.0}, 725.0, 5.0),
    ({"wrap": 360.0}, -5.0, 355.0),
    ({"step": 0.5}, 1.3, 1.5),
    ({"step": 0.1}, 0.30000000000000004, 0.3),
    ({"step": 1e-320}, 5.0, 5.0),
    ({"scale": 1e300}, 1e300, 0.0),  # too large for a number: the last one that made sense
    ({"above": 2.0}, 2.0, False),
    ({"above": 2.0}, 2.1, True),
    ({"equals": 3.0}, 3.0, True),
    ({"equals": "on"}, "on", True),
    ({"equals": False}, True, False),
    ({"function": "sin"}, 30.0, 0.5),
    ({"function": "cos", "scale": 10.0}, 60.0, 5.0),
    ({"pattern": "turn-on ([0-7])"}, "Publisher A(1) turn-on 3", "3"),
    ({"pattern": "turn-on ([0-7])", "equals": 3}, "Publisher A(1) turn-on 3", True),
    ({"pattern": "turn-on ([0-7])", "scale": 2.0}, "Publisher A(1) turn-on 3", 6.0),
    ({"pattern": "([0-7])", "equals": 0}, "none", False),
    ({"rows": 2, "columns": 4}, "first line\nsecond\nthird", "firs\nseco"),
    ({"rows": 1}, "one\ntwo", "one"),
    ({"columns": 2}, "one\ntwo", "on\ntw"),
]


@pytest.mark.parametrize(("steps", "source", "value"), STEPS)
def test_one_step(steps: dict[str, object], source: Scalar, value: Scalar) -> None:
    found = follower(**steps).after(1.0, source)
    assert found == (pytest.approx(value) if isinstance(value, float) else value)
    assert type(found) is type(value)


def test_a_text_without_the_pattern_changes_nothing() -> None:
    reader = follower(pattern="([0-7])$", start="none")
    assert reader.after(1.0, "hello") == "none"
    assert reader.after(1.0, "on 5") == "5"
    assert reader.after(1.0, "hello") == "5"


def test_slew_limits_the_change_in_a_second() -> None:
    arm = follower(slew_per_s=10.0, start=90.0)
    assert arm.after(0.0) == 90
    assert arm.after(1.0, 0.0) == 80
    assert arm.after(0.5) == 75
    assert arm.after(100.0) == 0
    assert arm.after(1.0, 4.0) == 4


def test_lag_comes_within_a_third_in_its_time_constant() -> None:
    air = follower(lag_s=2.0)
    assert air.after(0.0, 10.0) == 10  # the first value holds at once
    assert air.after(2.0, 20.0) == pytest.approx(20 - 10 / math.e)
    assert air.after(100.0) == pytest.approx(20)


def test_integration_sums_over_time() -> None:
    wheel = follower(integrate=True, scale=2.0, step=1.0)
    assert wheel.after(1.0, 3.0) == 6
    assert wheel.after(0.4) == 8
    assert wheel.after(0.1) == 9  # it was 8.4, shown as 8
    assert wheel.after(2.0, -3.0) == -3


def test_what_lasts_runs_out() -> None:
    tone = Follower(Reading("r", follows="port.hertz", lasts="port.seconds", start=0.0))
    tone.values |= {"port.hertz": 440.0, "port.seconds": 2.0}
    assert tone.after(1.0) == 0  # no message has come
    tone.came_at = tone.now
    assert tone.after(1.9) == 440
    assert tone.after(0.1) == 0
    tone.values["port.seconds"] = 0.0
    assert tone.after(50.0) == 440


def test_nothing_has_come_at_first_and_then_start_holds() -> None:
    arm = Follower(Reading("r", follows="port.degrees", start=90.0))
    arm.values["port.degrees"] = 0.0
    assert arm.after(1.0) == 90
    arm.came_at = arm.now
    assert arm.after(1.0) == 0


def test_numbers_may_come_from_other_sources() -> None:
    reader = Follower(Reading("r", follows="source", negate="flip", most="limit"), flip=True, limit=5.0)
    assert reader.after(1.0, 3.0) == -3
    reader.values["flip"] = False
    assert reader.after(1.0, 9.0) == 5


def test_noise_is_on_the_final_step_only_and_stays_within_the_limits() -> None:
    meter = follower(noise=2.0, most=60.0)
    assert meter.after(1.0, 50.0, final=False) == 50
    values = [as_number(meter.after(0.1)) for _ in range(500)]
    assert abs(mean(values) - 50) < 0.5
    assert 1.7 < stdev(values) < 2.3
    meter.after(0.1, 60.0)
    assert max(as_number(meter.after(0.1)) for _ in range(50)) == 60


def test_a_drawn_value_holds_for_its_period() -> None:
    dice = Follower(Reading("r", random_every=1.0, least=1.0, most=6.0, step=1.0))
    drawn = []
    for _ in range(200):
        first = dice.after(0.5)
        assert dice.after(0.4) == first
        drawn.append(first)
        dice.now += 0.2
    assert set(drawn) == {1, 2, 3, 4, 5, 6}
    halves = Follower(Reading("r", random_every=0.0, least=0.5, most=2.0, step=0.5))
    assert {halves.after(1.0) for _ in range(200)} == {0.5, 1.0, 1.5, 2.0}
    free = Follower(Reading("r", random_every=0.0, least=1.0, most=2.0))
    assert all(1 <= as_number(free.after(1.0)) <= 2 for _ in range(20))


def test_a_text_is_made_of_sources() -> None:
    assert Follower(Reading("r", text="{source:.1f} lx")).after(1.0, 2.0) == "2.0 lx"


@pytest.mark.parametrize(
    ("value", "result"), [(True, 1.0), ("1.5", 1.5), ("x", 0.0), (math.inf, 0.0), ("nan", 0.0), (3, 3.0)]
)
def test_everything_is_some_number(value: Scalar, result: float) -> None:
    assert as_number(value) == result
    assert number("v", {"v": value}) == result


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 5), st.floats(-1e6, 1e6)), max_size=20),
    st.floats(0, 10),
    st.floats(0, 100),
    st.booleans(),
)
def test_whatever_comes_a_limited_reading_stays_finite_and_in_its_limits(
    course: list[tuple[float, float]], lag_s: float, slew: float, integrate: bool
) -> None:
    reader = follower(lag_s=lag_s, slew_per_s=slew, integrate=integrate, least=-5.0, most=5.0, noise=1.0, start=0.0)
    for step_s, value in course:
        assert -5 <= as_number(reader.after(step_s, value)) <= 5
