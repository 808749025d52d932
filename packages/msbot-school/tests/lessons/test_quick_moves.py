"""What moves between two looks of a lesson has moved."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot_school.faults.port_values import MOST_KEPT
from msbot_school.lessons.conditions import ConditionMemory, MovedBy
from msbot_school.lessons.robot_state import RunningRobotState
from tests.lessons.lesson_stage import LessonStage, lesson_scene


@pytest.mark.parametrize("pause_s", [0.06, 0.2])
def test_a_knob_that_is_turned_to_and_fro_between_two_looks_has_moved(pause_s: float, tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        state = RunningRobotState(stage.operations.faults.running, None)
        spans, memory = MovedBy("knob.level", 60.0), ConditionMemory()
        stage.turn("knob", "knob", 50.0)
        spans.holds(state, memory)  # from now on it listens
        await asyncio.sleep(1.0)
        assert not spans.holds(state, memory)
        for value in (5.0, 95.0, 50.0):
            stage.turn("knob", "knob", value)
            await asyncio.sleep(pause_s)
        await asyncio.sleep(0.1)
        assert spans.holds(state, memory)
        assert memory.least == pytest.approx(5, abs=1)
        assert memory.most == pytest.approx(95, abs=1)
        assert state.numbers_since("knob.level", memory.heard)[0] == []

    lesson_scene(tmp_path, scene)


def test_who_looks_for_the_first_time_sees_the_newest_number_and_who_looks_seldom_the_latest(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        state = RunningRobotState(stage.operations.faults.running, None)
        assert state.numbers_since("ear.level", None) == ([], 0)
        await asyncio.sleep(5.0)
        (newest,), heard = state.numbers_since("ear.level", None)
        assert newest == state.number("ear.level")
        assert heard >= 45
        await asyncio.sleep(60.0)
        values, later = state.numbers_since("ear.level", heard)
        assert later - heard > MOST_KEPT
        assert len(values) == MOST_KEPT
        assert values[-1] == state.number("ear.level")
        assert state.numbers_since("nobody.level", None) == ([], 0)

    lesson_scene(tmp_path, scene)
