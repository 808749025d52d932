"""The demo's screen: the link first, and everything that matters within 80 columns and 24 lines."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from msbot.config import SAMPLES, load_library, parse_blueprint
from msbot_school.demo import DemoSnapshot, DemoStateChange, PartSnapshot
from msbot_school.demo.demo_links import BusSnapshot
from msbot_web.cli.demo.output import event_lines
from msbot_web.cli.demo.terminal_table import keys_of, live_view

LINK = "The page is at http://127.0.0.1:8080/enter?token=0123456789abcdef012345"


def snapshot(sample: str) -> DemoSnapshot:
    slots = parse_blueprint(SAMPLES[sample], load_library()).slots
    parts = tuple(
        PartSnapshot(
            name=slot.name,
            part_number=slot.part_number,
            slot=slot.name,
            state="active",
            plugged=number != 3,
            life=3,
            beat_age_s=0.4,
            beats=12,
            messages_in=123,
            messages_out=45,
            plug_in_to_active_ms=20.0,
            outputs=(True,) * 8 if slot.name == "BB" else (),
        )
        for number, slot in enumerate(slots)
    )
    bus = BusSnapshot(500_000, 1234, 99_999, 1.5, 1.6, 0)
    return DemoSnapshot("ROVER", "simulated CAN bus, 500 kbit/s", 12.3, parts, (), bus)


def shown(sample: str, width: int, height: int, events: int = 20) -> list[str]:
    happened = [
        DemoStateChange(float(n), "knob", "late", "lost", f"no beat for {n} s, " + "x" * 90) for n in range(events)
    ]
    target = io.StringIO()
    console = Console(file=target, width=width, height=height)
    console.print(live_view(snapshot(sample), happened, [LINK], width, height))
    return target.getvalue().rstrip("\n").split("\n")


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40), (200, 60)])
def test_everything_that_matters_fits_and_the_link_is_first(sample: str, width: int, height: int) -> None:
    lines = shown(sample, width, height)
    assert len(lines) < height
    assert max(map(len, lines)) <= width
    assert lines[0] == LINK, "whole, in one line"
    screen = "\n".join(lines)
    for part in snapshot(sample).parts:
        (row,) = [line for line in lines if line.split()[1:2] == [part.slot]]
        assert part.part_number in row
        assert part.state in row
        assert row.split()[0] in keys_of([one.name for one in snapshot(sample).parts])
    assert "q: quit" in screen
    assert "(out)" in screen or sample == "thesis"
    assert ("plug-in to active" in screen) == (width > 100)


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize("width", range(36, 81, 4))
def test_a_narrow_terminal_does_without_columns_and_cuts_none(sample: str, width: int) -> None:
    (head,) = [line for line in shown(sample, width, 40, events=0) if line.startswith("key")]
    lines = shown(sample, width, 40, events=0)
    assert max(map(len, lines)) <= width
    assert (
        {"key", "slot", "state"} <= set(head.split()) <= {"key", "slot", "part", "state", "life", "beat", "in", "out"}
    )
    rows = lines[lines.index(head) + 2 :][: len(snapshot(sample).parts)]
    for part, row in zip(snapshot(sample).parts, rows, strict=True):
        assert row.split()[1] == part.slot
        assert f"● {part.state}{'' if part.plugged else ' (out)'}" in row
        assert ("▮▮▮ 3" in row) == ("life" in head)
        assert "…" not in row


@pytest.mark.parametrize("width", [40, 50, 60, 70])
def test_a_narrow_terminal_cuts_neither_the_bus_nor_a_reason(width: int) -> None:
    lines = shown("rover", width, 60, events=3)
    assert max(map(len, lines)) <= width
    assert "…" not in "".join(lines)
    (bus,) = [line for line in lines if "load now" in line]
    assert "load now 1.6 %" in bus
    assert "errors 0" in bus
    assert ("bus 500 kbit/s" in bus) == (width >= 50)
    events = " ".join("".join(lines).split())
    for number in range(3):
        assert f"{number}.0 s knob lost: no beat for {number} s, x" in events


def test_a_reason_has_the_lines_that_there_are() -> None:
    event = DemoStateChange(9.731, "fan", "late", "lost", "no beat for 4.9 s: life status 0")
    assert event_lines(event, 80, None) == ["  9.731 s  fan       late -> lost: no beat for 4.9 s: life status 0"]
    assert event_lines(event, 30, None) == ["9.7 s fan lost: no beat for", "  4.9 s: life status 0"]
    assert event_lines(event, 30, 1) == ["9.7 s fan lost: no beat for…"]
    for before in ("", "refused"):
        words = event_lines(DemoStateChange(9.731, "fan", before, "refused", "it is unknown"), 80, None)
        assert words == ["  9.731 s  fan       refused: it is unknown"]


def test_the_newest_events_are_shown_as_far_as_there_is_room() -> None:
    small, large = shown("rover", 80, 24), shown("rover", 80, 50)
    assert "no beat for 19 s" in [line for line in small if "no beat" in line][-1]
    assert sum("no beat" in line for line in small) < sum("no beat" in line for line in large) == 8
    assert "no beat" not in "".join(shown("rover", 80, 16))
