"""What a card says of the part in it: real or simulated as the part itself reports, and nothing that is not known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from msbot.config import load_library, read_description
from msbot.part.join.pnp_messages import Nature
from msbot.pnp import PartInfo, PartState, SelfDescription
from msbot_web.html import render
from msbot_web.slot_cards import part_line


def info(nature: Nature) -> PartInfo:
    active = PartState.ACTIVE
    return PartInfo(
        "lamp", "LED", "lamp", bytes(8), "lamp", active, "", 0, 3, 0.1, 1, 5, 1, "here", 0, (), nature=nature
    )


@pytest.mark.parametrize(
    ("nature", "simulated_here", "badge"),
    [
        (Nature.REAL, False, "real"),
        (Nature.REAL, True, "real"),
        (Nature.SIMULATED, False, "simulated"),
        (Nature.REPLAYED, False, "replayed"),
        (Nature.UNKNOWN, True, "simulated"),
        (Nature.UNKNOWN, False, ""),
    ],
)
def test_the_badge_of_a_card_is_what_its_part_reports(nature: Nature, simulated_here: bool, badge: str) -> None:
    line = part_line(info(nature), is_ignored=False)
    card = SimpleNamespace(
        name="lamp",
        type_name="Lamp",
        shown_number="LED",
        state="active",
        reason="",
        part=line,
        simulated=simulated_here,
        faults=(),
        spares=(),
        type_differences=(),
    )
    html = str(
        render(
            "card",
            say=lambda text: text,
            card=card,
            look="active",
            port=None,
            ring="",
            chip="",
            drawing="",
            values="",
            spark="",
            held="",
            stale_age="",
            beat="",
        )
    )
    assert '<span class="mono">LED</span>' in html
    assert (f">{badge}</span>" in html) if badge else ("origin" not in html)


def test_an_arrival_says_the_ranges_of_its_ports() -> None:
    text = """number = "VALVE"
name = "valve"
[[port]]
name = "level"
direction = "subscribe"
type = "Level"
safe = {percent = 0.0}
ranges = {percent = [0, 60.5]}
"""
    says = SelfDescription(text, read_description(text, "VALVE", load_library()))
    said = part_line(replace(info(Nature.REAL), says=says), is_ignored=False).says
    assert said is not None
    assert said.ports[0].fields == ["percent 0 … 60.5 %"]
