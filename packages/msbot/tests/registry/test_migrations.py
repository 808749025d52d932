"""All migrations in turn make the tables that a new database has, on both kinds of database."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, create_engine, inspect, make_url, text

from msbot.registry.database import schema
from msbot.registry.database.engine import make_engine, parse_address
from msbot.registry.database.schema import bring_up_to_date, own_migrations
from msbot.registry.database.tables import metadata


@pytest.fixture
def empty_address(backend: str, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """A database that is empty: no tables, no rows."""
    if backend == "sqlite":
        yield str(tmp_path / "empty.db")
        return
    server: str = request.getfixturevalue("server")
    url = make_url(server.format("postgres")).set(drivername="postgresql+psycopg")
    engine = create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(text("CREATE DATABASE empty"))
    yield server.format("empty")
    with engine.connect() as connection:
        connection.execute(text("DROP DATABASE empty WITH (FORCE)"))
    engine.dispose()


def test_a_new_database_is_the_same_as_one_that_went_through_all_migrations(empty_address: str) -> None:
    where = parse_address(empty_address)
    engine = make_engine(where, busy_timeout_s=1, read_only=False)
    with engine.begin() as connection:
        schema._upgrade(connection, own_migrations().location)
        schema._write_comments(connection)
        migrated = _tables(connection)
        for name in inspect(connection).get_table_names():
            connection.execute(text(f"DROP TABLE {name}" + (" CASCADE" if where.path is None else "")))
    bring_up_to_date(engine, where, own_migrations())
    with engine.connect() as connection:
        assert _tables(connection) == migrated
        assert len(migrated) == len(metadata.tables) + 1
    engine.dispose()


def _tables(connection: Connection) -> dict[str, dict[str, list[str]]]:
    """All that a database says of its tables, in no order."""
    see = inspect(connection)
    looks = {
        "columns": see.get_columns,
        "key": see.get_pk_constraint,
        "references": see.get_foreign_keys,
        "unique": see.get_unique_constraints,
        "indexes": see.get_indexes,
        "rules": see.get_check_constraints,
    }
    return {
        name: {what: _sorted(look(name)) for what, look in looks.items()} | {"rows": _version_rows(connection, name)}
        for name in see.get_table_names()
    }


def _sorted(found: Any) -> list[str]:
    rows = found if isinstance(found, list) else [found]
    return sorted(str(sorted((key, str(value)) for key, value in row.items())) for row in rows)


def _version_rows(connection: Connection, table: str) -> list[str]:
    return [str(row) for row in connection.execute(text(f"SELECT * FROM {table}"))]
