"""How a database is: its schema, its size, whether it can be written, what is wrong in it. Changes nothing."""

from __future__ import annotations

import sqlite3
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from sqlalchemy import func, select

from msbot.registry.database.database_errors import told_as_registry_error
from msbot.registry.database.engine import check_file, make_engine, parse_address, sqlite_address
from msbot.registry.database.schema import own_migrations, read_version
from msbot.registry.database.tables import journal, robots
from msbot.registry.maintenance import database_maintenance
from msbot.registry.registry import BUSY_TIMEOUT_S
from msbot_xrce.lazy import dataclass

MB = 1_000_000
WAIT_S = 0.5
"""How long another program may be writing before the database counts as locked."""


@dataclass(frozen=True, slots=True)
class DatabaseHealth:
    """What `look_at_health` saw."""

    words: str
    """The database, without a password."""
    path: Path | None
    """None: it is on a server."""
    schema: int
    newest_schema: int
    """The schema that this MsBOT uses."""
    size_mb: float
    log_mb: float
    """SQLite's write-ahead log."""
    is_locked: bool
    others_may_read: bool
    faults: tuple[str, ...]
    """Damage and contradictions; empty as well when the schema is another one, which is not read."""
    newest_record_ns: int | None
    """The newest line of the journal, nanoseconds since 1970."""
    oldest_ns: int | None
    """When the first robot was put in."""


def look_at_health(address: str, *, thorough: bool = True) -> DatabaseHealth:
    """Look at a database.

    Args:
        address: as for `open_registry`.
        thorough: read every row for damage and contradictions.

    Raises:
        RegistryError: it is not there, is no database, or is of another program.
    """
    where = parse_address(address)
    check_file(where, create=False, read_only=True)
    known = own_migrations()
    engine = make_engine(where, busy_timeout_s=BUSY_TIMEOUT_S, read_only=True)
    path = where.path
    newest_record = oldest = None
    faults: tuple[str, ...] = ()
    try:
        schema = read_version(engine, where, replace(known, newest=sys.maxsize))  # a newer one is told, too
        if schema == known.newest:
            with told_as_registry_error(where.words), engine.connect() as connection:
                newest_record = connection.execute(select(func.max(journal.c.at_ns))).scalar()
                oldest = connection.execute(select(func.min(robots.c.applied_ns))).scalar()
                first = connection.execute(select(func.min(journal.c.at_ns))).scalar()
                oldest = min((moment for moment in (oldest, first) if moment), default=None)
                faults = tuple(database_maintenance.find(connection)) if thorough else ()
    finally:
        engine.dispose()
    log = None if path is None else path.with_name(f"{path.name}-wal")
    return DatabaseHealth(
        words=where.words,
        path=path,
        schema=schema,
        newest_schema=known.newest,
        size_mb=0.0 if path is None else path.stat().st_size / MB,
        log_mb=log.stat().st_size / MB if log is not None and log.exists() else 0.0,
        is_locked=path is not None and _is_locked(path),
        others_may_read=path is not None and bool(path.stat().st_mode & 0o004),
        faults=faults,
        newest_record_ns=newest_record,
        oldest_ns=oldest,
    )


def _is_locked(path: Path) -> bool:
    """Whether nobody can write: the lock is asked for, and given back at once."""
    with closing(sqlite3.connect(sqlite_address(path), uri=True, timeout=WAIT_S, isolation_level=None)) as connection:
        try:
            connection.execute("BEGIN IMMEDIATE")
            connection.execute("ROLLBACK")
        except sqlite3.OperationalError as error:
            return error.sqlite_errorname in ("SQLITE_BUSY", "SQLITE_LOCKED")
    return False
