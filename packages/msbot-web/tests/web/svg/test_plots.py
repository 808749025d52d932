"""Bars and curves as SVG: where a state begins and ends, and no name that becomes markup."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.text.sentence import said
from msbot_web.language import languages
from msbot_web.models.robot_models import SpanLine, TimelineLane
from msbot_web.svg.wiring_graph import STATE_COLOURS, bars_svg, shortened
from tests.web.pictures import names, read, words

WIDTH = 1000.0
WIDEST_LETTER = 8.6
"""Mean width of a letter of DejaVu Sans Bold at 13 pixels, in names as people give them."""
SVG_TEXT = "{http://www.w3.org/2000/svg}text"


same = languages()["en"]
GERMAN = languages()["de"]


def span(begin: float, end: float, state: str = "active", reason: str = "it fits") -> SpanLine:
    return SpanLine(begin_age_s=begin, end_age_s=end, state=state, part="p", reason=reason)


spans = st.builds(
    span, st.floats(0, 1e5), st.floats(0, 1e5), st.one_of(st.sampled_from(list(STATE_COLOURS)), names), names
)
lanes = st.builds(lambda slot, found: TimelineLane(slot=slot, spans=found), names, st.lists(spans, max_size=5))


def test_a_bar_reaches_from_its_begin_to_its_end_in_the_colour_of_its_state() -> None:
    root = read(bars_svg([TimelineLane(slot="fan", spans=[span(60, 30, "late", "silent"), span(30, 0)])], 60.0, same))
    late, active = root.findall(".//{*}rect")
    assert late.get("fill") == STATE_COLOURS["late"]
    end_of_late = float(late.attrib["x"]) + float(late.attrib["width"])
    assert abs(end_of_late - float(active.attrib["x"])) < 0.2
    assert float(late.attrib["width"]) == float(active.attrib["width"])
    assert "late: silent" in words(root)


def test_what_was_before_the_time_shown_is_left_out_or_cut() -> None:
    root = read(bars_svg([TimelineLane(slot="fan", spans=[span(900, 100), span(100, 50), span(50, 0)])], 60.0, same))
    cut, whole = root.findall(".//{*}rect")
    assert float(cut.attrib["x"]) < float(whole.attrib["x"])
    assert float(cut.attrib["x"]) == 80


@pytest.mark.parametrize("is_narrow", [False, True])
def test_names_of_slots_have_the_room_that_the_longest_of_them_needs(is_narrow: bool) -> None:
    for slot in ("fan", "program_Red", "wheels_of_the_second_robot"):
        root = read(bars_svg([TimelineLane(slot=slot, spans=[span(60, 0)])], 60.0, same, is_narrow=is_narrow))
        (bar,) = root.findall(".//{*}rect")
        (name,) = [
            one for one in root.findall(".//{*}text") if one.get("text-anchor") == "end" and one.get("font-weight")
        ]
        ends, letters = float(name.attrib["x"]), len(name.text or "")
        assert letters >= min(len(slot), 13)
        assert letters * WIDEST_LETTER <= ends < float(bar.attrib["x"])


@settings(deadline=None)
@given(st.lists(lanes, max_size=4), st.sampled_from([60.0, 7200.0]))
def test_any_past_is_drawn(found: list[TimelineLane], span_s: float) -> None:
    root = read(bars_svg(found, span_s, same))
    for lane in found:
        assert shortened(lane.slot, 16) in words(root)
    narrow = read(bars_svg(found, span_s, same, is_narrow=True))
    assert narrow[0].get("viewBox", "").startswith("0 0 380 ")


def test_words_and_numbers_are_those_of_the_language() -> None:
    lane = TimelineLane(slot="fan", spans=[span(60, 0, reason=said("heard again after {silence:.1f} s", silence=1.5))])
    drawn = words(read(bars_svg([lane], 90.0, GERMAN)))
    assert "jetzt" in drawn
    assert "aktiv: nach 1,5 s wieder gehört" in drawn
    assert "-1,5 min" in drawn
