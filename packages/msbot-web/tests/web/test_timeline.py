"""The past of slots: states with begin and reason, and the time between beats."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot.pnp import PartInfo, PartState
from msbot_web.timeline import KEPT_BEATS, KEPT_SPANS, MOST_SPANS, Timeline
from tests.registry.events import changed

INFO = PartInfo(
    part="AA",
    part_number="ABCD",
    local_name="",
    uid=b"12345678",
    slot="AA",
    state=PartState.ACTIVE,
    reason="",
    state_age_s=1.0,
    life=3,
    beat_age_s=0.0,
    beats=0,
    plug_in_to_active_ms=None,
    client_key=1,
    address="here",
    refused_claims=0,
    duplicates=(),
)


def test_each_change_of_a_slot_begins_a_span() -> None:
    timeline = Timeline()
    timeline.note(replace(changed(PartState.ACTIVE, reason="it fits"), at=1.0))
    timeline.note(replace(changed(PartState.LATE, reason="silent"), at=5.0))
    timeline.note(replace(changed(PartState.REFUSED, slot=None, local_name="guest"), at=6.0))
    first, second = timeline.spans("AA")
    assert (first.begin, first.state, first.reason, first.part) == (1.0, "active", "it fits", "ABCD-local")
    assert (second.begin, second.state) == (5.0, "late")
    assert set(timeline.lanes()) == {"AA", "guest"}
    assert timeline.spans("BB") == ()


def test_the_past_is_bounded() -> None:
    timeline = Timeline()
    for number in range(KEPT_SPANS + 10):
        timeline.note(replace(changed(PartState.ACTIVE), at=float(number)))
        timeline.note(changed(PartState.REFUSED, slot=None, local_name=f"guest {number}"))
    assert len(timeline.lanes()) <= KEPT_SPANS
    flooded = Timeline()
    for number in range(KEPT_SPANS + 10):
        flooded.note(replace(changed(PartState.ACTIVE), at=float(number)))
    assert len(flooded.spans("AA")) == KEPT_SPANS
    assert flooded.spans("AA")[-1].begin == KEPT_SPANS + 9


def test_strangers_neither_push_the_slots_out_nor_fill_the_memory() -> None:
    timeline = Timeline()
    timeline.note(changed(PartState.ACTIVE))
    for number in range(3 * MOST_SPANS):
        stranger = f"udp 10.0.{number % 700 // 256}.{number % 256}"
        timeline.note(changed(PartState.REFUSED, slot=None, local_name=stranger, reason=str(number)))
    lanes = timeline.lanes()
    assert len(lanes) == KEPT_SPANS
    assert sum(map(len, lanes.values())) <= MOST_SPANS
    assert lanes["AA"][-1].state == "active"
    assert [*lanes.values()][-1][-1].reason == str(3 * MOST_SPANS - 1), "the newest is there"


def test_one_lane_after_another_is_shortened_when_all_are_long() -> None:
    timeline = Timeline()
    for number in range(2 * MOST_SPANS):
        timeline.note(changed(PartState.ACTIVE, slot=f"S{number % 20}"))
    kept = [len(spans) for spans in timeline.lanes().values()]
    assert sum(kept) == MOST_SPANS
    assert max(kept) - min(kept) <= 1


def test_beats_are_timed_by_when_they_came_not_by_when_they_were_looked_at() -> None:
    timeline = Timeline()
    for step in range(1, 41):  # looks every 0.25 s, a beat every second at .1
        now = step * 0.25
        beats = int(now + 0.9)
        timeline.poll([replace(INFO, beats=beats, beat_age_s=now - (beats - 0.9))], now)
    assert timeline.beat_intervals("AA") == pytest.approx([1.0] * len(timeline.beat_intervals("AA")))
    assert len(timeline.beat_intervals("AA")) == 9


def test_beats_between_two_looks_share_the_time() -> None:
    timeline = Timeline()
    timeline.poll([replace(INFO, beats=1)], 1.0)
    timeline.poll([replace(INFO, beats=5)], 3.0)
    assert timeline.beat_intervals("AA") == (0.5,)


def test_a_new_session_in_the_slot_does_not_count_the_gap_as_a_beat() -> None:
    timeline = Timeline()
    timeline.poll([replace(INFO, beats=7)], 1.0)
    timeline.poll([replace(INFO, client_key=2, beats=1)], 60.0)
    timeline.poll([replace(INFO, client_key=2, beats=2)], 61.0)
    assert timeline.beat_intervals("AA") == (1.0,)


def test_parts_without_a_slot_or_a_beat_are_left_out_and_the_rest_is_bounded() -> None:
    timeline = Timeline()
    for number in range(KEPT_BEATS + 20):
        timeline.poll(
            [replace(INFO, beats=number), replace(INFO, slot=None, client_key=3, beats=number)], float(number)
        )
        timeline.poll([replace(INFO, slot="BB", client_key=4, beat_age_s=None)], float(number) + 0.1)
        timeline.poll([replace(INFO, beats=number)], float(number) + 0.2)
    assert len(timeline.beat_intervals("AA")) <= KEPT_BEATS
    assert timeline.beat_intervals("BB") == timeline.beat_intervals("") == ()
