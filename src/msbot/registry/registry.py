"""The SQL database manager (thesis 5.4.2): the one object through which everybody else uses the database."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from sqlalchemy import Connection, Engine

from msbot.config import Blueprint, Library
from msbot.errors import RegistryError
from msbot.pnp import PartState
from msbot.registry import blueprint_reader, changes, run_lock, store
from msbot.registry.editing import Editing
from msbot.registry.engine import Address, check_file, make_engine, parse_address, use_write_ahead_log
from msbot.registry.node_ids import StoredNodeIds
from msbot.registry.records import (
    JournalEntry,
    PartRecord,
    RobotRecord,
)
from msbot.registry.robot_store import JOURNAL_ROWS, STRANGERS, RobotStore
from msbot.registry.schema import Migrations, bring_up_to_date, check_schema, own_migrations

BUSY_TIMEOUT_S = 2.0
"""So long another program may hold the database before it counts as locked."""


def open_registry(
    address: str | Path,
    *,
    create: bool = True,
    read_only: bool = False,
    busy_timeout_s: float = BUSY_TIMEOUT_S,
    epoch_ns: Callable[[], int] = time.time_ns,
    migrations: Migrations | None = None,
) -> Registry:
    """Open a database; make it, or bring it up to date, where that is needed.

    Args:
        address: a path, `sqlite:///path` or `postgresql://user@host/name`.
        create: make the database when it is not there.
        read_only: change nothing, not even the schema.
        busy_timeout_s: how long to wait for another program.
        epoch_ns: wall clock, nanoseconds since 1970.
        migrations: others than MsBOT's own, for tests.

    Raises:
        RegistryError: it cannot be used; the text says why and what to do.
    """
    where = parse_address(address)
    check_file(where, create=create and not read_only, read_only=read_only)
    engine = make_engine(where, busy_timeout_s=busy_timeout_s, read_only=read_only)
    try:
        _prepare(engine, where, migrations or own_migrations(), read_only=read_only)
        return Registry(engine, where, epoch_ns, busy_timeout_s=busy_timeout_s, read_only=read_only)
    except BaseException:
        engine.dispose()
        raise


def _prepare(engine: Engine, where: Address, migrations: Migrations, *, read_only: bool) -> None:
    if check_schema(engine, where, migrations):
        return
    if read_only:
        raise RegistryError(
            f"the database {where.words} is empty or of an older MsBOT: `msbot db migrate --db {where.words}`"
        )
    use_write_ahead_log(engine, where)
    bring_up_to_date(engine, where, migrations)


class Registry(Editing):
    """An open database; made by `open_registry`, closed by `close` or at the end of a `with`."""

    def __init__(
        self,
        engine: Engine,
        address: Address,
        epoch_ns: Callable[[], int],
        *,
        busy_timeout_s: float,
        read_only: bool,
    ) -> None:
        super().__init__(engine, address, epoch_ns, busy_timeout_s=busy_timeout_s, read_only=read_only)
        self._running: dict[int, run_lock.RunLock] = {}
        """Robots that this process runs, by number."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def apply_blueprint(self, blueprint: Blueprint, library: Library, who: str = "msbot") -> RobotRecord:
        """Store or update a robot, its slots, bindings, settings and the library, all or nothing.

        Which part sat in which slot, what was set by hand, and the journal stay. If a robot that was there before
        changes, that is an edit of `who` and can be undone.

        Raises:
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._in_order(
            lambda connection: changes.apply_blueprint(connection, blueprint, library, who=who, now_ns=self._epoch_ns())
        )

    def store_for(self, robot: RobotRecord) -> RobotStore:
        """The `PartStore` for a run of this robot; parts that were active when the last run ended are lost now.

        Raises:
            RegistryError: another master runs this robot, or the database cannot be read or written.
        """
        writer = self._open_writer()
        if robot.id not in self._running:
            self._running[robot.id] = run_lock.RunLock(self._engine, self._address, robot, self._busy_timeout_s)

        def begin(connection: Connection) -> None:
            store.prune(connection, robot.id, JOURNAL_ROWS, STRANGERS)
            store.end_run(connection, robot.id, "the master was started anew", self._epoch_ns())

        self._write(begin)
        self._runs_a_robot = True
        if earlier := self._stores.pop(robot.id, None):
            earlier.close()
        self._stores[robot.id] = RobotStore(self._engine, writer, self.database, robot, self._epoch_ns)
        return self._stores[robot.id]

    def node_ids(self, robot: RobotRecord, link: str) -> StoredNodeIds:
        """The addresses of the parts on one CAN bus, as `msbot.link.NodeIds`.

        Raises:
            RegistryError: the database cannot be read.
        """
        rows = self._read(partial(store.read_node_ids, robot_id=robot.id, link=link))
        return StoredNodeIds(self._open_writer(), robot.id, link, rows=rows, epoch_ns=self._epoch_ns)

    def robots(self) -> list[RobotRecord]:
        """All robots of the database, the one used last first.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._read(store.list_robots)

    def parts(self, robot: RobotRecord | None = None) -> list[PartRecord]:
        """All parts that were ever seen, as after their last change of state; those in slots first.

        While nobody runs a robot, none of its parts is active: those that were when the master was killed are lost.

        Raises:
            RegistryError: the database cannot be read.
        """
        records = []
        for one in self.robots() if robot is None else [robot]:
            found = self._read(partial(store.list_parts, robot_id=one.id))
            records.extend(found if self.is_run(one) else [_without_master(record) for record in found])
        return records

    def is_run(self, robot: RobotRecord) -> bool:
        """Whether a master runs this robot now: this process, or another one.

        Raises:
            RegistryError: the database cannot be read.
        """
        return robot.id in self._running or run_lock.is_run(self._engine, self._address, robot)

    def find_robot(self, blueprint: Blueprint) -> RobotRecord | None:
        """The robot of a blueprint: the one with its name and serial number.

        Raises:
            RegistryError: the database cannot be read.
        """
        profile = blueprint.robot
        find = partial(store.find_robot, name=profile.name, serial_number=profile.serial_number)
        return self._read(find)

    def blueprint(self, robot: RobotRecord, *, by_hand: bool = True) -> Blueprint:
        """What the database knows of a robot, as a blueprint.

        Args:
            robot: which one.
            by_hand: with what people set by hand; otherwise as the blueprint was applied last.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._read(partial(blueprint_reader.read, robot_id=robot.id, by_hand=by_hand))

    def made_by_hand(self, robot: RobotRecord) -> dict[tuple[str, str], str]:
        """(slot, parameter) or (topic, "") of everything made by hand -> by whom, in words.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._read(partial(blueprint_reader.read_notes, robot_id=robot.id))

    def slot_names(self, robot: RobotRecord) -> list[str]:
        """The slots of the robot's blueprint, in its order.

        Raises:
            RegistryError: the database cannot be read.
        """
        return [slot.name for slot in self._read(partial(store.list_slots, robot_id=robot.id))]

    def journal(
        self, limit: int = 100, part: str | None = None, *, robot: RobotRecord | None = None
    ) -> list[JournalEntry]:
        """The newest lines of the journal, the oldest of them first.

        Args:
            limit: so many at most.
            part: only those about this part: its name, slot, local name, part number or UID; capitals do not matter.
            robot: only those of this robot.

        Raises:
            RegistryError: the database cannot be read.
        """
        robot_id = None if robot is None else robot.id
        return self._read(partial(store.read_journal, robot_id=robot_id, part=part, limit=limit))

    def close(self) -> None:
        """Store what is waiting and let go of the database."""
        if self._writer is not None:
            self._end_runs()
            self._writer.close()
        for store_of_run in self._stores.values():
            store_of_run.close()
        self._stores.clear()
        for lock in self._running.values():
            lock.release()
        self._running.clear()
        self._engine.dispose()

    def _end_runs(self) -> None:
        """Tell the journal that parts are lost with their master."""
        now_ns = self._epoch_ns()
        for robot_id in self._running:
            self._open_writer().put(
                partial(store.end_run, robot_id=robot_id, reason="the master has ended", now_ns=now_ns)
            )


def _without_master(record: PartRecord) -> PartRecord:
    if not PartState(record.state).is_registered:
        return record
    return replace(record, state=PartState.LOST.value, reason="its robot has no master at the moment")
