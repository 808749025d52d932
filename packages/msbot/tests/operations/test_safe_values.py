"""A slot's safe value in a running robot: applied, obeyed on STOP and by a spare, undone."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.operations.stage import Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")
PLACE = 'name = "BB"\npart = "EFGH"\n'


@pytest.mark.promise("STOP brings a port to the safe value that the blueprint states for its slot")
def test_it_changes_while_the_robot_runs_and_is_undone(tmp_path: Path) -> None:
    async def stopped(stage: Stage, name: str) -> list[str]:
        await stage.do.stop(who="ann")
        await asyncio.sleep(1.0)
        found = list(stage.heard[name])
        await stage.do.go(who="ann")
        await asyncio.sleep(1.0)
        stage.heard[name].clear()
        return found

    async def scene(stage: Stage) -> None:
        path = tmp_path / "robot.toml"
        text = path.read_text()
        assert text.count(PLACE) == 1
        wanted = text.replace(PLACE, f'{PLACE}safe.in = {{ message = "from the blueprint" }}\n')
        assert await stopped(stage, "BB") == []
        path.write_text(wanted)
        done = await stage.do.apply(str(path), [str(tmp_path / "library")], who="ann")
        await asyncio.sleep(1.0)
        assert await stopped(stage, "BB") == ["from the blueprint"]
        stage.plug("DD", "EFGH")
        await asyncio.sleep(1.0)
        stage.pull("BB")
        await asyncio.sleep(8.0)
        assert stage.slot("DD") == "BB"
        assert await stopped(stage, "DD") == ["from the blueprint"]
        await stage.do.undo(done.edit_id, who="ann")
        await asyncio.sleep(1.0)
        assert await stopped(stage, "DD") == []

    play(tmp_path, scene, parts=RING)


def test_a_port_that_is_let_go_gets_it(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.publish("BB.in", ["1", "by hand"], who="ann")
        await asyncio.sleep(1.0)
        await stage.do.let_go("BB.in", who="ann")
        await asyncio.sleep(1.0)
        assert stage.heard["BB"][-1] == "from the blueprint"

    play(tmp_path, scene, (PLACE, f'{PLACE}safe.in = {{ message = "from the blueprint" }}\n'), parts=RING)
