"""The version of the tables: finding it, refusing a newer one, bringing an older one up to date after a backup."""

from __future__ import annotations

import logging
import re
import sqlite3
from contextlib import closing
from importlib.resources import files
from pathlib import Path

from sqlalchemy import Connection, Engine, column, inspect, literal, select, text
from sqlalchemy import table as table_named
from sqlalchemy.schema import CreateSchema, SetColumnComment

from msbot.registry.database.database_errors import told_as_registry_error
from msbot.registry.database.engine import WRITE, Address, make_private
from msbot.registry.database.tables import metadata
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import dataclass

_VERSION_TABLE = "alembic_version"
_MIGRATION_LOCK = 0x4D734254_4D494752
"""Number of the lock on the server that lets only one process at a time change the tables."""
_FILE = re.compile(r"v(\d{4})_\w+\.py")

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Migrations:
    """A folder of numbered migrations."""

    location: str
    """As Alembic expects it: a folder, or `package:folder`."""
    newest: int
    """The version of the schema after the last migration."""


def own_migrations() -> Migrations:
    """The migrations that come with MsBOT."""
    return Migrations("msbot.registry:migrations", _newest(files("msbot.registry") / "migrations" / "versions"))


def folder_migrations(folder: Path) -> Migrations:
    """The migrations in a folder laid out like `msbot/registry/migrations`."""
    return Migrations(str(folder), _newest(folder / "versions"))


def _newest(versions: object) -> int:
    assert hasattr(versions, "iterdir")
    found = [_FILE.fullmatch(entry.name) for entry in versions.iterdir()]
    return max(int(match[1]) for match in found if match)


def read_version(engine: Engine, address: Address, migrations: Migrations) -> int:
    """The schema of the database; 0: it is empty.

    Raises:
        RegistryError: it is newer, belongs to another program, or cannot be read.
    """
    with told_as_registry_error(address.words), engine.connect() as connection:
        return _version(connection, address, migrations.newest)


def bring_up_to_date(engine: Engine, address: Address, migrations: Migrations) -> None:
    """Create the tables of a new database; back up and migrate an older one. One transaction.

    Raises:
        RegistryError: see `read_version`; or it cannot be written.
    """
    with (
        told_as_registry_error(address.words),
        engine.execution_options(**{WRITE: True}).connect() as connection,
        connection.begin(),
    ):
        if address.path is None:
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_MIGRATION_LOCK})"))
        # Another process may have done it since the check.
        version = _version(connection, address, migrations.newest)
        if version == migrations.newest:
            return
        if version == 0 and migrations == own_migrations():
            _create(connection, migrations.newest)
            return
        if version > 0:
            copy = _back_up(address.path, version) if address.path else _back_up_on_server(connection, version)
            _log.warning(
                "the database %s is of schema %d and is brought to %d; a copy is kept in %s",
                address.words,
                version,
                migrations.newest,
                copy,
            )
        _upgrade(connection, migrations.location)
        _write_comments(connection)


def _version(connection: Connection, address: Address, newest: int) -> int:
    """The schema of the database; 0 when it is empty."""
    tables = inspect(connection).get_table_names()
    if _VERSION_TABLE not in tables:
        if tables:
            some = ", ".join(tables[:3])
            raise RegistryError(
                said(
                    "the database {words} belongs to another program (it has {some}): {other}",
                    words=address.words,
                    some=some,
                    other=_OTHER,
                )
            )
        return 0
    row = connection.execute(text(f"SELECT version_num FROM {_VERSION_TABLE}")).scalar()
    if row is None or not str(row).isdecimal():
        raise RegistryError(
            said(
                "the database {words} belongs to another program (schema {row!r}): {other}",
                words=address.words,
                row=row,
                other=_OTHER,
            )
        )
    version = int(row)
    if version > newest:
        raise RegistryError(_newer(connection, address, version, newest))
    return version


def _newer(connection: Connection, address: Address, version: int, newest: int) -> Sentence:
    """Why it cannot be used, what this version could not keep of it, and where the state before the update is."""
    words = said(
        "the database {words} was written by a newer MsBOT (schema {version}, this one knows {newest}): "
        "update MsBOT or choose another --db",
        words=address.words,
        version=version,
        newest=newest,
    )
    lost = _unknown(connection)
    copies = sorted(address.path.parent.glob(f"{address.path.name}.schema*.backup")) if address.path else []
    if lost:
        shown = ", ".join(lost[:_SHOWN]) + (", ..." if len(lost) > _SHOWN else "")
        words = said("{words}; a downgrade loses {lost}", words=words, lost=shown)
    if copies:
        newest_copy = max(copies, key=lambda path: path.stat().st_mtime_ns)
        words = said("{words}; the copy from before the update is {copy}", words=words, copy=newest_copy.name)
    if address.path is None:
        if schemas := [name for name in inspect(connection).get_schema_names() if _COPY.fullmatch(name)]:
            names = ", ".join(schemas[-_SHOWN:])
            words = said("{words}; copies from before updates are its schemas {names}", words=words, names=names)
        words = said("{words}; a backup can be restored into an empty database (`createdb NAME`)", words=words)
    return words


_COPY = re.compile(r"msbot_schema\d+_\d+_backup")
_SHOWN = 8
"""Of tables and columns that a downgrade loses: their names in a sentence."""


def _unknown(connection: Connection) -> list[str]:
    """Tables and columns with content that this version does not know."""
    found = []
    inspector = inspect(connection)
    for name in sorted({*inspector.get_table_names()} - {_VERSION_TABLE}):
        rows = select(literal(1)).select_from(table_named(name))
        known = metadata.tables.get(name)
        if known is None:
            looks = {name: rows}
        else:
            strange = sorted({one["name"] for one in inspector.get_columns(name)} - {*known.c.keys()})
            looks = {f"{name}.{one}": rows.where(column(one).is_not(None)) for one in strange}
        found += [words for words, look in looks.items() if connection.execute(select(look.exists())).scalar()]
    return found


_OTHER = said("choose another --db")


def _back_up(path: Path, version: int) -> Path:
    """Copy the database to a file beside it with an unused name; returns the path of the copy."""
    number = 1
    while (copy := path.with_name(f"{path.name}.schema{version}.{number}.backup")).exists():
        number += 1
    make_private(copy)
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(copy)) as target:
        source.backup(target)
    return copy


def _back_up_on_server(connection: Connection, version: int) -> str:
    """Copy the tables into a schema with an unused name in the same database; returns its name in words."""
    inspector = inspect(connection)
    number, known = 1, inspector.get_schema_names()
    while (name := f"msbot_schema{version}_{number}_backup") in known:
        number += 1
    connection.execute(CreateSchema(name))
    for table in inspector.get_table_names():
        connection.execute(text(f'CREATE TABLE {name}."{table}" AS TABLE "{table}"'))
    return f"its schema {name}"


def _create(connection: Connection, newest: int) -> None:
    """Make the newest tables at once: quicker than all migrations, which lead to the same (a test compares the two)."""
    metadata.create_all(connection, checkfirst=False)
    columns = f"version_num VARCHAR(32) NOT NULL, CONSTRAINT {_VERSION_TABLE}_pkc PRIMARY KEY (version_num)"
    connection.execute(text(f"CREATE TABLE {_VERSION_TABLE} ({columns})"))
    connection.execute(text(f"INSERT INTO {_VERSION_TABLE} VALUES ('{newest:04}')"))


def _upgrade(connection: Connection, location: str) -> None:
    # Imported here because that takes long, and a database needs it only when MsBOT is newer than it.
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", location)
    config.set_main_option("path_separator", "os")
    config.attributes["connection"] = connection
    command.upgrade(config, "head")


def _write_comments(connection: Connection) -> None:
    """Store each column's comment in the database, if it supports comments."""
    if connection.dialect.supports_comments:
        for table in metadata.sorted_tables:
            for column in table.columns:
                connection.execute(SetColumnComment(column))
