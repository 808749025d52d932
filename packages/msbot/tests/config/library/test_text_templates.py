"""Texts with sources in braces."""

from msbot.config import Scalar
from msbot.config.library.simulator_reader import can_format, format_text

VALUES: dict[str, Scalar] = {"n": 3.0, "red": 255.0, "on": True, "word": "hi", "in.message": "x", "share": 0.25}


def test_sources_are_filled_in() -> None:
    assert format_text("turn-on {n:d}", VALUES) == "turn-on 3"
    assert format_text("#{red:02x}", VALUES) == "#ff"
    assert format_text("{on} {on:d} {word} {in.message} {n} {share} {share:.1f}", VALUES) == "true 1 hi x 3 0.25 0.2"
    assert format_text("{word:>4}", VALUES) == "  hi"
    assert format_text("no source {}", VALUES) == "no source {}"


def test_a_value_of_another_kind_than_the_form_is_written_as_it_is() -> None:
    assert format_text("{word:d}, {n:zz}", VALUES) == "hi, 3"


def test_forms_that_fit_a_value() -> None:
    assert can_format(1.0, "d")
    assert can_format("a", ">3")
    assert not can_format("a", "d")
    assert not can_format(1.0, "nonsense")
