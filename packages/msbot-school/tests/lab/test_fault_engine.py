"""When faults begin and end, which conditions there are, and which faults contradict each other. Without a robot."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_school.faults.fault_engine import FOR_S, MOST, PATIENCE_S, FaultEngine, FaultSpec
from msbot_school.faults.fault_kinds import KINDS, NumberCondition, StateCondition, contradiction, read_condition
from msbot_xrce.errors import ConfigError


class World:
    def __init__(self, states: Mapping[str, str] = {}, numbers: Mapping[str, float] = {}) -> None:
        self.states, self.numbers = dict(states), dict(numbers)

    def is_in_state(self, slot: str, state: str) -> bool:
        return self.states.get(slot, "empty") == state

    def number(self, source: str) -> float | None:
        return self.numbers.get(source)


def spec(kind: str = "loss", at: str = "fan", **more: object) -> FaultSpec:
    return FaultSpec(KINDS[kind], at, **more)  # type: ignore[arg-type]


def run(engine: FaultEngine, until: float, world: World | None = None) -> list[tuple[float, int, str]]:
    """What happens, with the engine's own times."""
    seen, world = [], world or World()
    now = 0.0
    while (at := engine.timer()) is not None and at <= until:
        now = max(now, at)
        for change in engine.handle_timer(now, lambda condition: condition.holds(world)):
            seen.append((round(now, 3), change.fault.number, "begins" if change.begins else str(change.reason)))
    return seen


def test_a_fault_is_there_for_its_time_and_ends_by_itself() -> None:
    engine = FaultEngine()
    engine.plant(spec(), "Ada", 0.0)
    engine.plant(spec(at="knob", after_s=5.0, for_s=2.0), "Ada", 0.0)
    assert run(engine, 100.0) == [
        (0.0, 1, "begins"),
        (5.0, 2, "begins"),
        (7.0, 2, "its time is over"),
        (FOR_S, 1, "its time is over"),
    ]
    assert engine.timer() is None


def test_a_condition_is_waited_for_and_not_for_ever() -> None:
    engine, world = FaultEngine(), World({"fan": "active"})
    engine.plant(spec(when=read_condition("fan is late"), after_s=3.0), "Ada", 0.0)
    assert run(engine, 10.0, world) == []
    world.states["fan"] = "late"
    ((at, number, what),) = run(engine, 11.0, world)
    assert (number, what) == (1, "begins")
    assert 10.0 <= at <= 10.5
    forgotten = FaultEngine()
    forgotten.plant(spec(when=read_condition("fan is lost")), "Ada", 0.0)
    assert run(forgotten, PATIENCE_S + 1.0, world)[-1][2] == "it never came to it"


@given(chance=st.floats(0.05, 0.5), seed=st.integers(0, 10_000))
def test_chance_is_the_same_for_the_same_seed(chance: float, seed: int) -> None:
    def begins() -> list[tuple[float, int, str]]:
        engine = FaultEngine()
        engine.plant(spec(chance=chance, seed=seed, for_s=1.0), "Ada", 0.0)
        return run(engine, 600.0)

    first = begins()
    assert first == begins()
    assert [what for _, _, what in first] == ["begins", "its time is over"]


def test_chance_is_about_what_was_asked_for() -> None:
    waited = []
    for seed in range(300):
        engine = FaultEngine()
        engine.plant(spec(chance=0.1, seed=seed), "Ada", 0.0)
        waited.append(run(engine, 500.0)[0][0])
    assert 7 < sum(waited) / len(waited) < 11  # nine seconds of no luck on average


def test_clearing() -> None:
    engine = FaultEngine()
    engine.plant(spec(), "Ada", 0.0)
    engine.plant(spec(at="knob", after_s=50.0), "Ada", 0.0)
    run(engine, 1.0)
    with pytest.raises(ConfigError, match="there is no fault 7; there are 1, 2"):
        engine.clear(7, "enough")
    assert [(change.fault.number, change.was_active) for change in engine.clear(None, "enough")] == [
        (1, True),
        (2, False),
    ]
    assert engine.timer() is None
    assert engine.clear(None, "enough") == []


def test_there_are_not_too_many() -> None:
    engine = FaultEngine()
    for number in range(MOST):
        engine.plant(spec(at=f"slot{number}"), "Ada", 0.0)
    with pytest.raises(ConfigError, match="which is the most"):
        engine.plant(spec(at="one more"), "Ada", 0.0)


CONTRADICT = (
    ("unplug", "fan", "loss", "fan", "cut off"), ("wrong-number", "fan", "unplug", "fan", "cut off"),
    ("late", "fan", "delay", "fan", "the same thing"), ("stuck", "knob", "drift", "knob", "the same thing"),
    ("loss", "fan", "loss", "fan", "twice"), ("master-frozen", "", "loss", "fan", "frozen"),
    ("babbling", "", "babbling", "", "twice"), ("bus-off", "fan", "slow-consumer", "fan", "cut off"),
)  # fmt: skip
AGREE = (
    ("unplug", "fan", "loss", "knob"), ("loss", "fan", "delay", "fan"), ("bit-errors", "", "babbling", ""),
    ("master-frozen", "", "database-gone", ""), ("stuck", "knob", "loss", "knob"),
    ("master-frozen", "", "unplug", "fan"),
)  # fmt: skip


@pytest.mark.parametrize(("one", "one_at", "other", "other_at", "words"), CONTRADICT)
def test_what_contradicts_is_refused_with_a_sentence(
    one: str, one_at: str, other: str, other_at: str, words: str
) -> None:
    for first, second in (((one, one_at), (other, other_at)), ((other, other_at), (one, one_at))):
        engine = FaultEngine()
        engine.plant(spec(*first), "Ada", 0.0)
        with pytest.raises(ConfigError, match=f"{second[0]} contradicts fault 1 .*{words}.*msbot fault clear 1"):
            engine.plant(spec(*second), "Ada", 0.0)
        engine.plant(spec(*second, after_s=FOR_S), "Ada", 0.0)  # one after the other


@pytest.mark.parametrize(("one", "one_at", "other", "other_at"), AGREE)
def test_what_does_not_contradict_is_planted_together(one: str, one_at: str, other: str, other_at: str) -> None:
    engine = FaultEngine()
    engine.plant(spec(one, one_at), "Ada", 0.0)
    engine.plant(spec(other, other_at), "Ada", 0.0)
    assert len(engine.faults) == 2


@given(st.sampled_from(sorted(KINDS)), st.sampled_from(sorted(KINDS)), st.booleans())
def test_contradicting_is_mutual(one: str, other: str, same: bool) -> None:
    places = [("fan" if KINDS[one].at_part else ""), ("fan" if same else "knob") if KINDS[other].at_part else ""]
    there = contradiction(KINDS[one], places[0], KINDS[other], places[1])
    back = contradiction(KINDS[other], places[1], KINDS[one], places[0])
    assert bool(there) == bool(back)


def test_what_may_come_at_any_time_contradicts_at_once() -> None:
    engine = FaultEngine()
    engine.plant(spec("unplug", when=read_condition("knob is lost")), "Ada", 0.0)
    with pytest.raises(ConfigError, match="cut off"):
        engine.plant(spec("loss", after_s=3000.0), "Ada", 0.0)


def test_conditions() -> None:
    assert read_condition("fan is active") == StateCondition("fan", "active")
    assert read_condition("knob.level.percent>=60") == NumberCondition("knob.level.percent", ">=", 60.0)
    world = World({"fan": "late"}, {"load": 50.0})
    for text, wanted in {
        "fan is late": True,
        "fan is active": False,
        "knob is empty": True,
        "load > 49": True,
        "load < 50": False,
        "load = 50": True,
        "load <= 50": True,
        "knob.level > 1": False,
    }.items():
        assert read_condition(text).holds(world) is wanted, text


@pytest.mark.parametrize(
    "text", ["", "fan", "fan is", "level > 3", "knob.level > much", "knob.level > nan", "fan was late"]
)
def test_conditions_with_mistakes(text: str) -> None:
    with pytest.raises(ConfigError, match="cannot be read; write for example"):
        read_condition(text)


def test_a_state_that_there_is_not() -> None:
    with pytest.raises(ConfigError, match="there is no state 'happy'; there are empty, new"):
        read_condition("fan is happy")
