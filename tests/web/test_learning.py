"""Lessons are read when somebody looks at them, or when the robot has settled, and never in the event loop."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

from msbot.lessons.lesson_desk import SETTLED_S, LessonDesk
from msbot.lessons.shelf import LessonShelf
from msbot.web.access.accounts import Accounts
from msbot.web.access.users import MemoryUsers
from msbot.web.learning import Learning
from tests.lessons.lesson_stage import LessonStage, lesson_scene


class WatchedShelf(LessonShelf):
    """Notes which threads read."""

    def __init__(self) -> None:
        super().__init__()
        self.read_by: list[threading.Thread] = []

    def refresh(self) -> None:
        self.read_by.append(threading.current_thread())
        super().refresh()


async def until_read(shelf: LessonShelf) -> None:
    while not shelf.is_read:  # noqa: ASYNC110 - nothing says so
        await asyncio.sleep(0.1)


def test_who_looks_before_they_are_read_has_them_read_at_once(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        shelf = WatchedShelf()
        learning = Learning(LessonDesk(stage.operations, shelf), None, Accounts(MemoryUsers(), clock=lambda: 0.0))
        assert learning.lessons() is None
        assert learning.lessons() is None
        await until_read(shelf)
        found = learning.lessons()
        assert found is not None
        assert len(found[0]) > 5
        assert threading.main_thread() not in shelf.read_by
        assert len(shelf.read_by) == 1

    lesson_scene(tmp_path, scene)


def test_they_are_read_when_the_robot_has_settled(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        shelf = WatchedShelf()
        running = asyncio.ensure_future(LessonDesk(stage.operations, shelf).run())
        await asyncio.sleep(SETTLED_S - 0.1)
        assert not shelf.read_by
        await until_read(shelf)
        running.cancel()
        assert threading.main_thread() not in shelf.read_by

    lesson_scene(tmp_path, scene)
