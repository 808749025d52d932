"""The robots on other computers that this user has an access to, as the page Class shows and stops them.

They are asked in threads of their own. Looking never keeps a page waiting: what was seen last is shown, and a look goes
on meanwhile.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from itertools import chain

from msbot.process.daemon_threads import DaemonThreads
from msbot_school.classroom.class_robots import ClassRobot, RemoteRobot, far_robots
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile
from msbot_school.classroom.remote_masters import (
    LOOK_S,
    STOP_S,
    Answer,
    ParallelRequest,
    RemoteMasterError,
    read_status,
    say_stop,
)
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

AGAIN_S = 3.0
"""From the end of a look to the next one, while somebody looks."""
AT_ONCE = 4
"""Looks and STOPs that go on at the same time; each is over within seconds."""


@dataclass(frozen=True, slots=True)
class RemoteStop:
    """How STOP stands at one robot elsewhere."""

    robot: str
    answer: Answer | None
    """What its master said; None: it was not told, or does not answer."""
    trouble: str = ""


class RemoteRobots:
    """See the module's docstring.

    Args:
        clock: seconds.
        book: the accesses.
    """

    def __init__(self, clock: Callable[[], float], book: RemoteAccessFile | None = None) -> None:
        self._clock = clock
        self._book = book or RemoteAccessFile()
        self._threads = DaemonThreads(AT_ONCE, "msbot class")
        self._seen: Sequence[ClassRobot] = ()
        self._trouble: str | None = None
        """Why the last look came to nothing."""
        self._looked_at: float | None = None
        self._looking: asyncio.Future[Sequence[ClassRobot]] | None = None
        self._still: set[str] = set()
        """Addresses whose names were still being looked up when the last look was over."""

    async def snapshot(self) -> Sequence[ClassRobot]:
        """The robots as they were seen last; who asks first waits until all have answered, 3 s at most.

        Raises:
            ConfigError: the file with the accesses cannot be used.
        """
        looking = self._looking
        if looking is None and (self._looked_at is None or self._clock() - self._looked_at >= AGAIN_S):
            looking = asyncio.get_running_loop().run_in_executor(self._threads, self._look)
            self._looking = looking
        if looking is not None and (looking.done() or self._looked_at is None):
            try:
                self._seen, self._trouble = await asyncio.shield(looking), None
            except ConfigError as error:
                self._trouble = error.args[0]
            finally:
                if looking.done() and self._looking is looking:
                    self._looking, self._looked_at = None, self._clock()
        if self._trouble is not None:
            raise ConfigError(self._trouble)
        return self._seen

    async def stop_all(self, reason: str, group: str = "") -> list[RemoteStop]:
        """STOP to all of them at once, or to those of a STOP group; 5 s for each at most.

        Raises:
            ConfigError: the file with the accesses cannot be used.
        """
        return await asyncio.get_running_loop().run_in_executor(self._threads, self._stop, reason, group)

    def _look(self) -> Sequence[ClassRobot]:
        accesses = self._book.all()
        asked = [one for one in accesses if one.address not in self._still]
        asking = ParallelRequest(asked, read_status, LOOK_S)
        found = list(far_robots(asked, asking))
        waiting = [one for one in accesses if one.address in self._still]
        self._still = set(asking.unfinished())  # those get a rest, so that their threads do not add up
        return list(chain(found, (_unknown(one) for one in waiting)))

    def _stop(self, reason: str, group: str) -> list[RemoteStop]:
        accesses = self._book.all()
        answers = ParallelRequest(accesses, say_stop(reason, group), STOP_S).answers()
        found = []
        for access in accesses:
            answer, name = answers[access.address], f"{access.robot} {access.serial_number}"
            if isinstance(answer, RemoteMasterError):
                found.append(RemoteStop(name, None, str(answer)))
            elif "stopped" in answer:  # else it is of another STOP group
                found.append(RemoteStop(name, answer))
        return found


def _unknown(access: RemoteAccess) -> ClassRobot:
    trouble = f"{access.address}: its name is being looked up"
    return ClassRobot(
        access.robot, access.serial_number, "", access.address, None, far=RemoteRobot(access, {}, trouble)
    )
