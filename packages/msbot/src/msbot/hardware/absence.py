"""Tells the robot why a part is not there: hardware that does not answer when the program starts.

Another part with the same name and UID asks for the place, says only what is wrong, and leaves. It never becomes
active. Where there is no robot yet, it waits for one.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from msbot.part import Part
from msbot_agent.link import Link

AGAIN_S = 600.0
"""It is told again after this time: to a master that has started since."""
LEAVE_S = 1.0
"""Longest wait for the one that tells to say goodbye."""


class Absence:
    """What the robot knows of it."""

    def __init__(self) -> None:
        self._messenger: Part | None = None
        self._task: asyncio.Task[None] | None = None
        self._told_at: float | None = None

    def tell(self, part: Part, fault: str, connect: Callable[[], Link], now: float) -> None:
        """Have the robot told, unless it was told lately or is just being told.

        Raises:
            MsbotError: the last attempt ended with it, as running the part would have.
        """
        if self._task is not None and self._task.done():
            task, self._task = self._task, None
            task.result()
            if self._messenger is not None and self._messenger.trouble_heard:
                self.is_told(now)
        if self._task is None and (self._told_at is None or now - self._told_at >= AGAIN_S):
            made = Part(part.part_number, uid=part.uid, local_name=part.local_name, robot=part.robot, describes=False)
            made.key, made.nature = part.key, part.nature
            self._messenger = made
            self._task = asyncio.create_task(made.run_async(connect(), absent=fault))

    def is_told(self, now: float) -> None:
        """The robot knows."""
        self._told_at = now

    def is_over(self) -> None:
        """The part is there."""
        self._told_at = None

    async def end(self) -> None:
        """Tell no more."""
        task, self._task = self._task, None
        if task is None or self._messenger is None:
            return
        self._messenger.end()
        await asyncio.wait([task], timeout=LEAVE_S)
        task.cancel()
        await asyncio.wait([task])
