"""Bars and curves as SVG: where a state begins and ends, and no name that becomes markup."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.lab.curves.curve import Curve, thinned
from msbot.runtime.sentence import said
from msbot.web.api.models import SpanLine, TimelineLane
from msbot.web.language import languages
from msbot.web.svg.plots import STATE_COLOURS, bars_svg, curve_svg, curves_csv, shortened
from tests.web.pictures import HARMFUL, names, read, words

WIDTH = 1000.0
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
    assert float(cut.attrib["x"]) == 130


@settings(deadline=None)
@given(st.lists(lanes, max_size=4), st.sampled_from([60.0, 7200.0]))
def test_any_past_is_drawn(found: list[TimelineLane], span_s: float) -> None:
    root = read(bars_svg(found, span_s, same))
    for lane in found:
        assert shortened(lane.slot, 16) in words(root)
    narrow = read(bars_svg(found, span_s, same, is_narrow=True))
    assert narrow[0].get("viewBox", "").startswith("0 0 380 ")


def test_a_curve_has_its_name_its_unit_and_its_newest_value() -> None:
    curves = [Curve("fan · percent", [(0.0, 1.0), (1.0, 5.0)], "%"), Curve(HARMFUL, [(0.5, 3.0)])]
    root = read(curve_svg(curves, 10.0, 1.0, same))
    assert "fan · percent: 5 %" in words(root)
    assert f"{HARMFUL}: 3" in words(root)
    first, second = root.findall(".//{*}polyline")
    assert first.get("stroke") != second.get("stroke")
    assert len(first.attrib["points"].split()) == 2


def test_the_unit_stands_on_the_axis_when_all_curves_have_the_same() -> None:
    light, heat = Curve("a", [(0.0, 1.0)], "lx"), Curve("b", [(0.0, 1.0)], "°C")
    assert "lx" in [text.text for text in read(curve_svg([light, light], 10.0, 1.0, same)).iter(SVG_TEXT)]
    assert "lx" not in [text.text for text in read(curve_svg([light, heat], 10.0, 1.0, same)).iter(SVG_TEXT)]


def test_only_the_range_that_was_chosen_is_drawn() -> None:
    curve = Curve("a", [(float(at), float(at)) for at in range(100)])
    (line,) = read(curve_svg([curve], 10.0, 99.0, same)).findall(".//{*}polyline")
    assert len(line.attrib["points"].split()) == 11


@given(
    st.lists(
        st.tuples(st.integers(0, 10**6), st.floats(-1e6, 1e6)), min_size=1, max_size=400, unique_by=lambda one: one[0]
    )
)
def test_a_thinned_curve_keeps_its_extremes(points: list[tuple[float, float]]) -> None:
    points.sort()
    thin = thinned(points, 40)
    assert len(thin) <= 40
    assert set(thin) <= set(points)
    for pick in (min, max):
        assert pick(value for _, value in thin) == pick(value for _, value in points)


def test_the_table_has_a_line_for_each_value() -> None:
    table = curves_csv([Curve('the "fan"', [(0.0, 1.5), (1.0, 11.699999809265137)], "%")], 3.0)
    assert table.splitlines() == [
        "seconds ago,field,value,unit",
        '3.0000,"the ""fan""",1.5,%',
        '2.0000,"the ""fan""",11.7,%',
    ]


@settings(deadline=None)
@given(st.dictionaries(names, st.lists(st.tuples(st.floats(0, 1e6), st.floats(-1e9, 1e9)), max_size=20), max_size=7))
def test_any_curves_stay_in_their_frame(curves: dict[str, list[tuple[float, float]]]) -> None:
    found = [Curve(name, sorted(points)) for name, points in curves.items()]
    root = read(curve_svg(found, 1e6, 1e6, same))
    for line in root.iter("{http://www.w3.org/2000/svg}polyline"):
        for point in line.attrib["points"].split():
            x, y = map(float, point.split(","))
            assert 0 <= x <= WIDTH
            assert 0 <= y <= 300
    if not any(curves.values()):
        assert "No numbers yet." in words(root)


def test_words_and_numbers_are_those_of_the_language() -> None:
    lane = TimelineLane(slot="fan", spans=[span(60, 0, reason=said("heard again after {silence:.1f} s", silence=1.5))])
    drawn = words(read(bars_svg([lane], 60.0, GERMAN)))
    assert "jetzt" in drawn
    assert "aktiv: nach 1,5 s wieder gehört" in drawn
    assert "Noch keine Zahlen." in words(read(curve_svg([], 60.0, 0.0, GERMAN)))
    curves = words(read(curve_svg([Curve("level", [(0.0, 0.25), (1.0, 0.75)], "%")], 90.0, 1.0, GERMAN)))
    assert "level: 0,75 %" in curves
    assert "-1,5 min" in curves
