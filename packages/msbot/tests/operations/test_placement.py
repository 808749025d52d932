"""Adopt, swap, release, the adoption window, take-over by spares, and undoing each."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.pnp import Configuration
from msbot_xrce.errors import RegistryError
from tests.operations.stage import Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")
RING_AND_SPARE = (*RING, "DD=EFGH")


def test_a_spare_takes_over_in_the_moment_when_the_part_is_lost(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert stage.state("DD") == "standby"
        stage.pull("BB")
        await asyncio.sleep(0.5)
        lost = next(event for event in stage.events if event.to_state.value == "lost")
        active = [event for event in stage.events if event.part == "DD"][-1]
        assert (active.slot, active.to_state.value, active.at) == ("BB", "active", lost.at)
        assert active.reason == "takes over slot BB: BB is lost (gone: closed)"
        assert stage.parts["DD"].slot == "BB"  # it was told, and has its configuration
        edit = (await stage.operations.undoing.read(50))[0]
        assert (edit.who, edit.words) == ("msbot", "the spare DD has taken over slot BB from BB")

    play(tmp_path, scene, parts=RING_AND_SPARE)


def test_a_take_over_is_undone_when_the_part_is_back_and_not_before(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.pull("BB")
        await asyncio.sleep(0.5)
        assert await stage.refusal(stage.do.undo(who="ann")) == (
            "the part that had slot BB before (UID 42422e2e2e2e2e2e) is not plugged in: plug it in, then undo"
        )
        assert stage.slot("DD") == "BB"
        stage.plug("BB", "EFGH")
        await asyncio.sleep(1.0)
        assert stage.state("BB") == "standby"
        done = await stage.do.undo(who="ann")
        assert done.words.endswith("the spare DD has taken over slot BB from BB")
        await asyncio.sleep(3.0)
        assert (stage.slot("BB"), stage.state("DD")) == ("BB", "standby")
        assert stage.parts["BB"].slot == "BB"
        assert (await stage.operations.undoing.read(50))[1].undone
        # and if it is lost once more, the spare is there again
        stage.pull("BB")
        await asyncio.sleep(0.5)
        assert stage.slot("DD") == "BB"

    play(tmp_path, scene, parts=RING_AND_SPARE)


def test_swap_with_a_spare_and_undo(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        done = await stage.do.swap("BB", "DD", who="ann")
        assert done.words == "DD takes slot BB in place of BB, which stands by"
        await asyncio.sleep(5.0)
        assert (stage.slot("DD"), stage.state("BB")) == ("BB", "standby")
        assert stage.parts["DD"].slot == "BB"
        assert any("ann swapped slot BB to DD" in event.reason for event in stage.events)
        await stage.do.undo(done.edit_id, who="bob")
        await asyncio.sleep(5.0)
        assert (stage.slot("BB"), stage.state("DD")) == ("BB", "standby")

    play(tmp_path, scene, parts=RING_AND_SPARE)


def test_two_parts_in_slots_change_places_and_fetch_the_other_slots_configuration(tmp_path: Path) -> None:
    two_of_a_kind = ('part = "WXYZ"', 'part = "EFGH"')

    async def scene(stage: Stage) -> None:
        await stage.do.adopt("BB", "BB", who="ann")
        await stage.do.adopt("CC", who="ann")
        await asyncio.sleep(1.0)
        done = await stage.do.swap("BB", "CC", who="ann")
        assert done.words == "CC takes slot BB in place of BB, which goes to slot CC"
        await asyncio.sleep(2.0)
        assert (stage.slot("BB"), stage.slot("CC")) == ("CC", "BB")
        assert (stage.parts["BB"].slot, stage.parts["CC"].slot) == ("CC", "BB")
        await stage.do.undo(who="ann")
        await asyncio.sleep(2.0)
        assert (stage.parts["BB"].slot, stage.parts["CC"].slot) == ("BB", "CC")

    play(tmp_path, scene, two_of_a_kind, parts=("AA=ABCD", "BB=EFGH", "CC=EFGH"))


def test_a_swap_that_does_not_fit_changes_nothing_and_says_what_would_do(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        words = await stage.refusal(stage.do.swap("BB", "CC", who="ann"))
        assert "CC is a part WXYZ, and slot BB takes EFGH" in words
        assert "msbot adopt --window" in words
        assert "BB is in slot BB already" in await stage.refusal(stage.do.swap("BB", "BB", who="ann"))
        assert "no slot 'BBB'; did you mean BB?" in await stage.refusal(stage.do.swap("BBB", "CC", who="ann"))
        assert "no part is known as 'ZZ'; there are AA, BB, CC" in await stage.refusal(
            stage.do.swap("BB", "ZZ", who="ann")
        )
        assert [stage.slot(name) for name in ("AA", "BB", "CC")] == ["AA", "BB", "CC"]
        assert await stage.operations.undoing.read(50) == []

    play(tmp_path, scene, parts=RING)


def test_release_lets_the_spare_in_and_the_part_does_not_slip_back(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.release("BB", who="ann")
        await asyncio.sleep(8.0)
        assert (stage.slot("DD"), stage.state("BB")) == ("BB", "standby")
        assert "is empty" not in stage.info("BB").reason

    play(tmp_path, scene, parts=RING_AND_SPARE)


def test_a_released_slot_stays_empty_until_somebody_adopts_the_part(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        done = await stage.do.release("bb", who="ann")
        assert done.words == "BB is released from slot BB"
        await asyncio.sleep(8.0)
        assert stage.state("BB") == "standby"
        assert stage.parts["BB"].state.value != "active"
        assert "a person took it out of slot BB" in stage.info("BB").reason
        assert "slot BB is empty" in await stage.refusal(stage.do.release("BB", who="ann"))
        assert (await stage.do.adopt("BB", who="ann")).words == "BB (EFGH) is adopted into slot BB"
        await asyncio.sleep(2.0)
        assert stage.parts["BB"].slot == "BB"
        assert stage.parts["BB"].state.value == "active"
        assert "is in slot BB already" in await stage.refusal(stage.do.adopt("BB", "BB", who="ann"))
        assert "is in slot BB already" in await stage.refusal(stage.do.adopt("BB", who="ann"))

    play(tmp_path, scene, parts=RING)


def test_a_released_part_that_is_plugged_in_anew_is_let_in(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.release("BB", who="ann")
        stage.pull("BB")
        await asyncio.sleep(1.0)
        stage.plug("BB", "EFGH")
        await asyncio.sleep(1.0)
        assert stage.slot("BB") == "BB"

    play(tmp_path, scene, parts=RING)


def test_a_part_that_fits_several_slots_is_adopted_into_the_one_a_person_names(tmp_path: Path) -> None:
    two_of_a_kind = ('part = "WXYZ"', 'part = "EFGH"')

    async def scene(stage: Stage) -> None:
        assert "2 free slots fit" in stage.info("XX").reason
        assert await stage.refusal(stage.do.adopt("XX", who="ann")) == (
            "XX could go into BB, CC: say which one with --slot"
        )
        words = await stage.refusal(stage.do.adopt("XX", "AA", who="ann"))
        assert words.startswith("slot AA is held by AA (ABCD")
        await stage.do.adopt("XX", "CC", who="ann")
        await asyncio.sleep(1.0)
        assert stage.parts["XX"].slot == "CC"
        stage.pull("XX")
        await asyncio.sleep(1.0)
        stage.plug("XX", "EFGH")  # and that is remembered
        await asyncio.sleep(1.0)
        assert stage.slot("XX") == "CC"

    play(tmp_path, scene, two_of_a_kind, parts=("AA=ABCD", "XX=EFGH"))


def test_a_part_of_a_known_kind_without_a_slot_is_told_how_to_get_one(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert await stage.refusal(stage.do.adopt("XX", who="ann")) == (
            "the robot has no slot for BUTTON: `msbot slot add NAME BUTTON` makes one; to let it into one of another "
            "kind, `msbot adopt --window 60`, then `msbot adopt XX --slot SLOT`"
        )
        await stage.do.window(60, who="ann")
        assert await stage.refusal(stage.do.adopt("XX", who="ann")) == (
            "XX could go into BB, CC: say which one with --slot"
        )
        await stage.do.adopt("XX", "CC", who="ann")
        await asyncio.sleep(1.0)
        assert stage.slot("XX") == "CC"

    play(tmp_path, scene, parts=("AA=ABCD", "XX=BUTTON"))


def test_a_stranger_needs_the_window_and_is_known_from_then_on(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert stage.state("XX") == "refused"
        assert "slot CC takes WXYZ" in await stage.refusal(stage.do.adopt("XX", "CC", who="ann"))
        assert stage.operations.placement.window_s == 0.0
        assert await stage.refusal(stage.do.adopt("XX", who="ann")) == (
            "the library has no part number NOPE: `msbot library add NOPE` begins a file for it; to let it in without "
            "one, `msbot adopt --window 60`, then `msbot adopt XX --slot SLOT`"
        )
        await stage.do.window(60, who="ann")
        await asyncio.sleep(1.0)
        assert stage.operations.placement.window_s == 59.0
        await stage.do.adopt("XX", who="ann")  # the one empty slot
        await stage.do.close_window(who="ann")
        await asyncio.sleep(2.0)
        assert (stage.slot("XX"), stage.parts["XX"].slot) == ("CC", "CC")
        stage.pull("XX")
        await asyncio.sleep(1.0)
        stage.plug("XX", "NOPE")
        await asyncio.sleep(1.0)
        assert stage.slot("XX") == "CC"
        assert stage.info("XX").reason == "a person has put this part into slot CC"
        await stage.do.undo(who="ann")
        await asyncio.sleep(3.0)
        assert stage.state("XX") == "refused"

    play(tmp_path, scene, parts=("AA=ABCD", "BB=EFGH", "XX=NOPE"))


def test_a_window_with_a_slot_takes_the_next_newcomer_and_closes(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert "slot BB is held by" in await stage.refusal(stage.do.window(60, "BB", who="ann"))
        assert "it must be 1 to 3600" in await stage.refusal(stage.do.window(0, who="ann"))
        await stage.do.window(60, "CC", who="ann")
        assert stage.operations.placement.window_slot == "CC"
        stage.plug("XX", "NOPE")
        await asyncio.sleep(1.0)
        stage.plug("YY", "NOPE")
        await asyncio.sleep(1.0)
        assert (stage.slot("XX"), stage.state("YY")) == ("CC", "refused")
        assert stage.operations.placement.window_s == 0.0
        edit = (await stage.operations.undoing.read(50))[0]
        assert (edit.who, edit.words) == ("ann", "XX (NOPE) is adopted into slot CC, as the next newcomer")

    play(tmp_path, scene, parts=("AA=ABCD", "BB=EFGH"))


def test_nobody_slips_in_when_the_window_has_closed_by_itself(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.window(5, "CC", who="ann")
        await asyncio.sleep(6.0)
        stage.plug("XX", "NOPE")
        await asyncio.sleep(1.0)
        assert stage.state("XX") == "refused"

    play(tmp_path, scene, parts=("AA=ABCD", "BB=EFGH"))


def test_a_part_that_is_gone_cannot_be_moved_and_the_reason_is_said(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.pull("BB")
        await asyncio.sleep(1.0)
        assert await stage.refusal(stage.do.adopt("BB", who="ann")) == ("BB is not plugged in: lost, gone: closed")

    play(tmp_path, scene, parts=RING)


def test_two_parts_of_one_name_are_told_apart_by_their_uids(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.plug("one", "EFGH", uid=0x11).local_name = "same"
        stage.plug("two", "EFGH", uid=0x22).local_name = "same"
        await asyncio.sleep(1.0)
        words = await stage.refusal(stage.do.swap("BB", "same", who="ann"))
        assert words.startswith("2 parts are known as 'same': name one by its UID or address: same (EFGH, UID 00")
        await stage.do.swap("BB", "0000000000000022", who="ann")
        await asyncio.sleep(1.0)
        assert stage.parts["two"].slot == "BB"

    play(tmp_path, scene, parts=RING)


def test_somebody_who_shows_its_uid_and_is_refused_does_not_keep_a_part_from_being_adopted(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.release("BB", who="ann")
        await asyncio.sleep(1.0)
        uid = stage.info("BB").uid
        stage.plug("liar", "NOPE", uid=int.from_bytes(uid, "big"))
        await asyncio.sleep(1.0)
        assert (stage.state("BB"), stage.state("liar")) == ("standby", "refused")
        await stage.do.adopt(uid.hex(), "BB", who="ann")
        assert stage.slot("BB") == "BB"

    play(tmp_path, scene, parts=RING)


def test_a_newcomer_whose_slot_cannot_be_read_is_turned_away_and_not_stored(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        def fail(_: str) -> Configuration:
            raise RegistryError("the disk is gone")

        await stage.do.window(60, "CC", who="ann")
        stage.master.inventory._store.configuration = fail  # type: ignore[method-assign, assignment]
        stage.plug("XX", "NOPE")
        await asyncio.sleep(0.3)
        assert stage.state("XX") == "refused"
        await asyncio.to_thread(stage.registry.storage.flush)
        assert [edit.kind for edit in await stage.operations.undoing.read(50)] == ["window"]
        assert "nothing to undo" in await stage.refusal(stage.do.undo(who="ann"))

    play(tmp_path, scene, parts=("AA=ABCD",))


def test_a_copied_uid_is_not_let_in_by_a_person_either(tmp_path: Path) -> None:
    two_of_a_kind = ('part = "WXYZ"', 'part = "EFGH"')

    async def scene(stage: Stage) -> None:
        stage.plug("X1", "EFGH", uid=7)
        stage.plug("X2", "EFGH", uid=7)
        await asyncio.sleep(1.0)
        await stage.do.adopt("X1", "BB", who="ann")
        words = await stage.refusal(stage.do.adopt("X2", "CC", who="ann"))
        assert words.startswith("X2 shows the UID of X1 (EFGH, UID 0000000000000007, in slot BB")

    play(tmp_path, scene, two_of_a_kind, parts=("AA=ABCD",))


@pytest.mark.parametrize("name", ["DD", "EE", "FF", "GG"])
def test_a_spare_on_a_bad_wire_works_within_a_tick(name: str, tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        spare = stage.plug(name, "EFGH", drop=0.3)
        await asyncio.sleep(8.0)
        assert stage.state(name) == "standby"
        stage.pull("BB")
        await asyncio.sleep(stage.master.inventory.timing.tick_s)
        assert (spare.slot, spare.state.value) == ("BB", "active")

    play(tmp_path, scene, parts=("BB=EFGH",))
