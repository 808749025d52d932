"""A database of the first MsBOT comes through all migrations with its rows, on both kinds of database."""

import shutil
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, Engine, create_engine, inspect, make_url, text

from msbot.registry import open_registry
from msbot.registry.database import schema
from msbot.registry.database.engine import make_engine, parse_address
from msbot.registry.database.schema import Migrations, bring_up_to_date, folder_migrations, own_migrations
from msbot.registry.database.tables import metadata
from msbot.registry.maintenance import upkeep
from tests.registry.hand import Hand

FIRST_ROWS = (
    "INSERT INTO robots VALUES (1, 'R2', '007', 'V1', 'today', 'us', 1.0, 2.0, 3, 5.0, {false}, '[]', 5)",
    "INSERT INTO slots VALUES (1, 1, 'left', 0, 'EYE', '', 'an eye', {true}, 4)",
    "INSERT INTO bindings VALUES (1, 1, 'light', 'Light', 1, 'light', {true}, {true})",
    "INSERT INTO settings VALUES (1, 'period_s', 'library', '0.5', 5)",
    "INSERT INTO settings VALUES (1, 'period_s', 'hand', '2', 6)",
    "INSERT INTO library VALUES ('EYE', 'Eye', 'us', '', '5V', '', '[]', '[{{\"name\": \"light\", \"direction\": "
    "\"publish\", \"type\": \"Light\", \"rate_hz\": 1.0, \"safe\": null}}]', '[{{\"name\": \"period_s\", \"type\": "
    "\"float\", \"default\": 0.5, \"unit\": \"s\", \"min\": null, \"max\": null, \"description\": \"\"}}]', 'x', 'y')",
    "INSERT INTO parts VALUES (1, '0011223344556677', '0011223344556677', 'EYE', 'one', 1, 'lost', 'why', 'udp', 5, 6)",
    "INSERT INTO blocks VALUES ('number', 'LEG', 'hot', 5)",
)  # fmt: skip


@pytest.fixture
def first(tmp_path: Path) -> Migrations:
    """The migrations as the first MsBOT had them."""
    folder = tmp_path / "first"
    shutil.copytree(str(files("msbot.registry") / "migrations"), folder)
    for path in (folder / "versions").glob("v*.py"):
        if not path.name.startswith("v0001"):
            path.unlink()
    return folder_migrations(folder)


@pytest.fixture
def old_address(backend: str, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """A database that is empty: no tables, no rows."""
    if backend == "sqlite":
        yield str(tmp_path / "old.db")
        return
    server: str = request.getfixturevalue("server")
    url = make_url(server.format("postgres")).set(drivername="postgresql+psycopg")
    engine = create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(text("CREATE DATABASE old"))
    yield server.format("old")
    with engine.connect() as connection:
        connection.execute(text("DROP DATABASE old WITH (FORCE)"))
    engine.dispose()


def _fill(engine: Engine) -> None:
    words = {"true": "true", "false": "false"}
    with engine.begin() as connection:
        for statement in FIRST_ROWS:
            connection.exec_driver_sql(statement.format(**words))


def test_the_first_database_is_brought_up_to_date(old_address: str, first: Migrations) -> None:
    where = parse_address(old_address)
    engine = make_engine(where, busy_timeout_s=1, read_only=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(schema, "_write_comments", lambda connection: None)  # it knows today's columns only
        bring_up_to_date(engine, where, first)
    _fill(engine)
    engine.dispose()
    assert upkeep.migrate(old_address) == upkeep.Migrated(1, own_migrations().newest)
    assert upkeep.check(old_address) == []
    with open_registry(old_address) as registry:
        (robot,) = registry.robots.all()
        (value,) = registry.robots.values(robot, "left")
        assert (value.value, value.origin, value.who) == (2, "hand", "")
        store = registry.runs.begin(robot)
        assert store.configuration("left").version == 4
        assert [binding.topic for binding in store.configuration("left").bindings] == ["light"]
        assert store.remembered_slot(bytes.fromhex("0011223344556677")) == "left"
        assert store.placed_slot(bytes.fromhex("0011223344556677")) is None
        assert store.blocked(b"", "LEG") == "hot"
        assert registry.robots.blueprint(robot).options.authentication == "open"
        assert (registry.edits.latest(robot), registry.users.all(), registry.keys.all()) == ([], [], [])
        assert Hand(registry).set_value(robot, "left", "period_s", None, "Ann").words == (
            "period_s of left: 2 s -> 0.5 s (the library's)"
        )


def test_a_new_database_is_the_same_as_one_that_went_through_all_migrations(old_address: str) -> None:
    where = parse_address(old_address)
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
