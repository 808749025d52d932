"""Maintaining a database: migrate it, copy it, restore a copy, look for contradictions.

A backup is always one SQLite file with all rows, whatever the database is: it can be restored to a file or to a server,
and inspected with any SQLite tool.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from sqlalchemy import Connection, Engine, delete, func, insert, select, text

from msbot.registry.database import statements as store
from msbot.registry.database.database_errors import told_as_registry_error
from msbot.registry.database.engine import WRITE, Address, check_file, make_engine, make_private, parse_address
from msbot.registry.database.schema import Migrations, own_migrations, read_version
from msbot.registry.database.tables import metadata
from msbot.registry.maintenance import consistency as findings
from msbot.registry.maintenance.backup_check import check_backup
from msbot.registry.registry import BUSY_TIMEOUT_S, open_registry
from msbot.registry.running import run_lock
from msbot_agent.text.sentence import said, without
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import RegistryError

_ROWS = 1000
"""How many rows are copied at a time."""
MOST_OF_PAGE = 256 * 1024 * 1024
"""Octets of the largest backup that a page takes back."""


def too_large_for_page(size: int) -> str:
    """What to know about a backup of so many octets; empty: nothing, a page takes it back."""
    if size <= MOST_OF_PAGE:
        return ""
    return said(
        "the backup has {size} MB, and a page takes back {most} MB: `msbot db restore` takes it, while no master runs",
        size=(size >> 20) + 1, most=MOST_OF_PAGE >> 20,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Migrated:
    """What `migrate` did."""

    before: int
    """Schema before; 0 when the database was empty."""
    after: int


def migrate(address: str, *, migrations: Migrations | None = None) -> Migrated:
    """Bring an older database up to date, after backing it up; one that is up to date is left alone.

    Raises:
        RegistryError: it is not there, is newer, or cannot be written.
    """
    known = migrations or own_migrations()
    where, engine = _open(address)
    try:
        before = read_version(engine, where, known)
    finally:
        engine.dispose()
    open_registry(address, create=False, migrations=known).close()
    return Migrated(before, known.newest)


def back_up(address: str, target: Path) -> int:
    """Copy a database to a new SQLite file while it is in use; returns the number of rows.

    Raises:
        RegistryError: it is not there or not up to date, the file exists, or cannot be written.
    """
    if target.exists():
        raise RegistryError(said("{target} exists already and is not overwritten: name another file", target=target))
    open_registry(address, read_only=True).close()
    where, engine = _open(address)
    part = target.with_name(f"{target.name}.part{os.getpid()}")
    try:
        try:
            open_registry(part).close()
        except RegistryError as error:
            raise RegistryError(without(str(error), ("words", "path", "database"), str(target))) from error
        copy = make_engine(parse_address(part), busy_timeout_s=BUSY_TIMEOUT_S, read_only=False)
        try:
            with told_as_registry_error(where.words), _snapshot(engine, where) as source:
                with told_as_registry_error(str(target)), _writing(copy) as connection, connection.begin():
                    rows = _copy(source, connection)
                with told_as_registry_error(str(target)), copy.connect() as connection:
                    # The copy should be a single file.
                    connection.exec_driver_sql("COMMIT")
                    connection.exec_driver_sql("PRAGMA journal_mode = DELETE")
        finally:
            copy.dispose()
        part.replace(target)
    finally:
        for ending in ("", "-wal", "-shm", "-journal"):  # a disk that is full leaves more than the file itself
            part.with_name(f"{part.name}{ending}").unlink(missing_ok=True)
        engine.dispose()
    return rows


def find_backup(source: Path) -> None:
    """See that there is a file that may be a backup.

    Raises:
        RegistryError: there is none, or it cannot be read.
    """
    if not source.exists():
        raise RegistryError(
            said("there is no backup {source}: name a file that `msbot db backup` has written", source=source)
        )
    check_file(parse_address(source), create=False, read_only=True)


def restore(source: Path, address: str) -> Path | None:
    """Replace the content of a database by that of a backup; returns a copy of the old content if it had robots.

    Raises:
        RegistryError: the backup or the database cannot be used, or a master is running one of its robots.
    """
    find_backup(source)
    with tempfile.TemporaryDirectory(prefix="msbot-restore-") as folder:
        copy = Path(folder) / source.name
        make_private(copy)
        shutil.copyfile(source, copy)
        check_backup(copy, needs_administrator=False)
        open_registry(address).close()
        where, engine = _open(address)
        try:
            kept = _keep_aside(address, where, engine)
            _replace(copy, where, engine)
        finally:
            engine.dispose()
    return kept


def check(address: str) -> list[str]:
    """What is wrong in a database, one sentence each; empty when nothing is.

    Raises:
        RegistryError: it is not there, not up to date, or cannot be read.
    """
    open_registry(address, read_only=True).close()
    where, engine = _open(address)
    try:
        with told_as_registry_error(where.words), engine.connect() as connection:
            return findings.find(connection)
    finally:
        engine.dispose()


def _open(address: str) -> tuple[Address, Engine]:
    where = parse_address(address)
    check_file(where, create=False, read_only=True)
    return where, make_engine(where, busy_timeout_s=BUSY_TIMEOUT_S, read_only=False)


def _keep_aside(address: str, where: Address, engine: Engine) -> Path | None:
    with told_as_registry_error(where.words), engine.connect() as connection:
        robots = store.list_robots(connection)
    for robot in robots:
        if run_lock.is_run(engine, where, robot):
            raise RegistryError(
                said(
                    "robot {name} is being run with the database {words}: stop its master first",
                    name=robot.name,
                    words=where.words,
                )
            )
    if not robots:
        return None
    beside = where.path or Path(f"{where.url.database}.db")
    number = 1
    while (kept := beside.with_name(f"{beside.name}.replaced.{number}.backup")).exists():
        number += 1
    back_up(address, kept)
    return kept


def _replace(copy: Path, where: Address, engine: Engine) -> None:
    source_engine = make_engine(parse_address(copy), busy_timeout_s=BUSY_TIMEOUT_S, read_only=True)
    try:
        with (
            told_as_registry_error(where.words),
            source_engine.connect() as source,
            _writing(engine) as connection,
            connection.begin(),
        ):
            for table in reversed(metadata.sorted_tables):
                connection.execute(delete(table))
            _copy(source, connection)
    finally:
        source_engine.dispose()


def _snapshot(engine: Engine, where: Address) -> Connection:
    """A connection that sees the database at one moment, however long it reads."""
    connection = engine.connect()
    return connection if where.path else connection.execution_options(isolation_level="REPEATABLE READ")


def _writing(engine: Engine) -> Connection:
    return engine.execution_options(**{WRITE: True}).connect()


def _copy(source: Connection, target: Connection) -> int:
    """Copy all rows into empty tables; counters continue after them."""
    count = 0
    for table in metadata.sorted_tables:
        for rows in source.execution_options(yield_per=_ROWS).execute(select(table)).partitions():
            target.execute(insert(table), [row._asdict() for row in rows])
            count += len(rows)
        if target.dialect.name == "postgresql" and "id" in table.columns:
            newest = target.execute(select(func.max(table.c.id))).scalar() or 0
            sequence = text(f"SELECT setval(pg_get_serial_sequence('{table.name}', 'id'), :next, false)")
            target.execute(sequence, {"next": newest + 1})
    return count
