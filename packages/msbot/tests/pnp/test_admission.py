"""From a claim to a verdict: restarts, reconnections, duplicates, spares (R58, R62, T10)."""

from __future__ import annotations

import pytest

from msbot.config import PartType, Slot
from msbot.pnp import FAST_TIMING, Claim, MemoryStore, PartState, Refusal, Verdict
from msbot.pnp.slot_matching import Match
from msbot_xrce.errors import RegistryError
from tests.pnp.robot import Rig, configuration, sample_store, uid

AA, BB, CC, DD = 0xAAAAAAAA, 0xBBBBBBBB, 0xCCCCCCCC, 0xDDDDDDDD


# Two sessions, one UID


def test_the_second_device_with_a_uid_is_refused_when_the_first_one_still_beats() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="AA", serial=1)
    assert rig.claim(DD, "ABCD", name="copy", serial=1) == Verdict()
    assert rig.state(DD) is PartState.CHECKING
    rig.run(1.0, AA)
    assert rig.claim(DD, "ABCD", name="copy", serial=1).refusal is Refusal.DUPLICATE
    assert (rig.state(AA), rig.state(DD)) == (PartState.ACTIVE, PartState.REFUSED)


def test_a_duplicate_and_its_original_are_both_shown() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="AA", serial=1)
    rig.claim(DD, "ABCD", name="copy", serial=1)
    rig.run(1.0, AA)
    for _ in range(3):
        rig.claim(DD, "ABCD", name="copy", serial=1)
    original, copy = rig.part(AA), rig.part(DD)
    assert original.duplicates == (f"peer {DD}",)
    assert copy.reason == f"another part with the same UID is active: AA in slot AA, from peer {AA}"
    assert copy.refused_claims == 3
    assert f"The same UID was shown, and refused, at peer {DD}." in rig.inventory.why("AA", rig.now)
    evidence = dict(rig.events[-1].evidence)
    assert evidence["same UID"] == f"AA holds slot AA from peer {AA}"
    assert evidence["old session"] == "gave a sign of life 1.00 s after the claim"


def test_a_restarted_part_replaces_its_dead_session_after_one_and_a_half_beats() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="AA", serial=1)
    rig.run(3.0, AA)
    began = rig.now
    while not rig.claim(DD, "ABCD", name="AA", serial=1).lease:
        rig.run(0.5)
    assert rig.now - began == pytest.approx(1.5)
    (part,) = rig.inventory.view(rig.now)
    assert (part.client_key, part.slot, part.state, part.beats) == (DD, "AA", PartState.ACTIVE, 0)
    assert rig.changes(AA) == ["new", "checking", "active", "lost"]
    lost = next(event for event in rig.events if event.to_state is PartState.LOST)
    assert lost.reason == f"restarted: the same UID came back from peer {DD}"
    assert rig.rights == [AA, AA, DD]


def test_the_replaced_session_has_to_claim_anew_and_is_then_the_duplicate() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    while not rig.claim(DD, "ABCD", serial=1).lease:
        rig.run(0.5)
    assert rig.beat(AA) == 0
    assert rig.claim(AA, "ABCD", serial=1) == Verdict()
    rig.run(1.0, DD)
    assert rig.claim(AA, "ABCD", serial=1).refusal is Refusal.DUPLICATE


def test_a_duplicate_takes_the_place_when_the_original_is_delisted() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    rig.claim(DD, "ABCD", serial=1)
    rig.run(1.0, AA)
    assert rig.claim(DD, "ABCD", serial=1).refusal is Refusal.DUPLICATE
    rig.run(6.0)
    assert rig.claim(DD, "ABCD", serial=1).lease
    assert rig.state(DD) is PartState.ACTIVE


def test_a_contest_ends_at_once_when_the_old_session_ends() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    assert rig.claim(DD, "ABCD", serial=1) == Verdict()
    rig.leave(AA, "another client logged in from its address", politely=False)
    assert rig.claim(DD, "ABCD", serial=1).lease


def probed_contest() -> Rig:
    """Two sessions that show one client key and one UID: the link asks whether the first is there."""
    rig = Rig()
    rig.join(AA, client_key=AA, patience_s=0.2)
    assert rig.claim(AA, "ABCD", serial=1).lease
    rig.run(1.0, AA)
    rig.join(DD, client_key=AA, patience_s=0.2)
    assert rig.claim(DD, "ABCD", serial=1) == Verdict()
    return rig


def test_a_contest_that_is_probed_is_decided_by_itself() -> None:
    rig = probed_contest()
    assert rig.inventory.timer() <= rig.now + 0.2
    rig.run(0.3)
    assert [info.state for info in rig.inventory.view(rig.now)] == [PartState.ACTIVE]
    assert "lost" in rig.changes(AA)


@pytest.mark.parametrize("another", [False, True])
def test_a_newcomer_that_leaves_or_becomes_another_part_before_the_decision_takes_nobodys_place(another: bool) -> None:
    rig = probed_contest()
    if another:
        rig.claim(DD, "WXYZ", serial=7)
    else:
        rig.leave(DD)
    before = rig.part(AA).state
    rig.run(0.3)
    assert before is PartState.ACTIVE
    assert any(info.state is PartState.ACTIVE and info.slot == "AA" for info in rig.inventory.view(rig.now))
    assert not [event for event in rig.events if "restarted" in event.reason]


def test_each_contest_is_about_one_rival() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    rig.claim(DD, "ABCD", serial=1)
    rig.claim(CC, "ABCD", serial=1)
    rig.run(1.5)
    assert rig.claim(DD, "ABCD", serial=1).lease
    assert rig.claim(CC, "ABCD", serial=1) == Verdict()
    rig.run(1.5)
    assert rig.claim(CC, "ABCD", serial=1).lease
    assert [part.client_key for part in rig.inventory.view(rig.now)] == [CC]


def test_a_duplicate_that_says_it_is_another_part_is_judged_anew() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    rig.claim(BB, "EFGH", serial=2)
    rig.claim(DD, "ABCD", serial=1)
    rig.run(1.0, AA, BB)
    assert rig.claim(DD, "ABCD", serial=1).refusal is Refusal.DUPLICATE
    assert rig.claim(DD, "EFGH", serial=2) == Verdict()
    assert rig.claim(DD, "WXYZ", serial=3).lease


# The same session claims again


def test_a_claim_repeated_because_the_answer_was_lost_gets_the_same_lease() -> None:
    rig = Rig()
    first = rig.claim(AA, "ABCD", nonce=5)
    rig.run(2.0)
    assert rig.state(AA) is PartState.LATE
    assert rig.claim(AA, "ABCD", nonce=5) == first
    assert (rig.state(AA), rig.part(AA).life) == (PartState.ACTIVE, 3)


def test_a_part_restarted_within_its_session_replaces_itself_at_once() -> None:
    rig = Rig()
    first = rig.claim(AA, "ABCD", nonce=5).lease
    rig.run(3.0, AA)
    second = rig.claim(AA, "ABCD", nonce=6).lease
    assert second not in (0, first)
    assert rig.inventory.beat(first, AA, rig.now) == 0
    assert rig.part(AA).beats == 0
    assert rig.changes(AA) == ["new", "checking", "active"]


@pytest.mark.parametrize(("number", "serial"), [("EFGH", 1), ("ABCD", 2)])
def test_a_session_that_claims_for_another_part_gives_up_the_first(number: str, serial: int) -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    assert rig.claim(AA, number, serial=serial).lease
    left = next(event for event in rig.events if event.to_state is PartState.LEFT)
    assert left.reason == "its session claims for another part now"
    assert rig.inventory.view(rig.now)[-1].part_number == number


def test_a_refused_session_may_claim_for_another_part() -> None:
    rig = Rig()
    rig.claim(AA, "NOPE", serial=1)
    assert rig.claim(AA, "ABCD", serial=2).lease


def test_a_delisted_session_may_claim_for_another_part() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    rig.run(6.0)
    assert rig.claim(AA, "EFGH", serial=2).lease
    assert [part.state for part in rig.inventory.view(rig.now)] == [PartState.LOST, PartState.ACTIVE]


# The thesis' own programs (compat)


def test_every_request_of_an_original_program_registers_or_beats() -> None:
    rig = Rig()
    first = rig.claim(AA, "ABCD", name="ABCD-local", layout="compat")
    for _ in range(10):
        rig.run(1.0)
        assert rig.claim(AA, "ABCD", name="ABCD-local", layout="compat") == first
    part = rig.part(AA)
    assert (part.part, part.state, part.beats, part.life, part.uid) == ("ABCD-local", PartState.ACTIVE, 10, 3, b"")


def test_an_original_program_is_delisted_and_comes_back() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", layout="compat")
    rig.run(6.0)
    assert rig.state(AA) is PartState.LOST
    assert rig.claim(AA, "ABCD", layout="compat").lease
    rig.leave(AA)
    rig.join(AA)
    assert rig.claim(AA, "ABCD", layout="compat").lease


def test_two_original_programs_with_one_number_are_two_parts() -> None:
    rig = Rig()
    assert rig.claim(AA, "ABCD", layout="compat").lease
    assert rig.claim(DD, "ABCD", layout="compat").refusal is Refusal.NO_SLOT
    assert not rig.store.remembered


# Sessions that are opened again


def test_a_session_opened_again_is_without_rights_until_it_has_claimed_again() -> None:
    rig = Rig()
    old = rig.claim(AA, "ABCD").lease
    rig.now += 1.0
    rig.join(AA, "elsewhere")
    assert rig.state(AA) is PartState.CHECKING
    assert rig.inventory.configuration_of(AA) is None
    assert rig.inventory.beat(old, AA, rig.now) == 0
    rig.now += 0.5
    new = rig.claim(AA, "ABCD")
    assert new.lease not in (0, old)
    part = rig.part(AA)
    assert (part.state, part.address, part.plug_in_to_active_ms) == (PartState.ACTIVE, "elsewhere", 500.0)


def test_a_part_that_reconnects_finds_its_slot_held_for_it() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=1)
    rig.join(AA)
    assert rig.claim(DD, "ABCD", serial=2).refusal is Refusal.NO_SLOT
    assert rig.claim(AA, "ABCD", serial=1).lease


def test_a_part_that_reconnects_and_says_no_more_loses_its_slot() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.join(AA)
    rig.run(6.0)
    assert rig.state(AA) is PartState.LOST
    assert rig.claim(DD, "ABCD").lease


@pytest.mark.parametrize("number", ["ABCD", "NOPE"])
def test_a_lost_or_refused_part_that_opens_its_session_again_is_checked_again(number: str) -> None:
    rig = Rig()
    rig.claim(AA, number)
    rig.run(6.0)
    rig.join(AA)
    assert rig.state(AA) is PartState.CHECKING


def test_opening_a_session_twice_before_claiming_changes_nothing() -> None:
    rig = Rig()
    rig.join(AA)
    rig.join(AA)
    assert rig.changes(AA) == ["new"]


def test_the_robots_own_services_are_no_parts_until_they_claim() -> None:
    rig = Rig()
    rig.join(AA, quiet=True)
    rig.join(AA, quiet=True)
    assert rig.inventory.view(rig.now) == []
    assert rig.claim(AA, "ABCD").lease
    assert rig.changes(AA) == ["new", "checking", "active"]


# Standing by


def test_same_part_number_twice_the_second_stands_by_and_takes_over_within_one_tick() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH", name="BB")
    spare = rig.claim(DD, "EFGH", name="spare")
    assert spare == Verdict(refusal=Refusal.NO_SLOT)
    assert rig.state(DD) is PartState.STANDBY
    while rig.state(BB) is not PartState.LOST:
        rig.run(0.5)
        rig.claim(DD, "EFGH", name="spare")
    lost_at = rig.events[-1].at if rig.events[-1].to_state is PartState.LOST else rig.now
    rig.claim(DD, "EFGH", name="spare")
    part = rig.part(DD)
    assert (part.part, part.slot, part.state) == ("spare", "BB", PartState.ACTIVE)
    assert rig.now - lost_at <= rig.inventory.timing.tick_s
    assert rig.inventory.configuration_of(DD) == configuration("BB")


def test_the_slot_is_shown_with_the_part_that_holds_it_only() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH", name="BB", serial=2)
    rig.run(6.0)
    assert rig.part(BB).slot == "BB"
    rig.claim(DD, "EFGH", name="spare")
    assert (rig.part(BB).slot, rig.part(DD).slot) == (None, "BB")
    assert rig.claim(BB, "EFGH", name="BB", serial=2).refusal is Refusal.NO_SLOT
    assert rig.part(BB).slot is None
    assert rig.events[-1].slot is None
    rig.leave(DD)
    assert [event.slot for event in rig.events[-2:]] == ["BB", "BB"]  # one has left, the other is back
    assert (rig.part(BB).slot, rig.part(DD).slot) == ("BB", None)


def test_same_part_number_twice_with_two_slots_the_local_names_decide() -> None:
    store = sample_store(Slot("AA2", "ABCD"))
    rig = Rig(store)
    rig.claim(AA, "ABCD", name="AA2")
    rig.claim(DD, "ABCD", name="AA")
    assert (rig.part(AA).slot, rig.part(DD).slot) == ("AA2", "AA")


def test_standing_by_is_told_once_with_the_latest_reason() -> None:
    rig = Rig(sample_store(Slot("AA2", "ABCD")))
    rig.claim(DD, "ABCD", name="other")
    assert "2 free slots fit" in rig.part(DD).reason
    rig.claim(AA, "ABCD", name="AA")
    rig.claim(BB, "ABCD", name="AA2")
    rig.claim(DD, "ABCD", name="other")
    assert rig.part(DD).reason == "every fitting slot is taken"
    assert rig.changes(DD) == ["new", "checking", "standby"]


def test_a_spare_that_claims_no_more_is_lost() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.claim(DD, "ABCD")
    rig.run(6.0, AA)
    assert rig.state(DD) is PartState.STANDBY
    rig.run(1.0, AA)
    assert rig.state(DD) is PartState.LOST
    assert "has not claimed" in rig.part(DD).reason


def test_a_spare_is_not_lost_between_two_claims_with_the_fast_preset() -> None:
    rig = Rig(timing=FAST_TIMING)
    rig.claim(AA, "ABCD")
    for _ in range(5):
        rig.claim(DD, "ABCD")
        rig.run(2.0, AA)
    assert rig.state(DD) is PartState.STANDBY


def test_a_spare_that_vanishes_is_lost() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.claim(DD, "ABCD")
    rig.leave(DD, "gone", politely=False)
    assert rig.events[-1].to_state is PartState.LOST


# Odds and ends


def test_a_registry_that_fails_at_the_last_moment_refuses_the_claim() -> None:
    class Failing(MemoryStore):
        def remember(self, uid: bytes, slot: str, claim: object) -> None:
            raise RegistryError("the disk is full")

    good = sample_store()
    rig = Rig(Failing(types=tuple(good.types.values()), slots=good.slots()))
    assert rig.claim(AA, "ABCD").refusal is Refusal.NOT_READY
    assert rig.part(AA).reason == "the inventory cannot read its registry: the disk is full"
    assert rig.part(AA).slot is None


def test_the_uid_in_events_is_empty_for_parts_without_one() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", serial=0)
    assert rig.part(AA).uid == b""
    assert rig.part(AA).state is PartState.ACTIVE
    assert uid(0) not in rig.store.remembered


@pytest.mark.parametrize("known", [False, True])
def test_a_claim_that_is_turned_away_is_shown_with_its_uid_unless_another_part_has_it(known: bool) -> None:
    rig = Rig()
    if known:
        rig.claim(AA, "ABCD", serial=1)
    rig.join(DD)
    match = Match(PartState.REFUSED, "the proof is wrong", (), refusal=Refusal.REPLAYED)
    claim = Claim("ABCD", "DD", uid(1))
    assert rig.inventory.refuse(claim, DD, match, rig.now).refusal is Refusal.REPLAYED
    assert rig.part(DD).state is PartState.REFUSED
    ended = next(event for event in rig.events if event.client_key == DD and event.to_state is PartState.REFUSED)
    assert ended.identity == (b"" if known else uid(1))
    if known:
        assert rig.part(AA).state is PartState.ACTIVE


def test_a_claim_through_no_session_is_counted_and_stays_open() -> None:
    rig = Rig()
    match = Match(PartState.REFUSED, "the proof is wrong", (), refusal=Refusal.REPLAYED)
    assert rig.inventory.refuse(None, DD, match, rig.now) == Verdict()
    assert rig.inventory.dropped == {"claim of a client without a session": 1}
    assert rig.events == []


@pytest.mark.parametrize(
    ("number", "chosen", "slot"),
    [
        ("EFGH", "BB", None),  # held by another part
        ("EFGH", "DD", "DD"),
        ("EFGH", "no such", None),
        ("EFGH", None, None),
        ("NOPE", "DD", "DD"),
        ("LED1", "DD", "DD"),
        ("BLOCKED", "DD", None),  # no refusal that a newcomer is adopted for
    ],
)
def test_a_newcomer_that_would_be_turned_away_is_adopted_where_a_person_says(
    number: str, chosen: str | None, slot: str | None
) -> None:
    store = sample_store(Slot("DD", "OTHER"))
    store.types["LED1"] = PartType("LED1", "lamp")
    store.blocks["BLOCKED"] = "burnt"
    rig = Rig(store)
    rig.claim(BB, "EFGH")
    asked: list[tuple[str, Refusal | None]] = []

    def adopter(claim: Claim, match: Match, _: object) -> str | None:
        asked.append((claim.part_number, match.refusal))
        return chosen

    rig.inventory.set_adopter(adopter)
    verdict = rig.claim(DD, number)
    refusals = {"EFGH": Refusal.NO_SLOT, "NOPE": Refusal.UNKNOWN_PART, "LED1": Refusal.WRONG_ROBOT}
    assert asked == ([(number, refusals[number])] if number in refusals else [])
    assert (bool(verdict.lease), rig.part(DD).slot) == (slot is not None, slot)
    words = f"adopted: a person has said that the next newcomer belongs into slot {slot}"
    decided = [one for one in rig.events[-1].evidence if one[0] == "a person decided"]
    assert decided == ([("a person decided", words)] if slot else [])
    assert (rig.part(DD).reason == words) is (slot is not None)
    rig.claim(AA, "ABCD")
    assert rig.part(AA).slot == "AA", "who has a place of its own is nobody's to adopt"
    assert len(asked) == (number in refusals)


def test_claims_that_are_repeated_are_signs_of_life() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", nonce=5)
    for _ in range(10):
        rig.run(1.0)
        rig.claim(AA, "ABCD", nonce=5)
    assert (rig.changes(AA), rig.part(AA).beats, rig.part(AA).life) == (["new", "checking", "active"], 0, 3)


def test_what_a_session_leaves_behind_that_claims_for_ever_other_parts_is_bounded() -> None:
    rig = Rig()
    for serial in range(1, 20):
        rig.claim(AA, "ABCD" if serial % 2 else "NOPE", serial=serial)
    assert [part.state for part in rig.inventory.view(rig.now)][:-1] == [PartState.LEFT] * 4  # `keep_ended` of the rig
    for serial in range(1, 20):
        rig.claim(serial, "EFGH", serial=777)
        rig.run(2.0)
        rig.claim(serial, "EFGH", serial=777)
    assert len(rig.inventory.view(rig.now)) <= 4 + 2


@pytest.mark.parametrize("patience", [(0.0, 5.0), (5.0, 0.0), (0.0, 0.0)])
def test_two_sessions_with_one_key_are_only_probed_where_both_links_can_be(patience: tuple[float, float]) -> None:
    rig = Rig()
    for key, patience_s in zip((1, 2), patience, strict=True):
        rig.join(key, client_key=0xAB, patience_s=patience_s)
        rig.claim(key, "ABCD", serial=7)
    rig.run(1.25)
    assert rig.claim(2, "ABCD", serial=7) == Verdict()
    rig.run(0.5)
    assert rig.claim(2, "ABCD", serial=7).lease, "silent for one and a half beats"


def test_a_part_that_began_anew_and_is_turned_away_has_no_life_left() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD")
    rig.join(AA)
    rig.store.blocks["ABCD"] = "burnt"
    assert rig.claim(AA, "ABCD").refusal is Refusal.BLOCKED
    assert rig.part(AA).life == 0
    rig.run(8.0)
    assert rig.state(AA) is PartState.REFUSED


def test_the_longest_number_and_name_are_shown_whole() -> None:
    rig = Rig()
    rig.claim(AA, "N" * 254, name="L" * 254)
    rig.claim(BB, "N" * 5000, name="L" * 5000)
    assert (rig.part(AA).part_number, rig.part(AA).local_name) == ("N" * 254, "L" * 254)
    assert rig.part(AA).refusal is Refusal.UNKNOWN_PART
    assert rig.part(BB).refusal is Refusal.BAD_CLAIM
    assert len(rig.part(BB).part_number + rig.part(BB).local_name) < 520


def test_a_restart_in_a_new_session_makes_nobody_forgotten_who_has_gone() -> None:
    rig = Rig()
    for key in range(1, 5):  # as many as the rig keeps
        rig.claim(key, "EFGH")
        rig.leave(key, "bye")
    rig.claim(AA, "ABCD", serial=9)
    rig.claim(BB, "ABCD", serial=9)
    rig.run(2.0)
    assert rig.claim(BB, "ABCD", serial=9).lease
    assert [part.client_key for part in rig.inventory.view(rig.now)] == [1, 2, 3, 4, BB]
