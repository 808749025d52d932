"""The picture of growth: valid, with each point at its height."""

from itertools import pairwise
from xml.etree import ElementTree

from bench.growth_curves import Curve, curves

SVG = "{http://www.w3.org/2000/svg}"


def test_each_curve_has_a_panel_and_its_points_stand_where_their_values_are() -> None:
    drawn = curves([Curve("cost, µs", [(10, 5.0), (100, 5.0), (1000, 20.0)]), Curve("a < b", [(10, 1.0), (100, 2.0)])])
    root = ElementTree.fromstring(drawn)
    flat, same, high, *other = [(float(dot.attrib["cx"]), float(dot.attrib["cy"])) for dot in root.iter(f"{SVG}circle")]
    assert flat[1] == same[1] > high[1]
    assert same[0] - flat[0] == high[0] - same[0], "ten times as many is the same step"
    assert all(first[0] < second[0] for first, second in pairwise((flat, same, high, *other)))
    texts = [text.text for text in root.iter(f"{SVG}text")]
    assert {"cost, µs", "a < b", "10", "100", "1,000", "sessions"} <= set(texts)
    assert "0" in texts
