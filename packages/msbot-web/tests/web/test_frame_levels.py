"""A frame that is chosen on the page Bus as levels on the wire: those that can be drawn, and those that cannot."""

from __future__ import annotations

from base64 import b64decode

import pytest

from msbot_agent.link.can.protocol import Frame, format_frame, wire_bits
from msbot_web.models.bus_models import BusFigures, FrameLine
from msbot_web.pages.bus import levels_of


def line(notation: str) -> FrameLine:
    return FrameLine(
        number=1, age_s=0.0, sender="here", text="", node=1, plain=[], about=[], words=[], notation=notation
    )


def bus(bitrate: int = 500_000, data_bitrate: int = 0) -> BusFigures:
    return BusFigures(
        watched=True,
        name="can0",
        bitrate=bitrate,
        data_bitrate=data_bitrate,
        frames=1,
        load_percent=0.0,
        frames_per_second=0.0,
        errors=0,
    )


def test_every_bit_is_there_with_its_stuff_bits() -> None:
    frame = Frame(0x101, bytes(8))
    levels = levels_of(line(format_frame(frame)), bus())
    assert levels is not None
    bits = wire_bits(frame)
    assert (levels.bits, levels.stuff_bits) == (len(bits), sum(one.stuff for one in bits))
    assert levels.stuff_bits >= 12, "64 zeros"
    picture = b64decode(levels.picture).decode()
    assert picture.startswith("<svg")
    assert f"{len(bits)} bits, {levels.stuff_bits} of them stuff bits" in picture


@pytest.mark.parametrize(
    ("notation", "figures"),
    [
        ("20000080#0000000000000000", bus()),  # an error frame
        ("", bus()),  # of a recording that says nothing of it
        ("101#C010", bus(bitrate=0)),
        ("101##1C010", bus()),  # its fast part: nobody knows how fast
    ],
)
def test_what_cannot_be_drawn_is_not(notation: str, figures: BusFigures) -> None:
    assert levels_of(line(notation), figures) is None


def test_the_fast_part_is_drawn_at_its_own_rate() -> None:
    levels = levels_of(line("101##1C010"), bus(data_bitrate=2_000_000))
    assert levels is not None
    assert "its fast part at 2000 kbit/s" in b64decode(levels.picture).decode()
