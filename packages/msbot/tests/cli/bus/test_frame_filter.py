"""Which frames are shown."""

from __future__ import annotations

import click
import pytest

from msbot.cli.bus.dump import FilterType, wanted
from msbot_agent.link.can.protocol.notation import parse_frame


def hits(filters: list[str], frames: list[str]) -> list[str]:
    chosen = tuple(wish for text in filters for wish in FilterType().convert(text, None, None))
    return [text for text in frames if wanted(parse_frame(text), chosen)]


FRAMES = ["100#", "101#", "181#", "123#", "00000101#", "1E123456#", "700#"]


@pytest.mark.parametrize(
    ("filters", "shown"),
    [
        ([], FRAMES),
        (["101"], ["101#"]),
        (["100:780"], ["100#", "101#", "123#"]),
        (["700", "181"], ["181#", "700#"]),
        (["00000101"], ["00000101#"]),
        (["1E000000:1E000000"], ["1E123456#"]),
        (["node=1"], ["101#", "181#"]),
        (["100~400"], ["00000101#", "1E123456#", "700#"]),
    ],
)
def test_a_frame_is_shown_when_it_meets_a_filter(filters: list[str], shown: list[str]) -> None:
    assert hits(filters, FRAMES) == shown


@pytest.mark.parametrize("wrong", ["", "xyz", "100:", "node=0", "node=121", "node=x", "123456789", "1-2"])
def test_what_is_no_filter_is_said(wrong: str) -> None:
    with pytest.raises(click.BadParameter, match="node"):
        FilterType().convert(wrong, None, None)


def test_click_may_convert_twice() -> None:
    once = FilterType().convert("101", None, None)
    assert FilterType().convert(once, None, None) == once
