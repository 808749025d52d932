"""The demo as the robot of a lesson: `msbot demo --lesson NAME`."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

from msbot.cli.robot_options import user_name
from msbot.config import write_sample
from msbot.operations.dispatch import RunningOperations
from msbot.pnp import PartState
from msbot_school.demo import DemoRobot
from msbot_school.lessons.lesson import Lesson
from msbot_school.lessons.lesson_desk import LessonDesk
from msbot_school.lessons.shelf import LessonShelf

PATIENCE_S = 10.0


def blueprint_for(sample: str, lesson: Lesson | None, folder: Path) -> Path:
    """The blueprint of a sample, written to that folder; or the one that a lesson names."""
    if lesson is not None and lesson.blueprint is not None:
        return lesson.blueprint
    path = folder / "robot.toml"
    write_sample(path, sample if lesson is None else lesson.robot)
    return path


def chosen_lesson(name: str | None, folders: Sequence[Path]) -> Lesson | None:
    """The lesson of that name; None: none is wanted."""
    return None if name is None else LessonShelf(folders).get(name)


def lesson_desk(operations: RunningOperations, folders: Sequence[Path], robot: DemoRobot, world: str) -> LessonDesk:
    """The lesson desk of a demo in a world, or in none."""
    return LessonDesk(operations, LessonShelf(folders), parts=robot, bus=robot.bus_driver, world=world)


async def start_lesson(desk: LessonDesk, lesson: Lesson | None, robot: DemoRobot, say: Callable[[str], None]) -> None:
    """Begin the lesson, if there is one, when all parts are in; at the latest after `PATIENCE_S`."""
    if lesson is not None:
        await robot.begun.wait()
        all_in = asyncio.Event()

        def look(_: object = None) -> None:
            if all(part.state == PartState.ACTIVE.value for part in robot.snapshot().parts if part.plugged):
                all_in.set()

        robot.on_event(look)
        look()
        with contextlib.suppress(TimeoutError):  # a lesson can begin without one of them
            await asyncio.wait_for(all_in.wait(), PATIENCE_S)
        say(await desk.begin(lesson.name, user_name()))
