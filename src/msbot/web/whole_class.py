"""The whole class as the pages show it: the robots of the database and of every master here, and one STOP for all."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence

from msbot.operations.dispatch import RunningOperations
from msbot.operations.rights import Right
from msbot.runtime.own_version import own_version
from msbot.runtime.sentence import said
from msbot.school.class_robots import database_mark
from msbot.web.access.accounts import Accounts
from msbot.web.access.sessions import Session
from msbot.web.api.class_models import RobotStatus, RobotTile
from msbot.web.api.models import Robot
from msbot.web.local_masters import LocalMaster, LocalMasters, StopForAll
from msbot.web.records import Records

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
    """

    def __init__(
        self, operations: RunningOperations, records: Records, robot: Callable[[], Robot], accounts: Accounts, *,
        clock: Callable[[], float], neighbours: LocalMasters,
    ) -> None:  # fmt: skip
        self._operations = operations
        self._records = records
        self._robot = robot
        self._accounts = accounts
        self._clock = clock
        self._neighbours = neighbours
        self._looking_around = asyncio.Lock()
        self._seen: tuple[float, list[RobotTile]] | None = None

    def status(self) -> RobotStatus:
        """The robot here in short, for the class that it is in."""
        robot, stop, database = self._robot(), self._operations.stopping.status, self._records.database
        slots, active = self._operations.filled()
        return RobotStatus(
            robot=robot.name, version=robot.version, serial_number=robot.serial_number, released=robot.released,
            manufacturer=robot.manufacturer, msbot=own_version(), blueprint=self._operations.blueprint_mark,
            database=database_mark(database) if database else "", slots=slots, active=active, stopped=stop.stopped,
            told=stop.told, not_confirmed=len(stop.silent), silent=list(stop.silent[:MOST_SILENT]),
            trouble=self._records.trouble(),
        )  # fmt: skip

    async def robots(self) -> list[RobotTile]:
        """All robots of the database, and those whose masters run on this computer.

        Read at most every few seconds, and by one at a time, however many pages are open.
        """
        async with self._looking_around:
            if self._seen is None or self._clock() - self._seen[0] >= CLASS_S:
                found = await self._neighbours.look()
                tiles = with_neighbours(await self._records.robots(), found, self._records.database)
                self._seen = (self._clock(), tiles)
            return self._seen[1]

    async def stop_all(self, session: Session) -> StopForAll:
        """STOP to every robot whose master runs on this computer."""
        self._accounts.require(session, Right.STOP)
        return await self._neighbours.stop_all(
            session.name, said("{session} said STOP to all robots of the class", session=session.name)
        )


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
            name=one.robot, serial_number=one.serial_number, running=True, here=False, owner="", slots=one.slots,
            active=one.active, last_event="", last_event_age_s=None,
        )  # fmt: skip
        known[key] = tile.model_copy(
            update={"running": True, "address": one.page, "active": one.active, "slots": one.slots,
                    "stopped": one.stopped, "reachable": True}
        )  # fmt: skip
    return list(known.values())
