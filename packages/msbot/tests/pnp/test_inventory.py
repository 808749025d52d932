"""The requirements of the thesis on the inventory, as PNP reads them (R51 to R63, T10)."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.config import PartType, Slot
from msbot.part.join.hardware_trouble import trouble_pieces
from msbot.pnp import FAST_TIMING, LifeTiming, MemoryStore, PartState, Refusal, Verdict
from tests.effort import tries
from tests.pnp.robot import Rig, configuration, sample_store, uid

AA, BB, CC, DD = 0xAAAAAAAA, 0xBBBBBBBB, 0xCCCCCCCC, 0xDDDDDDDD


# Registration


def test_a_listed_part_goes_through_both_steps_and_is_active() -> None:
    rig = Rig()
    rig.join(AA)
    assert rig.state(AA) is PartState.NEW
    rig.inventory.profile_asked(AA, rig.now)
    assert rig.state(AA) is PartState.CHECKING
    verdict = rig.claim(AA, "ABCD", name="AA")
    assert verdict.lease
    assert verdict.configuration_version == 1
    part = rig.part(AA)
    assert (part.part, part.slot, part.state, part.life) == ("AA", "AA", PartState.ACTIVE, 3)
    assert rig.changes(AA) == ["new", "checking", "active"]


def test_asking_for_the_profile_again_changes_nothing() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.inventory.profile_asked(AA, rig.now)
    rig.inventory.profile_asked(BB, rig.now)
    assert rig.state(AA) is PartState.ACTIVE


def test_two_different_parts_at_once_are_both_registered() -> None:
    rig = Rig()
    rig.join(AA)
    rig.join(BB)
    first, second = rig.claim(AA, "ABCD"), rig.claim(BB, "EFGH")
    assert first.lease
    assert second.lease
    assert first.lease != second.lease
    assert [info.slot for info in rig.inventory.view(rig.now)] == ["AA", "BB"]


def test_unknown_part_gets_no_reply_and_a_journal_entry_with_the_reason() -> None:
    rig = Rig()
    verdict = rig.claim(AA, "NOPE", name="stranger")
    assert verdict == Verdict(refusal=Refusal.UNKNOWN_PART)
    entry = rig.store.events[-1]
    assert (entry.part, entry.part_number, entry.to_state) == ("stranger", "NOPE", PartState.REFUSED)
    assert entry.reason == "part number NOPE is not in the library"
    assert entry.evidence[-1] == ("unknown part", entry.reason)


def test_a_refusal_is_journalled_once_however_often_it_is_repeated() -> None:
    rig = Rig()
    for _ in range(20):
        rig.claim(AA, "NOPE")
    assert len(rig.store.events) == 3
    assert rig.part(AA).refused_claims == 20


def test_an_unknown_part_does_not_keep_a_known_one_alive() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    for _ in range(7):
        rig.run(1.0)
        rig.claim(DD, "NOPE")
    assert rig.state(AA) is PartState.LOST


def test_a_refused_part_is_let_in_when_the_reason_is_gone() -> None:
    rig = Rig()
    rig.claim(DD, "LED1")
    rig.store.types["LED1"] = PartType("LED1", "lamp")
    assert rig.claim(DD, "LED1").refusal is Refusal.WRONG_ROBOT
    rig.store.slot_list.append(Slot("lamp", "LED1"))
    rig.inventory.reload(rig.now)
    assert rig.claim(DD, "LED1").lease
    assert rig.changes(DD) == ["new", "checking", "refused", "checking", "refused", "checking", "active"]


def test_a_claim_without_a_session_is_dropped_and_counted() -> None:
    rig = Rig()
    rig.join(AA)
    rig.leave(AA)
    rig._open.add(AA)
    assert rig.claim(AA, "ABCD") == Verdict()
    assert rig.inventory.dropped == {"claim of a client without a session": 1}


def test_leases_are_unguessable_numbers_and_never_zero() -> None:
    store = MemoryStore(types=(PartType("N", "n"),), slots=tuple(Slot(f"s{n}", "N") for n in range(200)))
    rig = Rig(store)
    leases = [rig.claim(key, "N", name=f"s{key - 1}").lease for key in range(1, 201)]
    assert len(set(leases)) == 200
    assert 0 not in leases
    assert max(leases) > 1 << 31


def test_plug_in_to_active_is_measured_from_the_session_on() -> None:
    rig = Rig()
    rig.join(AA)
    rig.now += 0.125
    rig.claim(AA, "ABCD")
    assert rig.part(AA).plug_in_to_active_ms == pytest.approx(125.0)


def test_plug_in_to_active_is_measured_from_the_plug_where_the_link_has_seen_it() -> None:
    rig = Rig()
    rig.join(AA, plugged_in_at=rig.now - 0.5)
    rig.claim(AA, "ABCD")
    assert rig.part(AA).plug_in_to_active_ms == pytest.approx(500.0)


# Heartbeats and life


def test_life_status_goes_3_2_1_0_and_every_beat_sets_it_to_3() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    lives = []
    for _ in range(3):
        lives.append(rig.part(AA).life)
        rig.run(2.0)
    assert lives == [3, 2, 1]
    assert rig.part(AA).life == 0
    rig.claim(AA, "ABCD")
    rig.run(2.0)
    rig.beat(AA)
    assert rig.part(AA).life == 3


def test_a_part_that_beats_is_never_delisted() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.run(120.0, AA)
    assert rig.state(AA) is PartState.ACTIVE
    assert rig.part(AA).beats == 120
    assert rig.changes(AA) == ["new", "checking", "active"]


def test_a_missed_beat_makes_a_part_late_and_the_next_one_active_again() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.run(1.5)
    assert rig.state(AA) is PartState.ACTIVE
    rig.run(0.5)
    assert rig.state(AA) is PartState.LATE
    assert rig.part(AA).reason == "no beat for 2.0 s"
    rig.beat(AA)
    assert rig.state(AA) is PartState.ACTIVE
    assert rig.part(AA).reason == "heard again after 2.0 s"


@given(st.floats(0.0, 4.0))
@settings(max_examples=tries(60, 2000), deadline=None)
def test_silent_part_is_delisted_between_4_and_6_s_after_its_last_beat(phase: float) -> None:
    rig = Rig()
    rig.run(phase)
    rig.claim(AA, "ABCD")
    rig.run(3.0, AA)
    last_beat = rig.now
    rig.run(6.0)
    lost = rig.events[-1]
    assert (lost.from_state, lost.to_state) == (PartState.LATE, PartState.LOST)
    assert 4.0 - 1e-6 <= lost.at - last_beat <= 6.0 + 1e-6
    assert lost.reason.endswith("life status 0")


def test_the_fast_preset_delists_within_1_5_s() -> None:
    rig = Rig(timing=FAST_TIMING)
    rig.claim(AA, "ABCD")
    rig.run(1.0, AA)
    last_beat = rig.now
    rig.run(1.5)
    assert rig.state(AA) is PartState.LOST
    assert 1.0 <= rig.events[-1].at - last_beat <= 1.5


def test_a_delisted_part_has_no_lease_and_no_rights_and_comes_back_through_a_claim() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.run(6.0)
    assert rig.inventory.configuration_of(AA) is None
    rig.now += 10.0
    assert rig.beat(AA) == 0
    rig.now += 0.25
    assert rig.claim(AA, "ABCD").lease
    assert rig.inventory.configuration_of(AA) == configuration("AA")
    assert rig.changes(AA) == ["new", "checking", "active", "late", "lost", "checking", "active"]
    assert rig.part(AA).plug_in_to_active_ms == pytest.approx(250.0)


def test_a_part_that_comes_back_in_a_new_session_is_one_line_with_its_history() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH", name="BB", serial=2)
    rig.run(6.0)
    rig.leave(BB, "silent", politely=False)
    rig.claim(DD, "EFGH", name="BB", serial=2)
    (part,) = rig.inventory.view(rig.now)
    assert (part.state, part.slot, part.client_key) == (PartState.ACTIVE, "BB", DD)
    why = "\n".join(rig.inventory.why("BB", rig.now))
    assert "life status 0" in why
    assert "same UID as before: back in its slot BB" in why


def test_our_own_delay_delists_nobody() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.now += 60.0
    rig.inventory.handle_timer(rig.now)
    assert rig.state(AA) is PartState.ACTIVE, "nor is it late: its beats may not have been read yet"
    assert rig.inventory.timer() == rig.now + 0.5
    assert rig.beat(AA) == 1
    assert rig.state(AA) is PartState.ACTIVE


def test_a_beat_with_a_wrong_lease_or_from_another_session_is_worthless() -> None:
    rig = Rig()
    lease = rig.claim(AA, "ABCD").lease
    rig.join(DD)
    assert rig.inventory.beat(lease, DD, rig.now) == 0
    assert rig.inventory.beat(lease ^ 1, AA, rig.now) == 0
    assert rig.inventory.beat(0, AA, rig.now) == 0
    assert rig.inventory.dropped == {"beat with an unknown lease": 3}
    assert rig.part(AA).beats == 0


# Leaving


def test_a_polite_goodbye_is_noticed_at_once() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.leave(AA)
    (part,) = rig.inventory.view(rig.now)
    assert (part.state, part.reason, part.life) == (PartState.LEFT, "session deleted", 0)
    assert rig.inventory.configuration_of(AA) is None
    assert rig.claim(DD, "ABCD").lease


@pytest.mark.parametrize(
    ("number", "state", "reason"),
    [
        ("ABCD", PartState.LOST, "gone: unplugged"),
        ("NOPE", PartState.LEFT, "gone: unplugged; it was refused: part number NOPE is not in the library"),
    ],
)
def test_a_part_that_vanishes_is_lost_if_it_had_something_to_lose(number: str, state: PartState, reason: str) -> None:
    rig = Rig()
    rig.claim(AA, number)
    rig.leave(AA, "gone: unplugged", politely=False)
    assert rig.events[-1].to_state is state
    assert rig.events[-1].reason == reason


def test_what_a_part_has_said_of_its_hardware_outlives_its_goodbye_and_its_silence() -> None:
    for leaves in (True, False):
        rig = Rig()
        lease = rig.claim(AA, "ABCD").lease
        record = rig.inventory.with_lease(lease, AA)
        assert record is not None
        for piece in trouble_pieces(lease, "its chip does not answer"):
            record.take_piece(piece.place, piece.text)
        if leaves:
            rig.leave(AA)
        else:
            rig.run(60.0)
        assert rig.events[-1].to_state is (PartState.LEFT if leaves else PartState.LOST)
        assert rig.events[-1].reason.endswith("; it said: its chip does not answer")


def test_a_session_that_never_claimed_leaves_no_line_behind() -> None:
    rig = Rig()
    rig.join(AA)
    rig.leave(AA)
    assert rig.inventory.view(rig.now) == []
    assert rig.changes(AA) == ["new", "left"]


def test_the_end_of_an_unknown_session_is_nothing() -> None:
    rig = Rig()
    rig.leave(AA)
    rig.join(BB, quiet=True)
    rig.leave(BB)
    assert rig.events == []


def test_the_end_of_a_delisted_parts_session_is_no_further_change() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.run(6.0)
    rig.leave(AA, "silent", politely=False)
    assert rig.events[-1].to_state is PartState.LOST


def test_only_so_many_parts_that_are_gone_are_shown() -> None:
    rig = Rig()
    for key in range(1, 10):
        rig.claim(key, "ABCD")
        rig.leave(key)
    assert [part.client_key for part in rig.inventory.view(rig.now)] == [6, 7, 8, 9]


# Rights, configuration, changes by people


def test_rights_are_told_when_a_part_becomes_active_and_when_it_ends() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    assert rig.rights == [AA]
    rig.run(6.0)
    assert rig.rights == [AA, AA]
    rig.claim(DD, "NOPE")
    assert rig.rights == [AA, AA]


def test_a_late_part_keeps_its_rights() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.run(2.5)
    assert rig.state(AA) is PartState.LATE
    assert rig.inventory.configuration_of(AA) is not None
    assert rig.rights == [AA]


def test_the_configuration_is_given_to_the_holder_of_the_lease_only() -> None:
    rig = Rig()
    lease = rig.claim(AA, "ABCD").lease
    assert rig.inventory.configuration_request(lease, AA) == configuration("AA")
    assert rig.inventory.configuration_request(lease, DD) is None
    assert rig.inventory.dropped == {"request for a configuration with an unknown lease": 1}


def test_a_changed_configuration_shows_in_the_next_beat_and_renews_the_rights() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.store.configurations["AA"] = configuration("AA", version=7)
    assert rig.beat(AA) == 1
    rig.inventory.configuration_changed("AA")
    rig.inventory.configuration_changed("BB")
    assert rig.beat(AA) == 7
    assert rig.rights == [AA, AA]


def test_beats_never_touch_the_store() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.inventory._store = rig.inventory._admission._store = MemoryStore()
    for _ in range(10):
        assert rig.beat(AA) == 1


def test_a_part_whose_slot_is_removed_is_delisted_and_then_refused() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.claim(BB, "EFGH")
    rig.store.slot_list = [slot for slot in rig.store.slot_list if slot.name != "AA"]
    rig.inventory.reload(rig.now)
    assert (rig.state(AA), rig.state(BB)) == (PartState.LOST, PartState.ACTIVE)
    assert rig.part(AA).reason == "the robot has no slot AA any more"
    assert rig.claim(AA, "ABCD").refusal is Refusal.WRONG_ROBOT


def test_events_and_handlers_see_a_consistent_inventory() -> None:
    rig = Rig()
    seen: list[tuple[str, bool]] = []
    rig.inventory.on_event(
        lambda event: seen.append((event.to_state.value, rig.inventory.configuration_of(AA) is not None))
    )
    rig.claim(AA, "ABCD")
    rig.leave(AA)
    assert seen == [("new", False), ("checking", True), ("active", True), ("left", False)]


def test_a_part_that_dies_before_anybody_looked_is_late_first_and_then_lost() -> None:
    rig = Rig(timing=LifeTiming(beat_s=1.0, tick_s=1.7, life=2))
    rig.run(1.69)
    rig.claim(AA, "ABCD")
    rig.run(1.72)
    assert rig.changes(AA) == ["new", "checking", "active", "late", "lost"]
    assert rig.events[-2].at == rig.events[-1].at


def test_an_agent_that_brings_parts_is_not_shown_unless_it_has_shown_itself_as_a_part() -> None:
    rig = Rig(sample_store())
    rig.join(1)
    rig.inventory.is_no_part(1)
    assert rig.inventory.view(rig.now) == []
    rig.join(2)
    rig.claim(2, "ABCD", serial=2)
    rig.inventory.is_no_part(2)
    assert [part.slot for part in rig.inventory.view(rig.now)] == ["AA"]


def test_whatever_is_done_is_announced_before_it_returns() -> None:
    rig = Rig(sample_store(Slot("EE", "EFGH")))
    inventory, now = rig.inventory, rig.now

    def announced() -> list[str]:
        assert rig.events == rig.store.events
        assert len(rig.events) > len(seen), "something has happened"
        new = [event.reason for event in rig.events[len(seen) :]]
        seen.extend(new)
        return new

    seen: list[str] = []
    rig.join(AA)
    assert announced() == [f"a session was opened from peer {AA}"]
    inventory.profile_asked(AA, now)
    assert announced() == ["reads the robot's profile (step 1)"]
    assert inventory.member(AA) is None
    standing = inventory.standing_of(AA)
    assert standing is not None
    assert (standing.state, standing.lease, standing.configuration_version) == (PartState.CHECKING, 0, 0)
    rig.claim(AA, "ABCD")
    announced()
    assert inventory.member(AA) == (uid(AA), "AA")
    for count in (1, 2):
        inventory.sample_refused(AA, "its seal is wrong", now)
        assert inventory.dropped == {"sample without a good seal": count}
    assert announced() == ["a sample that says it is from this part was refused: its seal is wrong"]
    inventory.sample_refused(AA + 1, "there is no such session", now)
    rig.run(2.0)
    assert len(announced()) == 1
    rig.now += 0.125
    rig.beat(AA)
    assert announced() == ["heard again after 2.1 s"]
    rig.store.slot_list = [slot for slot in rig.store.slot_list if slot.name != "AA"]
    inventory.reload(rig.now)
    assert announced() == ["the robot has no slot AA any more"]
    assert inventory.member(AA) is None
    rig.store.blocks["ABCD"] = "burnt"
    assert (inventory.blocked(b"", "ABCD"), inventory.blocked(uid(AA), "EFGH")) == ("burnt", None)


@pytest.mark.parametrize("how", ["opened again", "ended"])
def test_a_seal_ends_with_its_session(how: str) -> None:
    rig = Rig()
    rig.join(AA)
    rig.join(BB)
    for key in (AA, BB):
        rig.inventory.seals.put(key, bytes(32))
    rig.join(AA) if how == "opened again" else rig.leave(AA)
    assert rig.inventory.seals.of(AA) is None
    assert rig.inventory.seals.of(BB) is not None
