"""The world behind a simulated part: time, settings, messages, and what is said when."""

from __future__ import annotations

from random import Random

import pytest

from msbot.config import (
    Control,
    ControlKind,
    Direction,
    FieldKind,
    MessageType,
    Output,
    Parameter,
    ParameterKind,
    PartType,
    Port,
    Reading,
    Scalar,
    Simulator,
    standard_message_types,
)
from msbot.sim.part_model import MOST_STEPS, MOST_WAITING, STEP_S, PartModel, fit

TYPES = standard_message_types()
LONGEST_S = MOST_STEPS * STEP_S
LEVEL, SWITCH, HELLO = TYPES["Level"], TYPES["Switch"], TYPES["HelloWorld"]
KNOB = Control("knob", ControlKind.NUMBER, 10.0)
PRESS = Control("press", ControlKind.BOOL, False)
OUT = Port("out", Direction.PUBLISH, "Level", message=LEVEL)
IN = Port("in", Direction.SUBSCRIBE, "Level", safe={"percent": 5.0}, message=LEVEL)


def world(*outputs: Output, ports: tuple[Port, ...] = (OUT, IN), readings: tuple[Reading, ...] = ()) -> PartModel:
    parameters = (Parameter("period_s", ParameterKind.FLOAT, 1.0),)
    simulator = Simulator((KNOB, PRESS), readings, outputs)
    return PartModel(PartType("X", "x", ports=ports, parameters=parameters, simulator=simulator), Random(1))


def said(found: PartModel, now: float) -> list[Scalar]:
    """The one field of everything that is said at that moment."""
    found.advance(now)
    return [next(iter(fields.values())) for _, fields in found.due_messages(now)]


def test_a_period_is_kept_without_drift_and_missed_ones_are_not_made_up_for() -> None:
    found = world(Output("out", {"percent": "knob"}, every=1.0))
    found.join(10.0)
    times = [now for tick in range(0, 41) if said(found, now := 10.0 + tick * 0.15)]
    assert times == pytest.approx([10.0, 11.05, 12.1, 13.0, 14.05, 15.1, 16.0])
    assert said(found, 30.0) == [10.0]
    assert said(found, 30.1) == []


def test_a_period_that_was_shortened_holds_at_once() -> None:
    found = world(Output("out", {"percent": "knob"}, every="period_s"))
    found.set("period_s", 60.0, 0.0)
    found.join(0.0)
    assert said(found, 0.0) == [10.0]
    assert said(found, 5.0) == []
    found.set("period_s", 0.5, 5.0)
    assert said(found, 5.0) == []
    assert said(found, 5.5) == [10.0]


def test_a_change_is_said_once_and_even_when_it_is_over_again() -> None:
    found = world(
        Output("out", {"on": "press"}, on_change=True),
        ports=(Port("out", Direction.PUBLISH, "Switch", message=SWITCH),),
    )
    found.join(0.0)
    assert said(found, 0.0) == [False]
    assert said(found, 1.0) == []
    for value in (True, False):
        found.set("press", value, 1.1)
        found.note_changes()
    assert said(found, 2.0) == [True, False]


def test_too_many_changes_drop_the_oldest_and_are_counted() -> None:
    found = world(Output("out", {"percent": "knob"}, on_change=True))
    found.join(0.0)
    for value in range(MOST_WAITING + 3):
        found.set("knob", float(value), 0.0)
        found.note_changes()
    assert found.forgotten == 3
    assert said(found, 0.0) == [float(value) for value in range(3, MOST_WAITING + 3)]


def test_small_changes_are_no_news() -> None:
    found = world(Output("out", {"percent": "knob"}, on_change=True, change=2.0))
    found.join(0.0)
    assert said(found, 0.0) == [10.0]
    found.set("knob", 11.9, 0.0)
    assert said(found, 1.0) == []
    found.set("knob", 12.0, 1.0)
    assert said(found, 2.0) == [12.0]


def test_nothing_is_said_while_the_condition_is_false() -> None:
    found = world(Output("out", {"percent": "knob"}, every=1.0, on_change=True, only_if="press"))
    found.join(0.0)
    assert said(found, 0.0) == []
    found.set("press", True, 0.5)
    assert said(found, 1.0) == [10.0]


def test_messages_change_what_follows_them_and_are_counted() -> None:
    readings = (Reading("power", follows="in.percent"), Reading("count", follows="#in"))
    found = world(readings=readings)
    assert found.readings() == {"power": 5.0, "count": 0}
    found.receive("in", {"percent": 80.0}, 1.0)
    assert found.readings() == {"power": 80.0, "count": 1}
    found.receive("in", {"percent": 5.0}, 2.0, counts=False)
    assert found.readings() == {"power": 5.0, "count": 1}


def test_the_number_of_a_message_counts_from_one_and_texts_have_sources_in_them() -> None:
    output = Output("out", {"index": "#out", "message": "knob {knob:.1f}"}, every=1.0)
    found = world(output, ports=(Port("out", Direction.PUBLISH, "HelloWorld", message=HELLO),))
    found.join(0.0)
    heard = []
    for now in (0.0, 1.0):
        found.advance(now)
        heard += found.due_messages(now)
    assert heard == [
        ("out", {"index": 1, "message": "knob 10.0"}),
        ("out", {"index": 2, "message": "knob 10.0"}),
    ]


def test_a_chain_of_things_that_move_is_computed_in_small_steps() -> None:
    readings = (
        Reading("speed", follows="knob", slew_per_s=10.0, start=0.0),
        Reading("way", follows="speed", integrate=True),
        Reading("hidden", follows="way", shown=False),
    )
    found = world(readings=readings)
    found.start_at(100.0)
    found.set("knob", 20.0, 100.0)
    found.advance(103.0)
    speed, way = found.readings().values()
    assert speed == pytest.approx(20.0)
    assert way == pytest.approx(20 * 2 / 2 + 20 * 1, abs=0.5)  # two seconds to full speed, one at it
    assert "hidden" not in found.readings()


def test_the_clock_never_goes_back() -> None:
    found = world(readings=(Reading("way", follows="knob", integrate=True),))
    found.advance(5.0)
    found.advance(6.0)
    found.advance(4.0)
    assert found.readings()["way"] == pytest.approx(10.0)


FITTING: list[tuple[FieldKind, Scalar, Scalar]] = [
    (FieldKind.BOOL, 2.0, True),
    (FieldKind.UINT8, 300.0, 255),
    (FieldKind.UINT8, -1, 0),
    (FieldKind.INT32, 2.6, 3),
    (FieldKind.FLOAT32, True, 1.0),
    (FieldKind.TEXT, 3.0, "3"),
    (FieldKind.TEXT, True, "true"),
    (FieldKind.INT8, "x", 0),
    (FieldKind.FLOAT32, 1e300, 3.4028234663852886e38),
    (FieldKind.FLOAT64, 1e300, 1e300),
    (FieldKind.TEXT, "a\0b\ud800", "ab?"),
]


@pytest.mark.parametrize(("kind", "value", "result"), FITTING)
def test_a_value_is_made_to_fit_its_field(kind: FieldKind, value: Scalar, result: Scalar) -> None:
    assert fit(kind, value) == result
    assert kind.fault(fit(kind, value)) is None


def test_a_part_without_a_simulator_is_a_quiet_world() -> None:
    port = Port("in", Direction.SUBSCRIBE, "Own", message=MessageType("Own", {"a": FieldKind.INT8}))
    found = PartModel(PartType("X", "x", ports=(port,)), Random(1))
    found.receive("in", {"a": 1}, 0.0)
    found.advance(1.0)
    assert found.readings() == {}
    assert found.due_messages(1.0) == []


def test_a_noise_that_is_too_small_to_be_said_lets_the_part_rest() -> None:
    measured = Reading("measured", follows="knob", noise=0.05, step=0.1)
    for change, is_quiet in ((0.5, True), (0.3, False)):
        found = world(
            Output("out", {"percent": "measured"}, every=1.0, on_change=True, change=change), readings=(measured,)
        )
        found.join(0.0)
        assert len(said(found, 0.0)) == 1
        assert found.quiet_until(0.0) == (1.0 if is_quiet else 0.0)
    found.set("knob", 50.0, 0.5)
    assert len(said(found, 0.5)) == 1, "a change is said at once"


def test_what_an_output_does_not_depend_on_keeps_no_part_awake() -> None:
    heard = Reading("heard", follows="knob", noise=5.0, lag_s=1.0)
    loud = Reading("loud", follows="knob", above=50.0)
    found = world(
        Output("loud", {"on": "loud"}, on_change=True),
        ports=(Port("loud", Direction.PUBLISH, "Switch", message=SWITCH), IN),
        readings=(heard, loud),
    )
    found.join(0.0)
    assert said(found, 0.0) == [False]
    assert found.quiet_until(0.0) == float("inf") or found.quiet_until(0.0) > 1.0
    found.set("knob", 80.0, 1.0)
    assert said(found, 1.0) == [True]


@pytest.mark.parametrize(
    ("behind", "rest_s"),
    [((), float("inf")), ((Reading("behind", follows="opening", lag_s=1.0),), LONGEST_S)],
)
def test_what_moves_keeps_its_part_awake_until_it_is_there(behind: tuple[Reading, ...], rest_s: float) -> None:
    opening = Reading("opening", follows="in.percent", start=0.0, slew_per_s=10.0)
    far = Reading("far", follows="opening", above=4.5)
    found = world(
        Output("far", {"on": "far"}, on_change=True),
        ports=(Port("far", Direction.PUBLISH, "Switch", message=SWITCH), IN),
        readings=(opening, far, *behind),
    )
    found.join(0.0)
    assert said(found, 0.0) == [False]
    assert found.receive("in", {"percent": 5.0}, 0.0)
    assert said(found, 0.25) == []
    assert found.quiet_until(0.25) == 0.25
    assert found.quiet_until(0.25, lambda port: port != "far") == 0.25 + rest_s, "nobody hears the port"
    assert said(found, 0.5) == [True]
    assert found.quiet_until(0.5) == 0.5 + rest_s


MOVING = {
    "a lag": (Reading("m", follows="in.percent", start=0.0, lag_s=0.7),),
    "a slew": (Reading("m", follows="in.percent", start=0.0, slew_per_s=3.0),),
    "a slew that measures with noise": (Reading("m", follows="in.percent", start=0.0, slew_per_s=3.0, noise=1e-9),),
    "an integral": (Reading("m", follows="in.percent", integrate=True, least=-50.0, most=12.5),),
    "an angle": (Reading("m", follows="in.percent", integrate=True, wrap=7.0),),
    "a lag and a slew": (Reading("m", follows="in.percent", start=0.0, lag_s=0.7, slew_per_s=6.0),),
    "a lag after a slew": (
        Reading("s", follows="in.percent", start=0.0, slew_per_s=3.0),
        Reading("x2", follows="s", scale=2.0),
        Reading("m", follows="x2", lag_s=0.7),
    ),
    "an integral that ends": (Reading("m", follows="in.percent", start=0.0, lasts=0.43, integrate=True),),
}


STEPPED = ("a lag after a slew", "an integral that ends")
"""Their steps begin with a look, so that a look more moves them by a part of a step."""


@pytest.mark.parametrize("name", MOVING)
def test_what_moves_is_the_same_however_seldom_it_is_looked_at(name: str) -> None:
    often, seldom = world(readings=MOVING[name]), world(readings=MOVING[name])
    at, looks = 0.0, (0.1, 0.05, 0.9, 0.7, 2.0)
    for number, wait in enumerate(looks):
        for found in (often, seldom):
            found.receive("in", {"percent": (-1.0) ** number * 10.0}, at)
        for step in range(1, round(wait / STEP_S) + 1):
            often.advance(at + step * STEP_S)
        at += wait
        seldom.advance(at)
        often.advance(at)
        assert seldom.values["m"] == pytest.approx(often.values["m"], abs=0.2 if name in STEPPED else 1e-6), f"at {at}"


def test_a_port_that_nobody_hears_keeps_its_part_awake_only_if_its_messages_are_counted() -> None:
    for follows, until in (("knob", float("inf")), ("#out", 1.0)):
        found = world(Output("out", {"percent": "seen"}, every=1.0), readings=(Reading("seen", follows=follows),))
        found.join(0.0)
        assert len(said(found, 0.0)) == 1
        assert found.quiet_until(0.0) == 1.0
        assert found.quiet_until(0.0, lambda port: port != "out") == until


def test_a_message_that_says_what_is_known_changes_nothing() -> None:
    shown = Reading("shown", follows="in.percent")
    found = world(readings=(shown,))
    assert found.receive("in", {"percent": 7.0}, 0.0)
    assert not found.receive("in", {"percent": 7.0}, 1.0)
    assert found.receive("in", {"percent": 8.0}, 2.0)
    assert found.values["#in"] == 3
    expiring = world(readings=(Reading("shown", follows="in.percent", start=0.0, lasts=1.5),))
    for at in (0.0, 1.0):
        assert expiring.receive("in", {"percent": 7.0}, at), "it lasts longer now"
    expiring.advance(2.0)
    assert expiring.readings() == {"shown": 7.0}
    expiring.advance(2.6)
    assert expiring.readings() == {"shown": 0.0}
    counting = world(readings=(Reading("number", follows="#in"),))
    for _ in range(2):
        assert counting.receive("in", {"percent": 7.0}, 0.0)
