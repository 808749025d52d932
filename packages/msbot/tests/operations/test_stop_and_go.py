"""STOP reaches every part at once, holds for those that come later, and says how long it took."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

import pytest

from msbot.part import NotSafeYet
from msbot_xrce.errors import RegistryError
from tests.operations.stage import Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")


def test_stop_reaches_every_part_and_its_latency_is_measured(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert not stage.operations.stopping.status.stopped
        done = await stage.do.stop("hand in the gear", who="ann")
        assert done.words == "STOP: 3 parts are told to go to the safe state: hand in the gear"
        await asyncio.sleep(0.2)
        assert [stage.parts[name].stopped for name in ("AA", "BB", "CC")] == [True] * 3
        report = stage.operations.stopping.status
        assert (report.by, report.reason, report.told_count, report.silent) == ("ann", "hand in the gear", 3, ())
        assert len(report.confirmed) == 3
        assert report.latency_ms is not None
        assert report.latency_ms < 100

    play(tmp_path, scene, parts=RING)


def test_a_part_that_does_not_answer_is_counted_as_such(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.pull("BB")  # gone at once on this wire, so it is not waited for
        await asyncio.sleep(0.1)
        await stage.do.stop(who="ann")
        report = stage.operations.stopping.status
        assert (report.told_count, report.confirmed, report.latency_ms) == (2, (), None)
        assert len(report.silent) == 2
        await asyncio.sleep(0.2)
        assert len(stage.operations.stopping.status.confirmed) == 2

    play(tmp_path, scene, parts=RING)


@pytest.mark.promise("Only a part itself confirms STOP")
@pytest.mark.parametrize("deed", ["release", "swap", "block", "stand-in"])
def test_a_part_that_has_not_confirmed_is_named_until_go_also_when_its_slot_is_taken_away(
    deed: str, tmp_path: Path
) -> None:
    async def scene(stage: Stage) -> None:
        @stage.parts["BB"].safe_state
        def brake() -> None:
            raise NotSafeYet("it moves")

        await stage.do.stop(who="ann")
        await asyncio.sleep(0.2)
        assert stage.operations.stopping.status.silent == ("BB",)
        deeds = {
            "release": partial(stage.do.release, "BB"),
            "swap": partial(stage.do.swap, "BB", "DD"),
            "block": partial(stage.do.block, "BB", "it does not stop"),
            "stand-in": partial(stage.do.simulate, "BB", False),
        }
        await deeds[deed](who="ann")
        await asyncio.sleep(3.0)
        assert stage.operations.stopping.status.silent == ("BB",)
        await stage.do.go(who="ann")
        assert not stage.operations.stopping.status.silent

    play(tmp_path, scene, parts=(*RING, "DD=EFGH"))


def test_go_in_a_robot_without_active_parts_counts_none(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.stop(who="ann")
        assert (await stage.do.go(who="ann")).words == "STOP is over; no part was active"

    play(tmp_path, scene, parts=())


def test_stop_holds_for_parts_that_come_later_until_it_is_ended(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.stop(who="ann")
        stage.plug("CC", "WXYZ")
        await asyncio.sleep(2.0)
        assert stage.parts["CC"].state.value == "active"
        assert stage.parts["CC"].stopped
        assert (await stage.do.go(who="ann")).words.startswith("STOP is over: ")
        await asyncio.sleep(2.0)
        assert not any(part.stopped for part in stage.parts.values())
        assert not stage.operations.stopping.status.stopped
        assert await stage.refusal(stage.do.go(who="ann")) == "nobody said STOP: there is nothing to end"

    play(tmp_path, scene, parts=RING[:2])


def test_stop_is_noted_and_undo_passes_it_over(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.block("CC", "loud", who="ann")
        await stage.do.stop("fire", who="bob")
        await asyncio.sleep(0.1)
        await stage.do.go(who="bob")
        await asyncio.sleep(0.1)
        await asyncio.to_thread(stage.registry.storage.flush)
        edits = await stage.operations.undoing.read(50)
        assert [(edit.kind, edit.who) for edit in edits] == [("go", "bob"), ("stop", "bob"), ("block", "ann")]
        assert edits[1].words == "STOP by bob: fire"
        assert "is blocked: loud" in (await stage.do.undo(who="ann")).words
        assert "cannot be undone" in await stage.refusal(stage.do.undo(edits[1].id, who="ann"))

    play(tmp_path, scene, parts=RING)


def test_stop_works_while_the_database_cannot_be_written(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        def refuse(*_: object) -> None:
            raise RegistryError("the database robot.db has no room: the disk is full; delete something")

        stage.registry.storage.engine.connect = refuse  # type: ignore[method-assign, assignment]
        await stage.do.stop(who="ann")
        await asyncio.sleep(0.2)
        assert all(part.stopped for part in stage.parts.values())

    play(tmp_path, scene, parts=RING)


def test_a_part_shows_itself(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        shown = []
        stage.parts["BB"].on_identify(lambda: shown.append("BB"))
        assert (await stage.do.identify("BB", who="ann")).words == "BB is told to show itself"
        await asyncio.sleep(0.1)
        assert shown == ["BB"]
        stage.pull("AA")
        await asyncio.sleep(0.1)
        assert "AA is not plugged in" in await stage.refusal(stage.do.identify("AA", who="ann"))

    play(tmp_path, scene, parts=RING)


def test_the_journal_names_who_says_stop_while_that_of_another_holds(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.stop("a finger", who="ann")
        await stage.do.stop("another one", who="ben")
        assert stage.operations.stopping.status.by == "ann"
        assert stage.operations.stopping.status.also_by == ("ben",)
        await asyncio.to_thread(stage.registry.storage.flush)
        edits = await stage.operations.undoing.read(2)
        assert [(edit.words, edit.who) for edit in edits] == [
            ("STOP by ben: another one", "ben"),
            ("STOP by ann: a finger", "ann"),
        ]

    play(tmp_path, scene, parts=RING)
