"""Settings, wires, blocks, blueprints and undo, on a robot that runs."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.operations.stage import AA_IS_A_DIAL, Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")


def test_a_setting_reaches_its_part_at_once_and_its_origin_is_shown(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        (value,) = [value for value in stage.do.values("AA") if value.name == "period_s"]
        before = value.origin
        done = stage.do.set_value("aa", "period_s", "0.5", who="ann")
        await asyncio.sleep(0.1)
        assert stage.parts["AA"].settings["period_s"] == "0.5"
        (value,) = [value for value in stage.do.values("AA") if value.name == "period_s"]
        assert (value.value, value.origin, value.who) == (0.5, "hand", "ann")
        stage.do.reset_value("AA", "period_s", who="ann")
        await asyncio.sleep(0.1)
        (value,) = [value for value in stage.do.values("AA") if value.name == "period_s"]
        assert value.origin == before
        assert "is not set by hand" in stage.refusal(lambda: stage.do.reset_value("AA", "period_s", who="ann"))
        assert "has been changed since" in stage.refusal(lambda: stage.do.undo(done.edit_id, who="bob"))
        stage.do.undo(who="bob")
        await asyncio.sleep(0.1)
        assert stage.parts["AA"].settings["period_s"] == "0.5"

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL", "BB=EFGH", "CC=WXYZ"))


@pytest.mark.parametrize(
    ("slot", "name", "value", "words"),
    [
        ("AA", "perod_s", "1", "slot AA has no parameter 'perod_s'; it has"),
        ("AA", "period_s", "soon", "period_s: must be a number"),
        ("AA", "period_s", "-1", "it must be"),
        ("XX", "period_s", "1", "the robot has no slot 'XX'"),
    ],
)
def test_a_setting_that_makes_no_sense_changes_nothing(
    slot: str, name: str, value: str, words: str, tmp_path: Path
) -> None:
    async def scene(stage: Stage) -> None:
        assert words in stage.refusal(lambda: stage.do.set_value(slot, name, value, who="ann"))
        assert stage.do.edits() == []

    play(tmp_path, scene, AA_IS_A_DIAL)
