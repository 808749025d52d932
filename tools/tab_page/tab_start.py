"""Begins the robot of a tab; `worker.js` imports it in Pyodide, whose modules `js` and `pyodide` are JavaScript's."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import js
from pyodide.ffi import create_once_callable

from msbot.process.hosted_loop import HostedLoop
from msbot_school.demo.tab_robot import FIRST_LINES, HEAD, TAIL, TabRobot

program = [HEAD, FIRST_LINES, TAIL]
"""What the page shows before anybody has written."""


class Tab:
    """The tab's robot and its loop.

    Args:
        tell: called with how the robot is, as JSON.
        failed: called with why it has ended.
    """

    def __init__(self, tell: Callable[[str], object], failed: Callable[[str], object]) -> None:
        self._tell = tell
        self._failed = failed
        self._robot: TabRobot | None = None
        self._loop = HostedLoop(_call_later)

    def begin(self) -> None:
        """Run the robot."""
        self._loop.begin(self._run()).add_done_callback(self._ended)

    async def _run(self) -> None:
        self._robot = TabRobot(self._tell)
        await self._robot.run()

    def _ended(self, task: asyncio.Task[object]) -> None:
        error = task.exception()
        self._failed("the robot has ended" if error is None else f"{type(error).__name__}: {error}")

    def act(self, command: str) -> None:
        """Do what the page says, which it does once it has been told how the robot is."""
        robot = self._robot
        assert robot is not None
        self._loop.do(lambda: robot.act(command))


def _call_later(seconds: float, function: Callable[[], None]) -> None:
    js.setTimeout(create_once_callable(function), seconds * 1000)
