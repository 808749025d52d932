"""The whole class as the pages show it: the robots of the database, of every master here, and those on other computers
with an access; and one STOP for all.

That STOP is a teacher's, and reaches the robots of the class: those of this robot's STOP group, wherever they are; of a
robot without a group, those of its database, and those elsewhere with an access, which is what both sides agreed on.
Robots of others that happen to run for the same user are shown, and left alone.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from msbot.config import Library
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.rights import Principal, Right
from msbot_agent.startup.extensions import own_version
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import parse_count
from msbot_school.classroom.class_robots import ClassRobot, database_mark
from msbot_school.classroom.remote_masters import Answer
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.class_rollouts import ClassRollOuts
from msbot_web.local_masters import LocalMaster, LocalMasters, StopForAll
from msbot_web.models.class_models import RobotStatus, RobotTile
from msbot_web.models.robot_models import Robot
from msbot_web.remote_robots import RemoteRobots, RemoteStop
from msbot_web.stored_data import StoredData
from msbot_xrce.errors import ConfigError

CLASS_S = 2.0
"""How long one look at the whole database serves every class view."""
MOST_SILENT = 100
"""Names of parts that have not confirmed STOP, in the robot's short answer."""


class WholeClass:
    """See the module's docstring.

    Args:
        operations: what can be done to the robot here.
        records: its database.
        robot: its description.
        accounts: who may do what.
        clock: the robot's clock.
        neighbours: the masters of this computer.
        library: gives the part types that a blueprint for many is checked against.
        far: the masters elsewhere.
        asker: who asks for an operation.
    """

    def __init__(
        self,
        operations: InProcessOperations,
        records: StoredData,
        robot: Callable[[], Robot],
        accounts: Accounts,
        *,
        clock: Callable[[], float],
        neighbours: LocalMasters,
        library: Callable[[], Library],
        asker: Callable[[Session], Principal],
        far: RemoteRobots | None = None,
    ) -> None:
        self._operations = operations
        self._asker = asker
        self._records = records
        self._robot = robot
        self._accounts = accounts
        self._clock = clock
        self._neighbours = neighbours
        self._far = far or RemoteRobots(clock)
        self.rollouts = ClassRollOuts(records, accounts, library, clock)
        """One blueprint for many."""
        self._looking_around = asyncio.Lock()
        self._seen: tuple[float, list[RobotTile]] | None = None
        self.trouble = ""
        """Why robots elsewhere are not shown; empty: they are."""

    def status(self) -> RobotStatus:
        """The robot here in short, for the class that it is in."""
        robot, stop, database = self._robot(), self._operations.stopping.status, self._records.database
        slots, active = self._operations.filled()
        return RobotStatus(
            robot=robot.name,
            version=robot.version,
            serial_number=robot.serial_number,
            released=robot.released,
            manufacturer=robot.manufacturer,
            stop_group=self._operations.stop_group,
            msbot=own_version(),
            blueprint=self._operations.blueprint_mark,
            database=database_mark(database) if database else "",
            slots=slots,
            active=active,
            stopped=stop.stopped,
            told=stop.told_count,
            not_confirmed=len(stop.silent),
            silent=list(stop.silent[:MOST_SILENT]),
            trouble=self._records.trouble(),
        )

    async def robots(self) -> list[RobotTile]:
        """All robots of the database, those whose masters run on this computer, and those elsewhere with an access.

        Read at most every few seconds, and by one at a time, however many pages are open.
        """
        async with self._looking_around:
            if self._seen is None or self._clock() - self._seen[0] >= CLASS_S:
                found = await self._neighbours.find()
                tiles = with_neighbours(await self._stored(), found, self._records.database)
                try:
                    far, self.trouble = await self._far.snapshot(), ""
                except ConfigError as error:
                    far, self.trouble = (), str(error)
                tiles = with_far(tiles, far, self._records.database)
                group, mark = self._operations.stop_group, self._mark
                tiles = [one.model_copy(update={"in_class": is_in_class(one, group, mark)}) for one in tiles]
                self._seen = (self._clock(), tiles)
            return self._seen[1]

    async def _stored(self) -> list[RobotTile]:
        return [tile.model_copy(update={"database": self._mark}) for tile in await self._records.robots()]

    async def _stop_here(self, who: str, reason: str, group: str) -> StopForAll:
        """The robots of the class on this computer; a robot without STOP group and database is the only one."""
        robot = self._robot().name
        if group or self._records.database:
            return await self._neighbours.stop_all(who, reason, robot, None if group else self._records.database)
        status = self._operations.stopping.status
        waiting = (f"{robot} ({', '.join(status.silent)})",) if status.silent else ()
        return StopForAll((robot,), len(status.confirmed), status.told_count, 0, waiting)

    @property
    def _mark(self) -> str:
        database = self._records.database
        return database_mark(database) if database else ""

    async def stop_all(self, session: Session) -> StopForAll:
        """STOP to every robot of the class, here and elsewhere; all at once.

        Raises:
            NotAllowed: the session may not stop the whole class.
            ConfigError: the file with the accesses cannot be used, and the robots of this computer were told; or no
                thread can be started, and only this robot was told.
        """
        self._accounts.require(session, Right.STOP_CLASS)
        self.rollouts.hold_back(said("STOP was said to all robots"))
        robot, group = self._robot().name, self._operations.stop_group
        reason = said("{session} said STOP to all robots of the class", session=session.name)
        far_reason = said("{reason}, from the page of {robot}", reason=reason, robot=robot)
        own = self._operations.do("stop", who=self._asker(session), reason=reason)  # first, and without a thread
        found = _, here, far = await asyncio.gather(
            own,
            self._stop_here(session.name, reason, group),
            self._far.stop_all(far_reason, group),
            return_exceptions=True,
        )
        for one in found:
            if isinstance(one, RuntimeError):
                raise ConfigError(said("STOP was said to this robot, and NOT to the others: no thread can be started"))
            if isinstance(one, BaseException):
                raise one
        assert isinstance(here, StopForAll)
        assert isinstance(far, list)
        return together(here, far)


def is_in_class(tile: RobotTile, group: str, database: str) -> bool:
    """Whether a robot is in the class of another one, so that one STOP is meant for both.

    Args:
        tile: the robot.
        group: the STOP group of the other one; empty: none.
        database: the mark of that one's database; empty: it has none.
    """
    if tile.here:
        return True
    if group:  # who does not answer, or does not run, may be in it: it is named, not forgotten
        return tile.stop_group == group or not tile.reachable
    return tile.elsewhere or bool(database and tile.database == database)


def together(here: StopForAll, far: Sequence[RemoteStop]) -> StopForAll:
    """One STOP, here and elsewhere; who has not answered is named, and nothing is assumed of it."""
    taken = [(one.robot, one.answer) for one in far if one.answer is not None and one.answer.get("stopped")]
    known = [(robot, answer, parse_count(told)) for robot, answer in taken if (told := answer.get("told")) is not None]
    waiting = [f"{robot} ({_not_confirmed(answer)})" for robot, answer, _ in known if answer.get("not_confirmed")]
    return replace(
        here,
        told=(*here.told, *(robot for robot, _ in taken)),
        parts=here.parts + sum(told for *_, told in known),
        confirmed=here.confirmed
        + sum(max(0, told - parse_count(answer.get("not_confirmed"))) for _, answer, told in known),
        waiting=(*here.waiting, *waiting, *(robot for robot, answer in taken if answer.get("told") is None)),
        not_stored=(*here.not_stored, *(robot for robot, answer in taken if answer.get("stored") is False)),
        not_told=tuple(
            f"{one.robot}: {one.trouble}" if one.trouble else one.robot
            for one in far
            if one.answer is None or not one.answer.get("stopped")
        ),
    )


def _not_confirmed(answer: Answer) -> str:
    silent = answer.get("silent")
    return (", ".join(map(str, silent)) if isinstance(silent, list) else "") or str(answer["not_confirmed"])


def with_far(tiles: Sequence[RobotTile], far: Iterable[ClassRobot], database: str) -> list[RobotTile]:
    """The tiles with what masters on other computers say of theirs, and tiles for those that are in no database here.

    Args:
        tiles: of the database, and of this computer.
        far: the robots elsewhere.
        database: which database it is; empty: none.
    """
    mark = database_mark(database) if database else ""
    known = {(tile.name, tile.serial_number): number for number, tile in enumerate(tiles)}
    found = list(tiles)
    for one in far:
        assert one.far is not None
        told = {
            "running": one.answers,
            "address": one.page,
            "active": one.active,
            "slots": one.slots,
            "elsewhere": True,
            "stopped": one.far.status.get("stopped") is True,
            "reachable": one.answers,
            "version": one.version,
            "blueprint": one.blueprint,
            "msbot": one.msbot,
            "trouble": one.far.trouble,
            "database": one.database_mark,
            "stop_group": one.stop_group,
        }
        number = known.get((one.name, one.serial_number)) if mark and one.far.text("database") == mark else None
        if number is None:
            found.append(
                RobotTile(
                    name=one.name,
                    serial_number=one.serial_number,
                    running=one.answers,
                    here=False,
                    owner="",
                    slots=one.slots,
                    active=one.active,
                    last_event="",
                    last_event_age_s=None,
                ).model_copy(update=told)
            )
        elif not found[number].reachable:  # else it is one of this computer, which has said so itself
            found[number] = found[number].model_copy(update={**told, "running": True})
    return found


def with_neighbours(tiles: Sequence[RobotTile], found: Iterable[LocalMaster], database: str) -> list[RobotTile]:
    """The robots of the database, with what their masters say of themselves; and robots of other databases.

    In one database a robot is known by its name and serial number. Those of two databases are two robots, whatever
    they are called: whoever does not change the sample has the same names as everybody.

    Args:
        tiles: the robots of the database.
        found: the masters of this computer.
        database: which database that is; empty: none, and a robot is known by its names alone.
    """
    known = {(database, tile.name, tile.serial_number): tile for tile in tiles}
    for one in found:
        key = (one.database if database else "", one.robot, one.serial_number)
        tile = known.get(key) or RobotTile(
            name=one.robot,
            serial_number=one.serial_number,
            running=True,
            here=False,
            owner="",
            slots=one.slots,
            active=one.active,
            last_event="",
            last_event_age_s=None,
            database=database_mark(one.database) if one.database else "",
        )
        known[key] = tile.model_copy(
            update={
                "running": True,
                "address": one.page,
                "active": one.active,
                "slots": one.slots,
                "stopped": one.stopped,
                "reachable": True,
                "version": one.version or tile.version,
                "blueprint": one.blueprint or tile.blueprint,
                "msbot": one.msbot,
                "stop_group": one.stop_group,
            }
        )
    return list(known.values())
