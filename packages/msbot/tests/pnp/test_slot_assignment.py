"""Slots that are given away without a claim: spares that take over, and what people move (R61, R62)."""

from __future__ import annotations

import pytest

from msbot.config import PartType, Slot
from msbot.pnp import FAST_TIMING, Configuration, MemoryStore, PartState, Refusal, TakeOver, Verdict
from msbot_xrce.errors import LocalProtocolError, RegistryError
from tests.pnp.robot import Rig, configuration, sample_store, uid

AA, BB, CC, DD, EE = 0xAA, 0xBB, 0xCC, 0xDD, 0xEE


def with_spare(**more: object) -> tuple[Rig, list[TakeOver]]:
    """BB in its slot, DD standing by."""
    rig = Rig(**more)  # type: ignore[arg-type]
    taken: list[TakeOver] = []
    rig.inventory.on_take_over(taken.append)
    rig.claim(BB, "EFGH", name="BB")
    rig.claim(DD, "EFGH", name="DD")
    return rig, taken


def stand_by(rig: Rig, seconds: float, *beating: int, spare: int = DD) -> None:
    """Let time pass while the spare claims now and then, as parts do."""
    for _ in range(round(seconds / 0.5)):
        rig.run(0.5, *beating)
        if rig.state(spare) is PartState.STANDBY:
            rig.claim(spare, "EFGH", name="DD")


def test_the_spare_has_the_slot_in_the_tick_in_which_the_part_is_lost() -> None:
    rig, taken = with_spare()
    rig.rights.clear()
    stand_by(rig, 8.0)
    lost = next(event for event in rig.events if event.to_state is PartState.LOST)
    active = next(event for event in rig.events if event.client_key == DD and event.to_state is PartState.ACTIVE)
    assert active.at == lost.at
    assert active.from_state is PartState.STANDBY
    assert rig.inventory.configuration_of(DD) == configuration("BB")
    assert rig.rights == [BB, DD]
    (take_over,) = taken
    assert (take_over.slot, take_over.part, take_over.lost_part) == ("BB", "DD", "BB")
    assert (take_over.claim.uid, take_over.lost_uid) == (uid(DD), uid(BB))


def test_its_next_claim_gets_the_lease_it_has_been_given() -> None:
    rig, _ = with_spare()
    rig.leave(BB, "gone", politely=False)
    verdict = rig.claim(DD, "EFGH", name="DD")
    assert verdict.lease
    assert rig.beat(DD) == 1
    assert rig.changes(DD) == ["new", "checking", "standby", "active"]


@pytest.mark.parametrize("politely", [True, False])
def test_a_part_that_leaves_makes_room_at_once(politely: bool) -> None:
    rig, _ = with_spare()
    rig.leave(BB, "bye", politely=politely)
    assert rig.state(DD) is PartState.ACTIVE
    assert f"BB is {'left' if politely else 'lost'} (bye)" in rig.part(DD).reason


def test_with_the_fast_preset_it_is_half_a_second_after_the_loss_at_most() -> None:
    rig, _ = with_spare(timing=FAST_TIMING)
    stand_by(rig, 2.0)
    at = {event.to_state: event.at for event in rig.events if event.client_key in (BB, DD)}
    assert at[PartState.ACTIVE] - at[PartState.LOST] <= 0.5
    assert at[PartState.LOST] <= 100.0 + 1.5


def test_a_part_that_opens_its_session_again_keeps_its_slot_from_the_spare() -> None:
    rig, taken = with_spare()
    rig.join(BB)
    rig.claim(DD, "EFGH", name="DD")
    assert rig.claim(BB, "EFGH", name="BB").lease
    assert (rig.part(BB).slot, rig.state(DD), taken) == ("BB", PartState.STANDBY, [])


def test_a_part_that_restarts_in_a_new_session_gets_its_slot_and_not_the_spare() -> None:
    rig, taken = with_spare()
    rig.claim(CC, "EFGH", name="BB", serial=BB)
    stand_by(rig, 1.5)
    assert rig.claim(CC, "EFGH", name="BB", serial=BB).lease
    assert (rig.part(CC).slot, rig.state(DD), taken) == ("BB", PartState.STANDBY, [])


def test_who_was_there_before_comes_first_then_who_waits_longest() -> None:
    rig, _ = with_spare()
    rig.claim(EE, "EFGH", name="EE")
    rig.leave(BB)
    assert rig.part(DD).slot == "BB"
    rig.claim(BB, "EFGH", name="BB")  # back, and remembered
    rig.leave(DD)
    assert rig.part(BB).slot == "BB"
    assert rig.state(EE) is PartState.STANDBY


def test_who_has_not_claimed_lately_comes_last() -> None:
    rig, _ = with_spare()
    rig.run(3.5, BB)
    rig.claim(EE, "EFGH", name="EE")
    rig.leave(BB)
    assert rig.part(EE).slot == "BB"


def test_a_spare_of_another_kind_takes_nothing() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH", name="BB")
    rig.claim(AA, "ABCD", name="AA")
    rig.claim(DD, "ABCD", name="DD")
    rig.leave(BB)
    assert rig.state(DD) is PartState.STANDBY


def test_a_compatible_spare_takes_over() -> None:
    store = sample_store()
    store.types["EFGX"] = PartType("EFGX", "better switch", compatible_with=("EFGH",))
    rig = Rig(store)
    rig.claim(BB, "EFGH")
    rig.claim(DD, "EFGX")
    rig.leave(BB)
    assert rig.part(DD).slot == "BB"


def test_one_uid_in_two_sessions_that_stand_by_gets_one_slot() -> None:
    rig = Rig(sample_store(Slot("BB2", "EFGH")))
    rig.claim(AA, "EFGH", name="BB")
    rig.claim(BB, "EFGH", name="BB2")
    rig.claim(DD, "EFGH", serial=7)
    rig.claim(EE, "EFGH", serial=7)
    rig.leave(AA)
    rig.leave(BB)
    assert [rig.state(key).is_registered for key in (DD, EE)] == [False, True]


def test_a_slot_that_cannot_be_read_leaves_the_spare_waiting() -> None:
    class Failing(MemoryStore):
        broken = False

        def configuration(self, slot: str) -> Configuration:
            if self.broken:
                raise RegistryError("the disk is gone")
            return super().configuration(slot)

    good = sample_store()
    store = Failing(types=tuple(good.types.values()), slots=good.slots())
    rig, taken = with_spare(store=store)
    store.broken = True
    rig.leave(BB)
    assert (rig.state(DD), taken) == (PartState.STANDBY, [])
    store.broken = False
    assert rig.claim(DD, "EFGH", name="DD").lease


# What people move


def test_two_parts_change_their_slots_and_get_other_leases() -> None:
    rig = Rig(sample_store(Slot("BB2", "EFGH")))
    rig.claim(BB, "EFGH", name="BB")
    rig.claim(DD, "EFGH", name="BB2")
    old = dict(rig.leases)
    rig.inventory.rearrange({BB: "BB2", DD: "BB"}, rig.now, "ann swapped them")
    assert (rig.part(BB).slot, rig.part(DD).slot) == ("BB2", "BB")
    assert rig.changes(BB)[-2:] == ["standby", "active"]
    assert rig.beat(BB) == 0  # the old lease is void
    rig.leases[BB] = rig.claim(BB, "EFGH", name="BB").lease
    assert rig.leases[BB] not in (0, old[BB])
    assert rig.beat(BB) == 1
    assert rig.store.remembered[uid(BB)] == "BB2"


def test_who_is_in_the_way_stands_by_and_does_not_slip_back() -> None:
    rig, _ = with_spare()
    rig.inventory.rearrange({DD: "BB"}, rig.now, "ann swapped them")
    assert (rig.part(DD).slot, rig.state(BB)) == ("BB", PartState.STANDBY)
    assert rig.part(BB).reason == "was in slot BB: ann swapped them"
    assert rig.claim(BB, "EFGH", name="BB") == Verdict(refusal=Refusal.NO_SLOT)
    rig.leave(DD)  # but it is a spare like any other
    assert rig.part(BB).slot == "BB"


def test_a_part_that_was_taken_out_does_not_get_that_slot_by_itself() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH", name="BB")
    rig.inventory.rearrange({BB: None}, rig.now, "ann released slot BB")
    assert rig.claim(BB, "EFGH", name="BB").refusal is Refusal.NO_SLOT
    assert rig.part(BB).reason == (
        "a person took it out of slot BB, and no other is free: adopt it, or plug it in again"
    )
    rig.inventory.rearrange({BB: "BB"}, rig.now, "ann adopted it")
    assert rig.part(BB).slot == "BB"


def test_a_part_that_was_taken_out_gets_another_slot_that_fits() -> None:
    rig = Rig(sample_store(Slot("BB2", "EFGH")))
    rig.claim(BB, "EFGH", name="BB")
    rig.inventory.rearrange({BB: None}, rig.now, "ann released slot BB")
    rig.claim(BB, "EFGH", name="BB")
    assert rig.part(BB).slot == "BB2"
    assert "a person took this part out of it" in "\n".join(rig.inventory.why("BB", rig.now))


def test_the_bar_is_gone_with_the_session() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH", name="BB")
    rig.inventory.rearrange({BB: None}, rig.now, "ann released slot BB")
    rig.leave(BB)
    rig.claim(CC, "EFGH", name="BB", serial=BB)
    assert rig.part(CC).slot == "BB"


def test_a_refused_stranger_can_be_put_into_a_slot() -> None:
    rig = Rig()
    rig.claim(DD, "NOPE")
    rig.inventory.rearrange({DD: "CC"}, rig.now, "ann adopted it")
    assert (rig.part(DD).slot, rig.state(DD)) == ("CC", PartState.ACTIVE)
    assert rig.changes(DD) == ["new", "checking", "refused", "checking", "active"]
    assert rig.claim(DD, "NOPE").lease


def test_putting_a_part_where_it_is_changes_nothing() -> None:
    rig, _ = with_spare()
    before = list(rig.events)
    rig.inventory.rearrange({BB: "BB"}, rig.now, "ann is confused")
    assert rig.events == before
    assert rig.beat(BB) == 1


@pytest.mark.parametrize(
    ("moves", "words"),
    [
        ({EE: "BB"}, "the part of client 000000EE is not there"),
        ({CC: "BB"}, "is new"),
        ({BB: "XX"}, "there is no slot XX"),
    ],
)
def test_a_move_that_cannot_be_made_changes_nothing(moves: dict[int, str | None], words: str) -> None:
    rig, _ = with_spare()
    rig.join(CC)
    before = list(rig.events)
    with pytest.raises(LocalProtocolError, match=words):
        rig.inventory.rearrange({DD: "CC", **moves}, rig.now, "ann")
    assert rig.events == before


# Blocks


def test_a_part_that_is_blocked_is_put_out_and_the_spare_comes_in() -> None:
    rig, _ = with_spare()
    rig.store.blocks[uid(BB)] = "too loud"
    rig.inventory.blocks_changed(rig.now)
    assert (rig.state(BB), rig.part(BB).refusal, rig.part(DD).slot) == (PartState.REFUSED, Refusal.BLOCKED, "BB")
    assert rig.beat(BB) == 0
    assert rig.claim(BB, "EFGH", name="BB").refusal is Refusal.BLOCKED


def test_a_blocked_number_takes_all_of_its_kind_out() -> None:
    rig, _ = with_spare()
    rig.claim(AA, "ABCD")
    rig.store.blocks["EFGH"] = "recalled"
    rig.inventory.blocks_changed(rig.now)
    assert [rig.state(key).value for key in (AA, BB, DD)] == ["active", "refused", "refused"]
    rig.store.blocks.clear()
    assert rig.claim(BB, "EFGH", name="BB").lease


def test_what_inventory_says_of_its_slots() -> None:
    rig, _ = with_spare()
    inventory = rig.inventory
    assert inventory.slots.names() == ("AA", "BB", "CC")
    assert (inventory.slots.number_of("BB"), inventory.slots.number_of("XX")) == ("EFGH", "")
    asked = (("EFGH", "BB"), ("ABCD", "BB"), ("EFGH", "XX"))
    assert [inventory.slots.fits(number, slot) for number, slot in asked] == [True, False, False]
    holder = inventory.holder("BB", rig.now)
    assert holder is not None
    assert holder.client_key == BB
    assert inventory.holder("AA", rig.now) is None
    assert [info.client_key for info in inventory.find("efgh", rig.now)] == [BB, DD]
    assert inventory.blocked(uid(1), "EFGH") is None


def test_a_spare_of_the_thesis_own_programs_takes_over_and_learns_it_from_its_next_request() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH", layout="compat")
    assert rig.claim(DD, "EFGH", layout="compat").refusal is Refusal.NO_SLOT
    rig.leave(BB)
    assert rig.part(DD).slot == "BB"
    assert rig.claim(DD, "EFGH", layout="compat").lease
    assert rig.inventory.configuration_of(DD) == configuration("BB")


def test_free_slots_are_those_that_fit_or_all() -> None:
    rig = Rig(sample_store(Slot("BB2", "EFGH")))
    rig.claim(BB, "EFGH", name="BB")
    assert rig.inventory.slots.free_slots("EFGH") == ["BB2"]
    assert rig.inventory.slots.free_slots() == ["AA", "CC", "BB2"]
    assert rig.inventory.slots.free_slots("NOPE") == []


def test_one_uid_never_gets_two_slots() -> None:
    rig = Rig(sample_store(Slot("BB2", "EFGH")))
    for key in (AA, CC):
        rig.claim(key, "EFGH", name="XX", serial=7)  # both stand by: two slots fit
    rig.inventory.rearrange({AA: "BB"}, rig.now, "ann")
    with pytest.raises(LocalProtocolError, match="the UID of XX would be in two slots"):
        rig.inventory.rearrange({CC: "BB2"}, rig.now, "ann")
    rig.inventory.rearrange({CC: "BB"}, rig.now, "ann")  # in its place is another matter
    assert (rig.part(CC).slot, rig.state(AA)) == ("BB", PartState.STANDBY)


class Unreadable(MemoryStore):
    """Some configurations cannot be read."""

    broken: frozenset[str] = frozenset()

    def configuration(self, slot: str) -> Configuration:
        if slot in self.broken:
            raise RegistryError("the disk is gone")
        return super().configuration(slot)


def test_of_two_slots_that_fall_free_at_once_each_finds_its_spare_or_waits_for_a_claim() -> None:
    plain = sample_store()
    store = Unreadable(
        types=tuple(plain.types.values()),
        slots=plain.slots(),
        configurations=tuple(plain.configurations.values()),
    )
    rig = Rig(store)
    taken: list[TakeOver] = []
    rig.inventory.on_take_over(taken.append)
    for key, number in ((AA, "ABCD"), (BB, "EFGH"), (CC, "WXYZ")):
        rig.claim(key, number)
    spares = ((1, "ABCD"), (2, "WXYZ"), (3, "EFGH"))  # in the order in which they wait
    for key, number in spares:
        rig.run(0.25, AA, BB, CC)
        rig.claim(key, number)
    store.broken = frozenset({"CC"})
    for _ in range(12):
        rig.run(0.5, AA)
        rig.beat(AA)
        if taken:
            break
        for key, number in spares:
            rig.claim(key, number)
    assert {rig.state(BB), rig.state(CC)} == {PartState.LOST}
    assert [(one.slot, one.part, one.lost_uid) for one in taken] == [("BB", "BB", uid(BB))]
    assert [rig.part(key).slot for key, _ in spares] == [None, None, "BB"]
    assert store.remembered[uid(3)] == "BB"
    store.broken = frozenset()
    rig.run(0.5, AA, 3)
    assert rig.state(2) is PartState.STANDBY, "its next claim brings it in"
    assert rig.claim(2, "WXYZ").lease
    assert (rig.part(2).slot, len(taken)) == ("CC", 1)


def test_a_part_that_is_where_it_shall_be_does_not_keep_others_from_being_moved() -> None:
    rig = Rig(sample_store(Slot("DD", "EFGH")))
    rig.claim(AA, "ABCD")
    rig.claim(BB, "EFGH", name="BB")
    lease = rig.leases[AA]
    rig.inventory.rearrange({AA: "AA", BB: "DD"}, rig.now, "so it shall be")
    assert (rig.part(AA).slot, rig.part(BB).slot) == ("AA", "DD")
    assert rig.inventory.beat(lease, AA, rig.now) == 1


@pytest.mark.parametrize("over", [0.0, 0.125])
def test_who_claimed_3_s_ago_is_still_surely_there(over: float) -> None:
    rig = Rig()
    rig.claim(BB, "EFGH")
    rig.claim(1, "EFGH")
    rig.run(1.0, BB)
    rig.claim(2, "EFGH")
    rig.run(1.0 + over, BB)
    rig.claim(2, "EFGH")
    rig.run(1.0, BB)
    rig.leave(BB, "bye")
    assert rig.part(2 if over else 1).slot == "BB", "the longest waiting of those who are surely there"
