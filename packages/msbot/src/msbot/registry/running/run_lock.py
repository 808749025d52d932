"""The lock that lets only one master at a time run a robot of a database.

The lock ends with the process, however that ends: for a database file it is SQLite's own lock on an empty file beside
it, on a server it is an advisory lock of the session. A session also ends when the server restarts or the network is
cut for long, and a file can be deleted by somebody who tidies up; `RunLock.renew` takes the lock anew.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable
from functools import partial
from pathlib import Path

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import OperationalError, SQLAlchemyError

from msbot.registry.database.database_errors import told_as_registry_error
from msbot.registry.database.engine import Address, make_private
from msbot.registry.read_only_database import lock_file
from msbot.registry.records import RobotRecord
from msbot.registry.running.master_lease import LOCK_CLASS, is_leased
from msbot_xrce.errors import RegistryError

_LOCK_NOT_AVAILABLE = "55P03"
"""PostgreSQL's SQLSTATE when lock_timeout has passed."""


class RunLock:
    """The right to run a robot, from making this object until `release`.

    Raises:
        RegistryError: another master is running it, or the lock cannot be made.
    """

    def __init__(self, engine: Engine, address: Address, robot: RobotRecord, timeout_s: float) -> None:
        self._take: Callable[[float], _ServerLock | _FileLock | None] = (
            partial(_lock_on_server, engine, robot)
            if address.path is None
            else partial(_lock_beside, address.path, robot)
        )
        self._end_lost = partial(_end_session, engine, robot)
        self._is_released = False
        with told_as_registry_error(address.words):
            self._lock = self._take(timeout_s)
        if self._lock is None:
            raise RegistryError(
                f"robot {robot.name} is being run by another msbot master with the database {address.words}: "
                "stop that one, or give this one another --db and another port"
            )

    def renew(self) -> bool:
        """Take the lock anew if its session has ended, or its file is gone; False: somebody else has it by now.

        Raises:
            SQLAlchemyError: the server does not answer.
        """
        lock = self._lock
        if self._is_released or (lock is not None and lock.holds()):
            return True
        if lock is not None:
            lock.release()
            self._lock = None
            if isinstance(lock, _ServerLock):
                self._end_lost(lock.session)
        try:
            lock = self._lock = self._take(0.0)
        except sqlite3.Error:
            return True  # the folder takes no file at the moment, of nobody; it is tried again
        if self._is_released and lock is not None:
            lock.release()  # another thread has let others run the robot meanwhile
        return lock is not None or self._is_released

    def give_back(self) -> None:
        """Let others run the robot when this returns; waits for the server, which must have answered just now.

        Raises:
            SQLAlchemyError: it answers no more; its lock ends with the session.
        """
        lock, self._lock, self._is_released = self._lock, None, True
        if lock is not None:
            lock.give_back()

    def release(self) -> None:
        """Let others run the robot, as soon as the server notices; whatever it does, nobody waits for it."""
        self._is_released = True
        if self._lock is not None:
            self._lock.release()
            self._lock = None


def is_run(engine: Engine, address: Address, robot: RobotRecord) -> bool:
    """Whether a master is running this robot at the moment."""
    if address.path is not None and not lock_file(address.path, robot.id).exists():
        return False
    try:
        lock = RunLock(engine, address, robot, 0.0)
        with told_as_registry_error(address.words):
            lock.give_back()
    except RegistryError:
        return True
    return False


class _FileLock:
    """A lock on a file."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self.release = self.give_back = connection.close
        self._path = path
        self._file = _file_at(path)

    def holds(self) -> bool:
        """Whether the locked file is still the one of that name."""
        return self._file is not None and _file_at(self._path) == self._file


def _file_at(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


class _ServerLock:
    """A lock of a session."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self.session: int = connection.execute(text("SELECT pg_backend_pid()")).scalar_one()
        """Its number at the server."""

    def holds(self) -> bool:
        """Whether the session lives, and the lock with it."""
        try:
            self._connection.execute(text("SELECT 1"))
        except SQLAlchemyError:
            return False
        return True

    def give_back(self) -> None:
        """See `RunLock`."""
        try:
            self._connection.execute(text("SELECT pg_advisory_unlock_all()"))
        finally:
            self.release()

    def release(self) -> None:
        # A connection that merely went back to the pool would keep the lock and the time-out.
        if not self._connection.closed:
            self._connection.invalidate()
            self._connection.close()


def _lock_beside(database: Path, robot: RobotRecord, timeout_s: float) -> _FileLock | None:
    """Take the lock, or None when somebody else has it."""
    # The file is left behind: deleting it could let two waiting masters lock two files of the same name.
    path = lock_file(database, robot.id)
    with contextlib.suppress(OSError):  # the next line says what is wrong
        make_private(path)
    # The thread that looks after the database may have to take the lock anew.
    connection = sqlite3.connect(path, timeout=timeout_s, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("BEGIN EXCLUSIVE")
    except sqlite3.OperationalError as error:
        connection.close()
        if error.sqlite_errorname == "SQLITE_BUSY":
            return None
        raise
    return _FileLock(connection, path)


def _lock_on_server(engine: Engine, robot: RobotRecord, timeout_s: float) -> _ServerLock | None:
    """Take the lock, or None when somebody else has it."""
    connection = engine.connect().execution_options(isolation_level="AUTOCOMMIT")
    lock = _ServerLock(connection)
    try:
        connection.execute(text(f"SET lock_timeout = {max(1, round(timeout_s * 1000))}"))
        connection.execute(text("SELECT pg_advisory_lock(:kind, :robot)"), {"kind": LOCK_CLASS, "robot": robot.id})
        if is_leased(connection, robot.id):
            lock.give_back()
            return None
    except OperationalError as error:
        lock.release()
        if getattr(error.orig, "sqlstate", "") == _LOCK_NOT_AVAILABLE:
            return None
        raise
    return lock


_END = """
SELECT pg_terminate_backend(pid, 2000) FROM pg_locks
WHERE locktype = 'advisory' AND classid = :kind AND objid = :robot AND objsubid = 2 AND granted AND pid = :session
AND database = (SELECT oid FROM pg_database WHERE datname = current_database())
"""


def _end_session(engine: Engine, robot: RobotRecord, session: int) -> None:
    """End a session of ours that broke on the way: the server may not know it for hours, and keeps its lock."""
    with engine.connect() as connection:
        connection.execute(text(_END), {"kind": LOCK_CLASS, "robot": robot.id, "session": session})
