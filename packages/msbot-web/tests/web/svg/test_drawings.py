"""Values as pictures: every message type, any value, and no text that becomes markup."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_web.language import languages
from msbot_web.models.robot_models import PartLine, PortLine, Scalar, SlotCard
from msbot_web.svg.drawings import (
    STATE_ICONS,
    beat_ring,
    draw,
    fields_html,
    sparkline,
    state_chip,
    value_words,
)
from tests.web.pictures import HARMFUL, names, read, scalars, words

ENGLISH = languages()["en"]
TYPES = (
    "Switch", "Light", "Level", "Angle", "Colour", "Temperature", "Distance", "Speed", "Gas", "Text", "HelloWorld",
    "SomethingNew",
)  # fmt: skip
FIELDS = ("on", "lux", "percent", "degrees", "red", "celsius", "metres", "in_range", "rpm", "ppm", "message")


def port(name: str, *, publishes: bool, fields: dict[str, Scalar] | None = None) -> PortLine:
    return PortLine(port=name, topic="t", type_name="Level", publishes=publishes, reliable=True, fields=fields or {})


def card(
    *ports: PortLine, category: str = "", part: PartLine | None = None, next_beat_s: float | None = None
) -> SlotCard:
    return SlotCard(
        name="fan",
        part_number="FAN-5V",
        type_name="Fan",
        category=category,
        description="",
        state="active",
        reason="",
        part=part,
        ports=list(ports),
        next_beat_s=next_beat_s,
        simulated=False,
        plugged=None,
    )


def line(life: int) -> PartLine:
    return PartLine(
        part="fan",
        part_number="FAN-5V",
        local_name="",
        uid="",
        slot="fan",
        state="active",
        reason="",
        state_age_s=1.0,
        life=life,
        beat_age_s=0.5,
        beats=3,
        plug_in_to_active_ms=None,
        client_key="1",
        address="",
        refused_claims=0,
        duplicates=[],
    )


@settings(deadline=None)
@given(st.sampled_from(TYPES), st.dictionaries(st.one_of(st.sampled_from(FIELDS), names), scalars, max_size=5))
def test_any_value_is_drawn_and_said_in_words(type_name: str, fields: dict[str, Scalar]) -> None:
    root = read(draw(type_name, fields))
    label = root[0].get("aria-label")
    assert label == (", ".join(f"{name} {value_words(value)}" for name, value in fields.items()) or "no value yet")
    assert words(read(fields_html(fields, limit=9))).count(" ") >= len(fields)


@pytest.mark.parametrize(
    ("type_name", "fields", "said"),
    [
        ("Switch", {"on": True}, "on"),
        ("Switch", {"on": False}, "off"),
        ("Angle", {"degrees": 45.0}, "45°"),
        ("Temperature", {"celsius": 21.5}, "21.5 °C"),
        ("Distance", {"metres": 1.5, "in_range": True}, "1.50 m"),
        ("Distance", {"metres": 0.0, "in_range": False}, "nothing"),
        ("Speed", {"rpm": -30.0}, "↺ -30"),
        ("Colour", {"red": 255, "green": 0, "blue": 300}, "#ff00ff"),
        ("HelloWorld", {"index": 1, "message": "hi there"}, "hi there"),
        ("SomethingNew", {"x": 0.123456}, "0.1235"),
    ],
)
def test_the_picture_says_the_value(type_name: str, fields: dict[str, Scalar], said: str) -> None:
    assert said in words(read(draw(type_name, fields)))


def test_text_of_a_part_is_shown_as_text() -> None:
    said = words(read(draw("HelloWorld", {"message": "<b>x</b>"})))
    assert "<b>x</b>" in said
    assert HARMFUL in words(read(fields_html({HARMFUL: HARMFUL})))


@pytest.mark.parametrize("state", [*STATE_ICONS, HARMFUL])
def test_a_state_has_a_sign_and_a_word_besides_its_colour(state: str) -> None:
    root = read(state_chip(state, HARMFUL))
    assert words(root) == STATE_ICONS.get(state, "") + HARMFUL
    assert root[0].get("class") == f"state s-{state}"


def test_the_signs_of_states_differ() -> None:
    assert len(set(STATE_ICONS.values())) == len(STATE_ICONS)


def test_the_ring_tells_life_and_time_to_the_next_beat() -> None:
    half = read(beat_ring(card(part=line(3), next_beat_s=0.5), 1.0, 3, ENGLISH))
    assert half[0].get("aria-label") == "life status 3, next beat in 0.5 s"
    assert words(half).split()[-1] == "3"
    overdue = read(beat_ring(card(part=line(1), next_beat_s=-2.0), 1.0, 1, ENGLISH))
    assert overdue[0].get("aria-label") == "life status 1, beat overdue for 2.0 s"
    for empty in (card(), card(part=line(0))):
        assert words(read(beat_ring(empty, 1.0, 0, ENGLISH))).split()[-1] == "–"


def test_of_an_actuator_what_it_was_told_is_drawn_of_a_sensor_what_it_tells() -> None:
    told, tells = (
        port("power", publishes=False, fields={"percent": 1.0}),
        port("speed", publishes=True, fields={"rpm": 1.0}),
    )
    assert card(told, tells, category="actuator").main_port is told
    assert card(told, tells, category="sensor").main_port is tells
    silent = port("power", publishes=False)
    assert card(silent, tells, category="actuator").main_port is tells
    assert card(silent).main_port is silent
    assert card().main_port is None


@given(st.lists(st.floats(-1e6, 1e6), max_size=70))
def test_a_sparkline_stays_in_its_frame(values: list[float]) -> None:
    root = read(sparkline(values, least=0.0))
    for polyline in root.iter("polyline"):
        points = [tuple(map(float, point.split(","))) for point in polyline.attrib["points"].split()]
        assert len(points) == len(values)
        assert all(0 <= x <= 220 and 0 <= y <= 44 for x, y in points)


def test_values_in_words() -> None:
    assert [value_words(value) for value in (True, False, 3, 2.0, 1 / 3, "x")] == ["on", "off", "3", "2", "0.3333", "x"]
