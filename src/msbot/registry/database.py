"""An open database: reading at once, writing in order, and saying what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from sqlalchemy import Connection, Engine

from msbot.errors import RegistryError
from msbot.registry.engine import WRITE, Address
from msbot.registry.faults import told_as_registry_error
from msbot.registry.writer import Writer

SLOWEST_S = 1.0
"""So long a change waits, besides the time that another program may hold the database, for those before it."""

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
        if not writer.flush(self._busy_timeout_s + SLOWEST_S):
            raise RegistryError(f"nothing was changed: {writer.trouble or f'the database {self.database} is too slow'}")
        return self._write(write)

    def _open_writer(self) -> Writer:
        if self._writer is None:
            raise RegistryError(f"the database {self.database} was opened for reading only")
        return self._writer

    def _read(self, read: Callable[[Connection], _T]) -> _T:
        with told_as_registry_error(self.database), self._engine.connect() as connection:
            return read(connection)

    def _write(self, write: Callable[[Connection], _T]) -> _T:
        self._open_writer()
        engine = self._engine.execution_options(**{WRITE: True})
        with told_as_registry_error(self.database), engine.connect() as connection, connection.begin():
            return write(connection)
