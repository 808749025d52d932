"""The drawing of the wires: who publishes what to whom, and no name that becomes markup."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.web.graph import wiring_svg
from msbot.web.models import TopicLine
from msbot.web.plots import STATE_COLOURS
from tests.web.pictures import HARMFUL, names, read, words

ends = st.builds(lambda slot, port: f"{slot}.{port}", names, names)


def topic(name: str, publishers: list[str], subscribers: list[str], rate_hz: float = 0.0) -> TopicLine:
    return TopicLine(
        topic=name, type_name="Level", publishers=publishers, subscribers=subscribers, rate_hz=rate_hz, count=7,
        fields={},
    )  # fmt: skip


def test_every_end_is_joined_to_its_topic_and_slots_lead_to_their_drawer() -> None:
    lines = [topic("speed", ["knob.turn"], ["fan.power", "lamp.power"], 10.0)]
    root = read(wiring_svg(lines, {"knob": "active", "fan": "lost"}))
    links = [link.get("href") for link in root.findall(".//{*}a")]
    assert links == ["/?slot=knob", "/?slot=fan", "/?slot=lamp"]
    colours = [box.get("stroke") for box in root.findall(".//{*}a/{*}rect")]
    assert colours == [STATE_COLOURS[state] for state in ("active", "lost", "empty")]
    text = words(root)
    assert "10.0 Hz · 7" in text
    assert text.count("power") == 2
    assert root[0].get("aria-label") == "knob.turn to fan.power, lamp.power by speed"


def test_flowing_wires_differ_from_silent_ones_in_more_than_colour() -> None:
    busy, silent = (wiring_svg([topic("t", ["a.x"], ["b.y"], rate)], {}) for rate in (2.0, 0.0))
    assert "stroke-dasharray" not in busy
    assert "stroke-dasharray" in silent


def test_a_slot_that_hears_itself_stands_on_both_sides() -> None:
    root = read(wiring_svg([topic("t", ["a.x"], ["a.y"])], {}))
    assert len(root.findall(".//{*}a")) == 2


@settings(deadline=None)
@given(
    st.lists(
        st.builds(topic, names, st.lists(ends, max_size=3), st.lists(ends, max_size=3), st.floats(0, 1e4)),
        max_size=4, unique_by=lambda line: line.topic,
    )
)  # fmt: skip
def test_any_names_are_drawn_as_text(lines: list[TopicLine]) -> None:
    text = words(read(wiring_svg(lines, {HARMFUL: HARMFUL})))
    for line in lines:
        assert line.topic[:34] in text
