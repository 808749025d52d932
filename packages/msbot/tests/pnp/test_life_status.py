"""Life status and the table of states."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.pnp import FAST_TIMING, THESIS_TIMING, PartState
from msbot.pnp.life_status import TRANSITIONS, Life, check_transition
from msbot_xrce.errors import LocalProtocolError
from tests import ROOT
from tests.effort import tries

DOCS = ROOT / "docs"


def test_life_status_is_3_after_registration_and_after_each_beat() -> None:
    life = Life(THESIS_TIMING)
    assert life.status == 0
    life.register(10.0)
    assert life.status == 3
    life.tick()
    assert life.status == 2
    life.beat(11.0)
    assert (life.status, life.beats, life.last_beat_at) == (3, 1, 11.0)


def test_the_third_tick_without_a_beat_ends_life_and_further_ones_do_nothing() -> None:
    life = Life(THESIS_TIMING)
    life.register(0.0)
    assert [life.tick() for _ in range(5)] == [False, False, True, False, False]
    assert life.status == 0


def test_registration_begins_a_new_count_of_beats_and_a_repeated_claim_does_not() -> None:
    life = Life(THESIS_TIMING)
    life.register(0.0)
    life.beat(1.0)
    life.refresh(1.5)
    assert life.beats == 1
    life.register(2.0)
    assert life.beats == 0


def test_a_part_is_late_when_more_than_one_and_a_half_beat_periods_are_silent() -> None:
    life = Life(FAST_TIMING)
    assert not life.is_late(100.0)
    life.register(0.0)
    assert not life.is_late(0.375)
    assert life.is_late(0.376)
    life.end()
    assert not life.is_late(10.0)


def test_silence_is_zero_before_the_first_sign_of_life() -> None:
    assert Life(THESIS_TIMING).silence_s(5.0) == 0.0


@given(st.floats(0.0, 2.0, exclude_max=True))
@settings(max_examples=tries(50, 2000), deadline=None)
def test_whenever_the_last_beat_falls_life_ends_after_4_to_6_s(phase: float) -> None:
    life = Life(THESIS_TIMING)
    life.register(phase)
    ticks = 1
    while not life.tick():
        ticks += 1
    assert 4.0 <= ticks * 2.0 - phase <= 6.0


def test_every_state_can_be_reached_and_every_present_part_can_end() -> None:
    assert {after for _, after in TRANSITIONS} == set(PartState)
    for state in set(PartState) - {PartState.LOST, PartState.LEFT}:
        assert any((state, end) in TRANSITIONS for end in (PartState.LOST, PartState.LEFT))


def test_nobody_becomes_active_without_having_been_checked() -> None:
    assert {before for before, after in TRANSITIONS if after is PartState.ACTIVE} == {
        PartState.CHECKING,
        PartState.LATE,
        PartState.STANDBY,  # which only a part that was checked can be
    }
    assert {before for before, after in TRANSITIONS if after is PartState.LATE} == {PartState.ACTIVE}


def test_a_change_outside_the_table_is_a_fault() -> None:
    check_transition(None, PartState.NEW)
    with pytest.raises(LocalProtocolError, match="from nothing to active"):
        check_transition(None, PartState.ACTIVE)
    with pytest.raises(LocalProtocolError, match="from left to active"):
        check_transition(PartState.LEFT, PartState.ACTIVE)


def rows() -> str:
    """The table as the docs print it."""
    lines = ["| from | to | because |", "|---|---|---|"]
    for (before, after), cause in TRANSITIONS.items():
        lines.append(f"| {'nothing' if before is None else f'`{before.value}`'} | `{after.value}` | {cause} |")
    return "\n".join(lines)


def test_the_docs_show_the_table() -> None:
    assert rows() in (DOCS / "reference/part_states.md").read_text(encoding="utf-8")


def test_the_docs_timing_table_is_that_of_the_presets() -> None:
    page = (DOCS / "explain/plug_and_play.md").read_text(encoding="utf-8")
    for name, timing in (("thesis (default)", THESIS_TIMING), ("`fast`", FAST_TIMING)):
        late = f"{timing.late_s:g} to {2 * timing.beat_s:g} s"
        bounds = f"{timing.shortest_detection_s:g} s | {timing.longest_detection_s:g} s"
        assert f"| {name} | {timing.beat_s:g} s | {timing.tick_s:g} s | {timing.life} | {late} | {bounds} |" in page


def test_a_part_with_one_tick_left_is_late_and_one_without_a_beat_has_none() -> None:
    life = Life(THESIS_TIMING)
    assert life.beats == 0
    life.register(0.0)
    life.tick()
    life.tick()
    assert life.status == 1
    assert life.is_late(4.0)
