"""Reading many small things quickly: one connection that stays open, without a transaction around each query."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from msbot.registry.engine import AT_ONCE
from msbot.registry.faults import told_as_registry_error

_T = TypeVar("_T")


class Reader:
    """Reads for the event loop's thread; every statement sees what is stored when it runs.

    Taking a connection out of the pool, beginning and ending a transaction cost more than a query by an index does.

    Args:
        engine: where to read.
        database: the database in words.
    """

    def __init__(self, engine: Engine, database: str) -> None:
        self._engine = engine
        self._database = database
        self._connection: Connection | None = None

    def read(self, read: Callable[[Connection], _T]) -> _T:
        """Read something; a connection that has been cut is opened anew.

        Raises:
            RegistryError: the database cannot be read.
        """
        with told_as_registry_error(self._database):
            try:
                return read(self._open())
            except DBAPIError as error:
                self.close()
                if not error.connection_invalidated:
                    raise
            try:
                return read(self._open())
            except DBAPIError:
                self.close()
                raise

    def close(self) -> None:
        """Give the connection up; the next `read` opens another."""
        if self._connection is not None:
            # It must not go back to the pool as it is.
            self._connection.invalidate()
            self._connection.close()
            self._connection = None

    def _open(self) -> Connection:
        if self._connection is None:
            at_once = self._engine.execution_options(**{AT_ONCE: True})
            if at_once.dialect.name == "postgresql":
                at_once = at_once.execution_options(isolation_level="AUTOCOMMIT")
            self._connection = at_once.connect()
        return self._connection
