"""A part that is gone can be forgotten, while the robot runs and while it does not, and that can be undone."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.operations.dispatch import stored_operations
from msbot.registry import PartRecord, open_registry
from msbot_xrce.errors import ConfigError
from tests.operations.stage import Deeds, Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")
CC_UID = b"CC......"


def known(stage: Stage) -> dict[str, PartRecord]:
    registry, robot = stage.operations.placement._running.database()
    registry.storage.catch_up()
    return {one.name: one for one in registry.robots.parts(robot)}


def test_a_part_that_comes_again_is_a_new_one(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        refused = await stage.refusal(stage.do.forget_part("CC", who="ann"))
        assert refused.startswith("CC (WXYZ, UID 43432e2e2e2e2e2e, in slot CC, at ")
        assert refused.endswith(") is there (active): unplug it first")
        stage.pull("CC")
        await asyncio.sleep(1.0)
        first = known(stage)["CC"]
        done = await stage.do.forget_part("CC", who="ann")
        assert (done.words, done.edit_id is not None) == ("CC (WXYZ) is forgotten", True)
        assert "CC" not in known(stage)
        assert "CC" not in [info.part for info in stage.master.inventory.view(stage.now())]
        store = stage.master.inventory._store
        assert store.remembered_slot(CC_UID) is None
        assert "no part is known as 'CC'; seen so far: AA, BB" in await stage.refusal(
            stage.do.forget_part("CC", who="ann")
        )

        undone = await stage.do.undo(who="bob")
        assert known(stage)["CC"] == first
        assert store.remembered_slot(CC_UID) == "CC"
        await stage.do.undo(undone.edit_id, who="bob")  # and that can be undone, too
        assert "CC" not in known(stage)

        await asyncio.sleep(1.0)
        stage.plug("CC", "WXYZ")
        await asyncio.sleep(2.0)
        assert stage.slot("CC") == "CC"
        assert known(stage)["CC"].first_seen_ns > first.first_seen_ns

    play(tmp_path, scene, parts=RING)


def test_it_is_not_taken_back_over_a_part_that_has_come_since(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.pull("CC")
        await asyncio.sleep(1.0)
        done = await stage.do.forget_part("43432e2e2e2e2e2e", who="ann")
        stage.plug("CC", "WXYZ")
        await asyncio.sleep(2.0)
        known(stage)
        refused = await stage.refusal(stage.do.undo(done.edit_id, who="ann"))
        assert "cannot be undone: it has been changed since" in refused
        assert stage.slot("CC") == "CC"

    play(tmp_path, scene, parts=RING)


def test_it_is_forgotten_while_the_robot_does_not_run(tmp_path: Path) -> None:
    async def nothing(_stage: Stage) -> None:
        await asyncio.sleep(1.0)

    play(tmp_path, nothing, parts=RING)
    with open_registry(tmp_path / "robot.db") as registry:
        (robot,) = registry.robots.all()
        operations = stored_operations(registry, robot)
        do = Deeds(operations)

        async def act() -> None:
            assert (await do.forget_part("BB", who="ann")).words == "BB (EFGH) is forgotten"
            assert sorted(one.name for one in registry.robots.parts(robot)) == ["AA", "CC"]
            assert registry.robots.journal(50, "BB", robot=robot)  # the journal keeps its lines
            await do.undo(who="ann")
            assert sorted(one.name for one in registry.robots.parts(robot)) == ["AA", "BB", "CC"]
            with pytest.raises(ConfigError, match="no part is known as 'nobody'; seen so far: "):
                await do.forget_part("nobody", who="ann")

        asyncio.run(act())
