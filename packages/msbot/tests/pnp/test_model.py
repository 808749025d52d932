"""The values: timing that cannot delist healthy parts, words for every refusal, events as sentences."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot.config import Slot
from msbot.pnp import (
    FAST_TIMING,
    THESIS_TIMING,
    Claim,
    Configuration,
    LifeTiming,
    MemoryStore,
    PartEvent,
    PartState,
    PartStore,
    Refusal,
    StopRecord,
)
from msbot_xrce.errors import ConfigError
from tests.pnp.robot import ABCD, sample_store, uid


def test_the_thesis_timing_delists_between_4_and_6_s() -> None:
    assert (THESIS_TIMING.beat_s, THESIS_TIMING.tick_s, THESIS_TIMING.life) == (1.0, 2.0, 3)
    assert (THESIS_TIMING.shortest_detection_s, THESIS_TIMING.longest_detection_s) == (4.0, 6.0)
    assert THESIS_TIMING.beat_ms == 1000


def test_the_fast_preset_delists_within_one_and_a_half_seconds() -> None:
    assert FAST_TIMING.longest_detection_s == 1.5
    assert FAST_TIMING.beat_ms == 250


@pytest.mark.parametrize(
    ("timing", "words"),
    [
        ({"beat_s": 0.0}, "beat period 0.0 s"),
        ({"beat_s": 66.0}, "0.02 to 65 s"),
        ({"life": 0}, "life status 0"),
        ({"life": 256}, "must be 1 to 255"),
        ({"life": 1}, "a part could be delisted 0.0 s after a beat"),
        ({"tick_s": 0.5}, "use a longer tick or a higher life"),
        ({"late_after_beats": 1.0}, "must be more than 1"),
    ],
)
def test_a_timing_that_delists_healthy_parts_is_refused(timing: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        LifeTiming(**timing)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "timing",
    [
        LifeTiming(beat_s=0.02),
        LifeTiming(beat_s=65.0, tick_s=65.0),
        LifeTiming(life=255),
        LifeTiming(beat_s=1.0, tick_s=2.0, life=2, late_after_beats=2.0),
    ],
)
def test_the_limits_themselves_are_allowed(timing: LifeTiming) -> None:
    assert timing.shortest_detection_s >= timing.late_s


def test_registered_are_active_and_late_and_over_are_lost_and_left() -> None:
    assert {state for state in PartState if state.is_registered} == {PartState.ACTIVE, PartState.LATE}
    assert {state for state in PartState if state.is_over} == {PartState.LOST, PartState.LEFT}


def test_refusals_have_the_codes_of_the_wire_and_words() -> None:
    assert [refusal.value for refusal in Refusal] == list(range(1, 12))
    assert all(refusal.describe for refusal in Refusal)
    assert len({refusal.describe for refusal in Refusal}) == len(Refusal)


def test_an_event_is_a_sentence_and_its_evidence() -> None:
    event = PartEvent(1.0, "AA", "left", PartState.ACTIVE, PartState.LATE, "no beat for 1.6 s", (("rule", "outcome"),))
    assert event.sentences() == ["AA: active -> late in slot left: no beat for 1.6 s", "  - rule: outcome"]
    first = PartEvent(1.0, "node 7", None, None, PartState.NEW, "a session was opened")
    assert first.sentences() == ["node 7: new: a session was opened"]
    again = replace(first, from_state=PartState.REFUSED, to_state=PartState.REFUSED, reason="it is unknown")
    assert again.sentences() == ["node 7: refused: it is unknown"], "it is as it was, for another reason"


def test_a_slot_asks_for_its_own_name_unless_told_otherwise() -> None:
    assert Slot("left", "ABCD").wanted_name == "left"
    assert Slot("left", "ABCD", "wheel-1").wanted_name == "wheel-1"


def test_the_memory_store_is_a_part_store() -> None:
    store: PartStore = sample_store()
    assert store.part_type("ABCD") == ABCD
    assert store.part_type("abcd") is None
    assert [slot.name for slot in store.slots()] == ["AA", "BB", "CC"]
    assert store.configuration("AA").bindings
    assert store.configuration("none") == Configuration(version=1, slot="none")


def test_the_memory_store_remembers_uids_but_not_their_absence() -> None:
    store = MemoryStore()
    store.remember(uid(1), "AA", Claim("ABCD"))
    store.remember(b"", "BB", Claim("EFGH"))
    assert store.remembered_slot(uid(1)) == "AA"
    assert store.remembered_slot(b"") is None


def test_the_memory_store_blocks_by_uid_or_number() -> None:
    store = MemoryStore()
    store.blocks[uid(1)] = "smells burnt"
    store.blocks["WXYZ"] = "recalled"
    assert store.blocked(uid(1), "ABCD") == "smells burnt"
    assert store.blocked(uid(2), "WXYZ") == "recalled"
    assert store.blocked(uid(2), "ABCD") is None


def test_a_store_without_a_database_keeps_stop_as_long_as_it_is_there() -> None:
    store = MemoryStore()
    assert store.kept_stop() is None
    store.keep_stop(StopRecord(3, holds=True, by="ann"))
    assert store.kept_stop() == StopRecord(3, holds=True, by="ann")
    assert store.is_kept(0.0)
