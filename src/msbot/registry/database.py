"""An open database: reading at once, writing in order, and saying what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from sqlalchemy import Connection, Engine

from msbot.errors import RegistryError
from msbot.registry.engine import WAIT_S, WRITE, Address
from msbot.registry.faults import told_as_registry_error
from msbot.registry.writer import Writer

SLOWEST_S = 1.0
"""So long a change waits for those before it to reach the disk."""
LOOP_PATIENCE_S = 0.4
"""So long a change waits for another program when a robot runs in this process: its parts must not be kept waiting."""

_T = TypeVar("_T")


class Database:
    """What the registry stands on; see `Registry`."""

    def __init__(
        self,
        engine: Engine,
        address: Address,
        epoch_ns: Callable[[], int],
        *,
        busy_timeout_s: float,
        read_only: bool,
    ) -> None:
        self.database = address.words
        """The database in words, without a password."""
        self._address = address
        self._busy_timeout_s = busy_timeout_s
        self._runs_a_robot = False
        self._engine = engine
        self._epoch_ns = epoch_ns
        self._writer = None if read_only else Writer(engine, address.words)

    @property
    def trouble(self) -> str | None:
        """Why changes are not being stored at the moment, in words; None when all is well."""
        return None if self._writer is None else self._writer.trouble

    @property
    def lost(self) -> int:
        """Changes that could not be stored and were given up."""
        return 0 if self._writer is None else self._writer.lost

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything told so far is stored; False: it cannot be at the moment (see `trouble`)."""
        return self._writer is None or self._writer.flush(timeout_s)

    def _in_order(self, write: Callable[[Connection], _T]) -> _T:
        """Write after everything that was told before; a writer in trouble means that nothing can be changed."""
        writer = self._open_writer()
        busy_s = min(LOOP_PATIENCE_S, self._busy_timeout_s) if self._runs_a_robot else self._busy_timeout_s
        if not writer.flush(SLOWEST_S if self._runs_a_robot else SLOWEST_S + busy_s):
            busy = f"the database {self.database} is busy: try again"
            raise RegistryError(f"nothing was changed: {writer.trouble or busy}")
        return self._write(write, busy_s)

    def _open_writer(self) -> Writer:
        if self._writer is None:
            raise RegistryError(f"the database {self.database} was opened for reading only")
        return self._writer

    def _read(self, read: Callable[[Connection], _T]) -> _T:
        with told_as_registry_error(self.database), self._engine.connect() as connection:
            return read(connection)

    def _write(self, write: Callable[[Connection], _T], busy_s: float | None = None) -> _T:
        """Write in one transaction, waiting at most that long for another program."""
        self._open_writer()
        wait_s = self._busy_timeout_s if busy_s is None else busy_s
        engine = self._engine.execution_options(**{WRITE: True, WAIT_S: wait_s})
        with told_as_registry_error(self.database), engine.connect() as connection, connection.begin():
            return write(connection)
