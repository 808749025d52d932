"""The robots that this process is running: the right to run them, and their memory, which follows every change."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from sqlalchemy import Connection
from sqlalchemy.exc import SQLAlchemyError

from msbot.registry.database import statements
from msbot.registry.database.storage import Storage
from msbot.registry.records import RobotRecord
from msbot.registry.running import run_lock
from msbot.registry.running.master_lease import MasterLease, wait_for_lease
from msbot.registry.running.robot_memory import StoredRobotSnapshot, has_changed, read_memory, read_newest_edit
from msbot.registry.running.robot_store import JOURNAL_ROWS, STRANGERS, STRANGERS_ROWS, RobotStore, StoredNodeIds
from msbot_xrce.errors import RegistryError

_log = logging.getLogger(__name__)


class Runs:
    """Begins and ends the runs of robots."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage
        self._locks: dict[int, run_lock.RunLock | MasterLease] = {}
        """Robots that this process is running, by number."""
        self._stores: dict[int, RobotStore] = {}
        self._contested: set[int] = set()
        """Robots of this process that another master has begun to run."""

    def wait_for_lease(self, robot: RobotRecord, say: Callable[[str], object]) -> MasterLease:
        """Share this robot with other masters: wait until none of them serves it; see `msbot.registry.MasterLease`.

        Args:
            robot: which robot.
            say: called with what it waits for, whenever that changes.

        Raises:
            ConfigError: the database is a file, or this system cannot do that.
            RegistryError: the database cannot be used.
        """
        lease = wait_for_lease(self._storage.address, robot, say)
        self._locks[robot.id] = lease
        self._storage.writer.use_fence(lease.fence)
        return lease

    def begin(self, robot: RobotRecord) -> RobotStore:
        """The `PartStore` for a run of this robot; parts that were active when the last run ended are lost now.

        Raises:
            RegistryError: another master is running this robot, or the database cannot be read or written.
        """
        storage = self._storage
        writer = storage.writer
        if robot.id not in self._locks:
            self._locks[robot.id] = run_lock.RunLock(storage.engine, storage.address, robot, storage.busy_timeout_s)

        lock = self._locks[robot.id]

        def begin(connection: Connection) -> StoredRobotSnapshot:
            if isinstance(lock, MasterLease):
                lock.fence(connection)
            statements.prune(connection, robot.id, JOURNAL_ROWS, STRANGERS, STRANGERS_ROWS)
            statements.end_run(connection, robot.id, "the master was restarted", storage.epoch_ns())
            return read_memory(connection, robot.id)

        storage.flush()
        memory = storage.write(begin)
        storage.runs_a_robot = True
        writer.watch(self._look, self._follow)
        self._stores[robot.id] = RobotStore(writer, storage.describe, robot, memory, storage.epoch_ns)
        return self._stores[robot.id]

    def store(self, robot: RobotRecord) -> RobotStore:
        """The memory of a robot that is running here: answers at once, whatever the database does.

        Raises:
            RegistryError: this process is not running it.
        """
        found = self._stores.get(robot.id)
        if found is None:
            raise RegistryError(f"robot {robot.name} does not run in this process")
        return found

    def is_run(self, robot: RobotRecord) -> bool:
        """Whether a master is running this robot now, in this process or another one.

        Raises:
            RegistryError: the database cannot be read.
        """
        return robot.id in self._locks or run_lock.is_run(self._storage.engine, self._storage.address, robot)

    def node_ids(self, robot: RobotRecord, link: str) -> StoredNodeIds:
        """The addresses of the parts on one CAN bus, as `msbot_agent.link.NodeIds`.

        Raises:
            RegistryError: the database cannot be read.
        """
        rows = self._storage.read(partial(statements.read_node_ids, robot_id=robot.id, link=link))
        return StoredNodeIds(self._storage.writer, robot.id, link, rows=rows, epoch_ns=self._storage.epoch_ns)

    def on_news(self, robot: RobotRecord, call: Callable[[], object]) -> None:
        """Have a function called, from any thread, when the database has news that nobody in this process awaits.

        That is a change by another program, or one that was stored after its caller stopped waiting.
        """
        if robot.id in self._stores:
            self._stores[robot.id].on_news(call)

    def end(self) -> None:
        """Write to the journal that the parts are lost with their master."""
        now_ns = self._storage.epoch_ns()
        for robot_id in self._locks:
            end = partial(statements.end_run, robot_id=robot_id, reason="the master has ended", now_ns=now_ns)
            self._storage.writer.put(end)

    def give_back(self) -> None:
        """Let others run the robots when this returns; waits for the server, which must have answered just now."""
        for lock in self._locks.values():
            if isinstance(lock, run_lock.RunLock):
                with suppress(SQLAlchemyError):  # it answers no more: then the lock ends with its session
                    lock.give_back()
        self.release()

    def release(self) -> None:
        """Let others run the robots, as soon as the server notices; nobody waits for it."""
        for lock in self._locks.values():
            lock.release()
        self._locks.clear()
        self._stores.clear()

    def _follow(self, connection: Connection) -> Callable[[bool], None]:
        """Reload the robots that are running here after a change; called by the writer's thread."""
        read = [(one, read_memory(connection, one.robot.id), one.stored) for one in [*self._stores.values()]]

        def take_over(is_late: bool) -> None:
            for one, memory, stored in read:
                one.load(memory, stored)
                if is_late:
                    one.tell_news()

        return take_over

    def _keep(self, robot_id: int, robot: RobotRecord) -> None:
        lock = self._locks.get(robot_id)
        if not isinstance(lock, run_lock.RunLock):
            return  # a lease keeps itself
        if lock.renew():
            if robot_id in self._contested:
                _log.warning("this master alone runs %s again", robot.name)
            self._contested.discard(robot_id)
        elif robot_id not in self._contested:
            self._contested.add(robot_id)
            _log.error("another master runs %s now, beside this one: end one of the two", robot.name)

    def _look(self, connection: Connection) -> None:
        """Reload what other programs have changed, such as a new key, and keep the right to run the robots; called by
        the writer's thread about once a second."""
        for robot_id, one in [*self._stores.items()]:  # another thread may begin to run a robot meanwhile
            self._keep(robot_id, one.robot)
        newest = read_newest_edit(connection)
        for one in [*self._stores.values()]:
            if one.newest_edit < newest and not has_changed(connection, one.newest_edit):
                one.skip_to(newest)
            elif newest != one.newest_edit:
                stored = one.stored
                one.load(read_memory(connection, one.robot.id), stored)
                one.tell_news()
