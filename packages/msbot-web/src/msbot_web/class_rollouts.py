"""One blueprint for many robots, as the page Class does it: what would change, the roll-out, and its undo.

It runs in threads of the master, a few robots at a time, so it goes on when the page is closed; who looks again sees
how far it is. STOP for all comes first: robots that are still waiting then are left as they are.
"""

from __future__ import annotations

import asyncio
import logging
import tempfile
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final, ParamSpec, TypeVar

from msbot.config import Blueprint, Library
from msbot.operations.rights import Right
from msbot.process.daemon_threads import DaemonThreads
from msbot.process.persistent_worker import PersistentWorker
from msbot.process.worker_pool import WorkLimits
from msbot.registry.records import database_identity
from msbot_agent.text.sentence import said
from msbot_school.classroom.class_robots import ClassRobot, DatabaseReader, class_robots
from msbot_school.classroom.remote_access import RemoteAccessFile
from msbot_school.classroom.rollout import RollOut, RollOutPlan, blueprint_of, plan_for, undo_job
from msbot_school.classroom.rollout_run import (
    RobotJob,
    RobotStep,
    RolledOutChange,
    RollOutEntry,
    RollOutLog,
    RollOutRun,
)
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.stored_data import StoredData
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

AT_ONCE: Final = 4
"""Robots that are looked at, or changed, at the same time; each takes 30 s at most."""
MOST_ROBOTS: Final = 1000
"""Robots of one roll-out."""
MOST_COMPARING: Final = 3
"""People who compare at the same time."""
REMEMBERED_S: Final = 2.0
"""How long one look into what is remembered serves every page."""

_P = ParamSpec("_P")
_R = TypeVar("_R")
_log = logging.getLogger(__name__)

RobotKey = tuple[str, str, str]
"""Name, serial number, and the mark of the database."""


@dataclass(frozen=True, slots=True)
class ChosenBlueprint:
    """The blueprint that many robots shall have."""

    source: str
    """Where it is from, for people."""
    blueprint: Blueprint
    robot: RobotKey | None = None
    """Whose it is; None: it is from a file."""


def key_of(robot: ClassRobot) -> RobotKey:
    """What a robot of the class is known by."""
    return robot.name, robot.serial_number, robot.database_mark


class ClassRollOuts:
    """See the module's docstring.

    Args:
        records: the database of the robot here.
        accounts: who may do what.
        library: gives the part types that a blueprint is checked against.
        clock: seconds.
        accesses: to robots elsewhere.
        book: remembers what was done.
        read: calls what opens databases; None: in a process of its own.
    """

    def __init__(
        self,
        records: StoredData,
        accounts: Accounts,
        library: Callable[[], Library],
        clock: Callable[[], float],
        *,
        accesses: RemoteAccessFile | None = None,
        book: RollOutLog | None = None,
        read: DatabaseReader | None = None,
    ) -> None:
        self._records = records
        self._accounts = accounts
        self._library = library
        self._clock = clock
        self._accesses = accesses or RemoteAccessFile()
        self._book = book or RollOutLog()
        self._looking = DaemonThreads(AT_ONCE, "msbot roll-out look")
        self._threads = DaemonThreads(AT_ONCE, "msbot roll-out")
        self._read = read
        self._databases = PersistentWorker(WorkLimits())
        self._comparing = 0
        self._is_beginning = False
        self._last: tuple[float, RollOutEntry | None] | None = None
        self.run: RollOutRun | None = None
        """The latest one that this master has begun."""

    # Seeing

    async def pattern(self, session: Session, name: str, toml: str) -> ChosenBlueprint:
        """The blueprint of a file.

        Raises:
            ConfigError: it is wrong; the text says where.
        """
        self._accounts.require(session, Right.DESIGN)
        return ChosenBlueprint(name, await self._records.parse(toml))

    async def pattern_of(self, session: Session, robot: RobotKey) -> ChosenBlueprint:
        """The blueprint that is in force in a robot of the class.

        Raises:
            NotAllowed: that robot is none of this person's.
            ConfigError: it cannot be read, or this robot's library does not know its parts.
        """
        self._accounts.require(session, Right.DESIGN)
        (found,) = await self._chosen([robot])
        self._accounts.require(session, self._right(found))
        toml = await self._aside(blueprint_of, found, self._reader())
        return ChosenBlueprint(found.describe, await self._records.parse(toml), robot)

    async def plan(self, session: Session, pattern: ChosenBlueprint, robots: Collection[RobotKey]) -> list[RollOutPlan]:
        """What it would change in each of these robots; nothing is changed.

        Raises:
            ConfigError: there are too many, one is not in the class any more, or others are comparing.
        """
        self._accounts.require(session, Right.DESIGN)
        if len(robots) > MOST_ROBOTS:
            raise ConfigError(said("a roll-out has at most {most} robots", most=MOST_ROBOTS))
        if self._comparing >= MOST_COMPARING:
            raise ConfigError(said("others are comparing robots just now: try again in a moment"))
        self._comparing += 1
        try:
            found = await self._chosen([one for one in robots if one != pattern.robot])
            blueprint = replace(pattern.blueprint, library=await self._aside(_places, self._library()))
            return list(await asyncio.gather(*(self._plan(session, one, blueprint) for one in found)))
        finally:
            self._comparing -= 1

    async def last(self, session: Session) -> RollOutEntry | None:
        """The latest roll-out of which something can be taken back, whoever began it, here or in a terminal."""
        self._accounts.require(session, Right.DESIGN)
        if self._last is None or self._clock() - self._last[0] >= REMEMBERED_S:
            self._last = (self._clock(), await self._aside(self._book.last))
        return self._last[1]

    # Doing

    async def begin(self, session: Session, pattern: ChosenBlueprint, plans: Sequence[RollOutPlan]) -> RollOutRun:
        """Change the robots whose plans change something; returns as soon as that has begun.

        Raises:
            NotAllowed: one of them is none of this person's; nothing was changed.
            ConfigError: there is nothing to change, or another roll-out goes on.
        """
        self._accounts.require(session, Right.DESIGN)
        to_change = [plan for plan in plans if plan.changes and not plan.obstacle]
        for plan in to_change:
            self._accounts.require(session, self._right(plan.robot))
        if not to_change:
            raise ConfigError(said("there is nothing to change"))

        read = self._reader()

        def prepare() -> tuple[RollOutRun, Callable[[], None]]:
            # The masters of this computer read the blueprint from a file, which is nobody else's.
            folder = tempfile.TemporaryDirectory(prefix="msbot-rollout-")
            place = Path(folder.name)
            roll = RollOut(pattern.source, place, self._library(), (), session.name, book=self._book, read=read)
            return RollOutRun(pattern.source, [roll.job(plan) for plan in to_change]), folder.cleanup

        return await self._begin(prepare)

    async def undo(self, session: Session, remembered: RollOutEntry) -> RollOutRun:
        """Take a roll-out back, robot by robot; what was changed again since stays.

        Raises:
            NotAllowed: one of the robots is none of this person's; nothing was taken back.
            ConfigError: another roll-out goes on.
        """
        self._accounts.require(session, Right.DESIGN)
        for change in remembered.done:
            self._accounts.require(session, self._right_by(change))

        read = self._reader()

        def prepare() -> tuple[RollOutRun, Callable[[], None]]:
            robots = self._robots(read)

            def job(change: RolledOutChange) -> RobotJob:
                return undo_job(remembered.at, change, robots, session.name, self._book, read=read)

            jobs = [job(change) for change in remembered.done]
            return RollOutRun(remembered.blueprint, jobs, is_undo=True), lambda: None

        return await self._begin(prepare)

    def halt(self, session: Session) -> None:
        """Begin with no further robot of the roll-out that goes on."""
        self._accounts.require(session, Right.DESIGN)
        self.hold_back(said("{session} has ended the roll-out", session=session.name))

    def hold_back(self, why: str) -> None:
        """The same, for a reason of the robots'."""
        if self.run is not None and not self.run.is_over:
            self.run.halt(why)

    def close(self) -> None:
        """End the process that opens databases; it ends by itself with the robot, and when it has nothing to do."""
        self._databases.end()

    # Helpers

    async def _begin(self, prepare: Callable[[], tuple[RollOutRun, Callable[[], None]]]) -> RollOutRun:
        if self._is_beginning or not (self.run is None or self.run.is_over):
            raise ConfigError(said("a roll-out goes on: wait until it is over"))
        self._is_beginning = True
        try:
            run, over = await self._aside(prepare)
            self.run, self._last = run, None
        finally:
            self._is_beginning = False
        for number in range(len(run.steps)):
            self._threads.submit(run.do, number).add_done_callback(partial(self._done, run, over))
        return run

    def _done(self, run: RollOutRun, over: Callable[[], None], future: Future[RobotStep]) -> None:
        """Called in the thread that has done one robot."""
        if (error := future.exception()) is not None:
            _log.error("a robot of a roll-out failed", exc_info=error)
        if run.is_over:
            self._last = None
            over()

    async def _plan(self, session: Session, robot: ClassRobot, blueprint: Blueprint) -> RollOutPlan:
        if not session.may(self._right(robot)):
            words = said(
                "only an administrator may change a robot of another database or on another computer from here"
            )
            return RollOutPlan(robot, None, obstacle=words)
        return await self._aside(plan_for, robot, blueprint, self._reader())

    def _right(self, robot: ClassRobot) -> Right:
        """A robot of this database is this database's teachers'; others are the user's who runs this master."""
        is_ours = robot.far is None and bool(robot.database) and self._is_ours(database_identity(robot.database))
        return Right.DESIGN if is_ours else Right.ADMINISTER

    def _right_by(self, change: RolledOutChange) -> Right:
        return Right.DESIGN if self._is_ours(change.database) else Right.ADMINISTER

    def _is_ours(self, identity: str) -> bool:
        return bool(self._records.database) and identity == self._records.database

    async def _chosen(self, keys: Collection[RobotKey]) -> list[ClassRobot]:
        known = {key_of(robot): robot for robot in await self._aside(self._robots, self._reader())}
        gone = [
            f"{name} {serial_number}" for name, serial_number, mark in keys if (name, serial_number, mark) not in known
        ]
        if gone:
            raise ConfigError(said("not in the class any more: {robots}", robots=", ".join(gone)))
        return [known[key] for key in keys]

    def _robots(self, read: DatabaseReader) -> list[ClassRobot]:
        address = self._records.address
        return class_robots(address or None, self._accesses.all(), path=address, read=read)

    def _reader(self) -> DatabaseReader:
        """Has another process open databases, for threads of ours."""
        if self._read is not None:
            return self._read
        loop = asyncio.get_running_loop()

        def read(function: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
            return asyncio.run_coroutine_threadsafe(self._databases.run(function, *args, **kwargs), loop).result()

        return read

    async def _aside(self, work: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
        return await asyncio.get_running_loop().run_in_executor(self._looking, partial(work, *args, **kwargs))


def _places(library: Library) -> tuple[str, ...]:
    """The files of part types that do not come with MsBOT, as a blueprint of this computer names them."""
    files = {Path(one.source).absolute() for one in library}
    return tuple(sorted(str(file) for file in files if file.is_file()))
