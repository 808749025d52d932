"""An open database: reading with a time limit, writing in order, and reporting what is not stored."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from time import monotonic
from typing import ParamSpec, TypeVar

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from msbot.process.daemon_threads import DaemonThreads
from msbot.registry.database.database_errors import told_as_registry_error, was_ended_for_standing_still
from msbot.registry.database.database_writer import DatabaseWriter
from msbot.registry.database.engine import (
    MAGIC,
    WAIT_S,
    WRITE,
    Address,
    identity_of,
    in_use,
    make_private,
    sqlite_address,
)
from msbot_agent.text.sentence import said
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import dataclass

# Guards the file of an SQLite database while it is used: somebody may delete or replace it.
#
# SQLite silently goes on writing to a deleted file; everything would be lost when the process ends. So the file is
# checked before each transaction: a deleted one is written again from what is still open; a replaced one is not
# touched, and the robot's own data are saved beside it.


_log = logging.getLogger(__name__)


class DatabaseFile:
    """Guards one file; all methods but the first belong to the writer's thread.

    Args:
        engine: its connections are discarded when the file is written again.
        path: the file, which must exist.
    """

    def __init__(self, engine: Engine, path: Path) -> None:
        self._engine = engine
        self._path = path
        self._rescued: Path | None = None
        self._is_closed = False
        self._open()

    def check(self) -> None:
        """Check that the file is still there; write it again if it was deleted.

        Raises:
            RegistryError: it is not the same file any more; the text says what to do.
        """
        try:
            if identity_of(self._path) != self._known:
                raise RegistryError(self._replaced())
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            if os.read(self._descriptor, len(MAGIC)) != MAGIC:
                raise RegistryError(
                    said(
                        "was overwritten by something else while the robot ran: stop the master, and put "
                        "a backup in its place"
                    )
                )
        except FileNotFoundError:
            self._put_back()
        except OSError as error:
            raise RegistryError(
                said("cannot be reached ({strerror}): look at the disk and its folder", strerror=error.strerror)
            ) from None

    def close(self) -> None:
        """Release the file, after all other connections are closed. A second call does nothing."""
        self._anchor.close()
        if not self._is_closed:
            self._is_closed = True
            self._forget()

    def _forget(self) -> None:
        os.close(self._descriptor)
        in_use[self._known] -= 1

    def _open(self) -> None:
        """Keep one connection open: through it a deleted file can still be read."""
        self._anchor = sqlite3.connect(sqlite_address(self._path), uri=True, check_same_thread=False)
        self._anchor.execute("PRAGMA schema_version").fetchone()
        self._known = identity_of(self._path)
        in_use[self._known] += 1
        self._descriptor = os.open(self._path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        """Stays open as long as any connection does, see `engine.in_use`."""

    def _put_back(self) -> None:
        part = self._path.with_name(f"{self._path.name}.part{os.getpid()}")
        try:
            self._copy(part)
            for ending in ("-wal", "-shm"):  # they belong to the file that is gone
                self._path.with_name(self._path.name + ending).unlink(missing_ok=True)
            part.replace(self._path)
        except (OSError, sqlite3.Error) as error:
            part.unlink(missing_ok=True)
            raise RegistryError(
                said(
                    "was deleted while the robot ran, and cannot be restored ({error}): look at its folder",
                    error=str(error),
                )
            ) from None
        self._anchor.close()
        self._engine.dispose()
        self._forget()
        self._open()
        _log.warning("the database %s was deleted while the robot ran; it is restored with all it had", self._path)

    def _replaced(self) -> str:
        if self._rescued is None:
            number = 1
            while (kept := self._path.with_name(f"{self._path.name}.rescued.{number}")).exists():
                number += 1
            with contextlib.suppress(OSError, sqlite3.Error):
                self._copy(kept)
                self._rescued = kept
        kept_words = "" if self._rescued is None else f"; what the robot had is kept in {self._rescued}"
        return (
            "was replaced by another file while the robot ran: stop the master, and look which of the two is wanted"
            + kept_words
        )

    def _copy(self, target: Path) -> None:
        make_private(target)
        with closing(sqlite3.connect(target)) as copy:
            self._anchor.backup(copy)


SLOWEST_S = 5.0
"""How long a person waits for a change at a running robot, in addition to the database's wait for another program."""
UNHURRIED_S = 60.0
"""How long a command waits for a change while no robot runs in its process."""
LOOP_PATIENCE_S = 0.4
"""How long a change waits for another program when a robot runs in this process, because people are waiting."""
LIMIT_S = 2.5
"""How long a read for a page or command may take; NiceGUI gives up on a page that is not built within 3 s."""
CATCH_UP_S = 0.5
"""How long a reader waits until earlier notes are stored."""
STOOD_STILL = 3
"""How often a transaction is begun again that the server ended because this process did nothing in it for a second."""
READERS = 4
"""How many readers are served at the same time."""
MOST_WAITING = 64
"""How many more readers may wait; further ones are turned away."""

_BROKEN_OFF = said("cannot be reached")
"""What a cable that was pulled out would say."""

_P = ParamSpec("_P")
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class StorageHealth:
    """What a running robot has not been able to store in its database, for pages and commands."""

    trouble: str | None
    """Why changes are not being stored at the moment, in words; None if all is well."""
    waiting: int
    """Changes kept in memory until they can be stored."""
    lost: int
    """Changes that were dropped since the start: too many were waiting, or the database did not accept them."""

    @property
    def is_well(self) -> bool:
        """Whether everything is stored, or about to be."""
        return self.trouble is None and self.lost == 0


class Storage:
    """The foundation of the registry's components; see `Registry`."""

    def __init__(
        self,
        engine: Engine,
        address: Address,
        epoch_ns: Callable[[], int],
        *,
        busy_timeout_s: float,
        read_only: bool,
    ) -> None:
        self.engine = engine
        self.address = address
        self.epoch_ns = epoch_ns
        self.busy_timeout_s = busy_timeout_s
        self.runs_a_robot = False
        """Whether parts and people depend on this process."""
        self._file = None if read_only or address.path is None else DatabaseFile(engine, address.path)
        self._is_broken_off = False
        self._writer = None if read_only else DatabaseWriter(engine, address.words, check=self._check)
        self._threads = DaemonThreads(READERS, "msbot registry reader")
        self._asking: dict[int, float] = {}
        """When each reader that is being served or waiting made its request."""
        self._asked = 0

    @property
    def describe(self) -> str:
        """The database in words, without a password."""
        return self.address.words

    @property
    def health(self) -> StorageHealth:
        """What is not stored."""
        writer = self._writer
        return (
            StorageHealth(None, 0, 0) if writer is None else StorageHealth(writer.trouble, writer.pending, writer.lost)
        )

    @property
    def writer(self) -> DatabaseWriter:
        """The thread that writes.

        Raises:
            RegistryError: the database was opened for reading only.
        """
        if self._writer is None:
            raise RegistryError(f"the database {self.describe} was opened for reading only")
        return self._writer

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything handed over so far is stored; False: it cannot be at the moment (see `health`)."""
        return self._writer is None or self._writer.flush(timeout_s)

    def catch_up(self) -> None:
        """Give what was handed over a moment to be stored, so that the next reader sees it; not for the event loop."""
        if self.runs_a_robot:
            self.flush(CATCH_UP_S)

    def read(self, read: Callable[[Connection], _T]) -> _T:
        """Read in one transaction; waits for the database.

        Raises:
            RegistryError: it cannot be read.
        """
        if self._is_broken_off:
            raise RegistryError(said("the database {database} {fault}", database=self.describe, fault=_BROKEN_OFF))
        with told_as_registry_error(self.describe), self.engine.connect() as connection:
            return read(connection)

    def break_off(self, *, broken: bool) -> None:
        """Behave as if the database were gone, or end that: for faults on purpose.

        Nothing is lost: notes wait in memory, as when the database is really gone.
        """
        self._is_broken_off = broken

    def _check(self) -> None:
        """Called before each transaction of the writer."""
        if self._is_broken_off:
            raise RegistryError(_BROKEN_OFF)
        if self._file is not None:
            self._file.check()

    @property
    def patience_s(self) -> float:
        """How long a change waits for another program that is writing."""
        return min(LOOP_PATIENCE_S, self.busy_timeout_s) if self.runs_a_robot else self.busy_timeout_s

    @property
    def limit_s(self) -> float:
        """How long somebody waits for a change."""
        return (SLOWEST_S if self.runs_a_robot else UNHURRIED_S) + self.patience_s

    def change(self, change: Callable[[Connection], _T]) -> _T:
        """Make a change after everything that was handed over before, and wait for it.

        Raises:
            RegistryError: it cannot be stored; nothing has changed.
        """
        return self.writer.submit(change, wait_s=self.patience_s).wait(self.limit_s)

    def write(self, write: Callable[[Connection], _T]) -> _T:
        """Write in one transaction, at once; only before a robot runs. It may be called more than once.

        Raises:
            RegistryError: it cannot be written; nothing has changed.
        """
        engine = self.engine.execution_options(**{WRITE: True, WAIT_S: self.busy_timeout_s})
        with told_as_registry_error(self.describe):
            for _ in range(STOOD_STILL):
                try:
                    with engine.connect() as connection, connection.begin():
                        return write(connection)
                except DBAPIError as error:
                    if not was_ended_for_standing_still(error):
                        raise
            with engine.connect() as connection, connection.begin():
                return write(connection)

    async def in_time(self, ask: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Call something that reads or changes the database, without blocking the event loop.

        Raises:
            RegistryError: the database does not answer in time; also whatever `ask` raises.
        """
        now = monotonic()
        asked = [*self._asking.values()]
        if len(asked) >= READERS + MOST_WAITING or (len(asked) >= READERS and min(asked) < now - LIMIT_S):
            raise RegistryError(self._no_answer())
        self._asked += 1
        number = self._asked
        self._asking[number] = now
        is_served = False

        def serve() -> _T:
            nonlocal is_served
            is_served = True
            try:
                return ask(*args, **kwargs)
            finally:
                # Not before: a reader that hangs is busy, whether or not somebody still waits for what it reads.
                self._asking.pop(number, None)

        answer = asyncio.get_running_loop().run_in_executor(self._threads, serve)
        done, _ = await asyncio.wait({answer}, timeout=LIMIT_S)
        if not done:
            answer.cancel()  # what it still raises is nobody's then
            if not is_served:
                self._asking.pop(number, None)
            raise RegistryError(self._no_answer())
        return answer.result()

    def close(self) -> bool:
        """Store what is waiting and close the database. False: something could not be stored."""
        is_stored = self._writer is None or self._writer.close()
        self._threads.shutdown()
        self.engine.dispose()
        if self._file is not None:
            self._file.close()
        return is_stored

    def _no_answer(self) -> str:
        return self.health.trouble or f"the database {self.describe} does not answer: try again in a moment"
