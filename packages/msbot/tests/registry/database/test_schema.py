"""Versions of the tables: empty, current, older, newer, another program's."""

import shutil
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing
from importlib.resources import files
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine, create_mock_engine

from msbot.config import Blueprint, Library
from msbot.registry import Registry, open_registry
from msbot.registry.database import schema
from msbot.registry.database.engine import make_engine, parse_address
from msbot.registry.database.schema import Migrations, bring_up_to_date, folder_migrations, own_migrations, read_version
from msbot.registry.database.tables import metadata
from msbot.registry.maintenance import database_maintenance
from msbot.registry.read_only_database import lock_file
from msbot_xrce.errors import RegistryError

NOW = own_migrations().newest
NEXT = f"""
from alembic import op
import sqlalchemy as sa

revision = "{NOW + 1:04}"
down_revision = "{NOW:04}"


def upgrade() -> None:
    op.add_column("robots", sa.Column("colour", sa.Text, nullable=False, server_default="red"))
"""

BROKEN = NEXT + '    op.execute("this is no SQL")\n'


@pytest.fixture
def engine(path: Path) -> Iterator[Engine]:
    engine = make_engine(parse_address(path), busy_timeout_s=0.01, read_only=False)
    yield engine
    engine.dispose()


def _migrations(tmp_path: Path, script: str) -> Migrations:
    """MsBOT's own migrations and one more."""
    folder = tmp_path / "migrations"
    shutil.copytree(str(files("msbot.registry") / "migrations"), folder)
    (folder / "versions" / f"v{NOW + 1:04}_next.py").write_text(script)
    return folder_migrations(folder)


def _rows(path: Path, query: str) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(query).fetchall()


def test_the_migrations_make_the_tables_of_the_code(path: Path, engine: Engine) -> None:
    address = parse_address(path)
    with engine.begin() as connection:
        schema._upgrade(connection, own_migrations().location)
    assert read_version(engine, address, own_migrations()) == own_migrations().newest
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []


def test_every_column_has_a_comment() -> None:
    assert [column for table in metadata.sorted_tables for column in table.columns if not column.comment] == []


def test_a_server_gets_the_comments_too() -> None:
    statements: list[str] = []
    engine = create_mock_engine("postgresql+psycopg://", lambda element, *_, **__: statements.append(str(element)))
    schema._write_comments(engine)  # type: ignore[arg-type]  # it stands in for a connection
    assert "COMMENT ON COLUMN parts.uid IS 'UID of the hardware, empty when it has none'" in statements
    assert len(statements) == sum(len(table.columns) for table in metadata.sorted_tables)


def test_a_second_process_that_was_quicker_is_noticed(path: Path, engine: Engine) -> None:
    address = parse_address(path)
    bring_up_to_date(engine, address, own_migrations())
    bring_up_to_date(engine, address, own_migrations())
    assert _rows(path, "SELECT version_num FROM alembic_version") == [(f"{NOW:04}",)]


def test_making_a_database_needs_no_migration(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "alembic", None)
    with open_registry(path) as registry:
        assert registry.robots.all() == []


def test_making_a_database_says_nothing(path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    open_registry(path).close()
    assert capfd.readouterr() == ("", "")


def test_an_older_database_is_copied_and_brought_up_to_date(
    path: Path, tmp_path: Path, blueprint: Blueprint, library: Library, caplog: pytest.LogCaptureFixture
) -> None:
    with open_registry(path) as registry:
        registry.robots.apply_blueprint(blueprint, library)
    with open_registry(path, migrations=_migrations(tmp_path, NEXT)) as registry:
        assert [robot.name for robot in registry.robots.all()] == ["MSBOT_MASTER"]
    copy = path.with_name(f"robot.db.schema{NOW}.1.backup")
    assert caplog.messages == [
        f"the database {path} is of schema {NOW} and is brought to {NOW + 1}; a copy is kept in {copy}"
    ]
    assert _rows(path, "SELECT version_num FROM alembic_version") == [(f"{NOW + 1:04}",)]
    assert _rows(path, "SELECT name, colour FROM robots") == [("MSBOT_MASTER", "red")]
    assert _rows(copy, "SELECT version_num FROM alembic_version") == [(f"{NOW:04}",)]
    assert _rows(copy, "SELECT name FROM robots") == [("MSBOT_MASTER",)]


def test_an_earlier_copy_is_never_overwritten(path: Path, tmp_path: Path) -> None:
    open_registry(path).close()
    earlier = path.with_name(f"robot.db.schema{NOW}.1.backup")
    earlier.write_text("mine")
    open_registry(path, migrations=_migrations(tmp_path, NEXT)).close()
    assert earlier.read_text() == "mine"
    assert path.with_name(f"robot.db.schema{NOW}.2.backup").exists()


def test_a_migration_that_fails_changes_nothing(path: Path, tmp_path: Path) -> None:
    open_registry(path).close()
    with pytest.raises(RegistryError, match='near "this": syntax error'):
        open_registry(path, migrations=_migrations(tmp_path, BROKEN))
    assert _rows(path, "SELECT version_num FROM alembic_version") == [(f"{NOW:04}",)]
    assert "colour" not in [row[1] for row in _rows(path, "PRAGMA table_info(robots)")]
    open_registry(path).close()


def test_a_newer_database_is_refused_and_left_alone(
    path: Path, tmp_path: Path, blueprint: Blueprint, library: Library
) -> None:
    with open_registry(path) as registry:
        registry.robots.apply_blueprint(blueprint, library)
    open_registry(path, migrations=_migrations(tmp_path, NEXT)).close()
    before = path.read_bytes()
    with pytest.raises(RegistryError) as caught:
        open_registry(path)
    assert str(caught.value) == (
        f"the database {path} was written by a newer MsBOT (schema {NOW + 1}, this one knows {NOW}): "
        f"update MsBOT or choose another --db; a downgrade loses robots.colour; the copy from before the update is "
        f"robot.db.schema{NOW}.1.backup"
    )
    assert path.read_bytes() == before


def test_an_older_msbot_takes_the_copy_back_and_keeps_what_the_newer_one_wrote(
    path: Path, tmp_path: Path, blueprint: Blueprint, library: Library
) -> None:
    """As docs/reference/stability.md says, "Back to an older version"."""
    with open_registry(path) as registry:
        name = registry.robots.apply_blueprint(blueprint, library).name
    open_registry(path, migrations=_migrations(tmp_path, NEXT)).close()
    newer = path.read_bytes()
    copy = path.with_name(f"robot.db.schema{NOW}.1.backup")
    kept = database_maintenance.restore(copy, str(path))
    assert kept == path.with_name("robot.db.newer.1")
    assert kept.read_bytes() == newer
    with open_registry(path) as registry:
        assert [robot.name for robot in registry.robots.all()] == [name]


def test_a_newer_database_stays_while_its_master_runs(
    path: Path, tmp_path: Path, blueprint: Blueprint, library: Library
) -> None:
    with open_registry(path) as registry:
        robot = registry.robots.apply_blueprint(blueprint, library)
        number = robot.id
    open_registry(path, migrations=_migrations(tmp_path, NEXT)).close()
    copy = path.with_name(f"robot.db.schema{NOW}.1.backup")
    with closing(sqlite3.connect(lock_file(path, number), isolation_level=None)) as lock:
        lock.execute("BEGIN EXCLUSIVE")
        with pytest.raises(RegistryError, match="a master is running a robot"):
            database_maintenance.restore(copy, str(path))
    assert not path.with_name("robot.db.newer.1").exists()


def test_the_database_of_another_program_is_refused_and_left_alone(path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE bookmarks (url TEXT)")
        connection.commit()
    with pytest.raises(RegistryError) as caught:
        open_registry(path)
    assert str(caught.value) == (
        f"the database {path} belongs to another program (it has bookmarks): choose another --db"
    )
    assert _rows(path, "SELECT name FROM sqlite_master") == [("bookmarks",)]


@pytest.mark.parametrize("version", ["'ae1027a6acf'", None])
def test_another_program_with_alembic_is_refused(path: Path, version: str | None) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE alembic_version (version_num TEXT)")
        if version is not None:
            connection.execute(f"INSERT INTO alembic_version VALUES ({version})")
        connection.commit()
    with pytest.raises(RegistryError, match=r"belongs to another program \(schema .*\): choose another --db"):
        open_registry(path)


def test_a_database_for_reading_only_must_be_up_to_date(path: Path, registry: Registry, tmp_path: Path) -> None:
    with open_registry(path, read_only=True) as reader:
        assert reader.robots.all() == []
    words = r"was written by an older MsBOT \(schema \d+, this one knows \d+\): `msbot db migrate --db"
    with pytest.raises(RegistryError, match=words):
        open_registry(path, read_only=True, migrations=_migrations(tmp_path, NEXT))
    assert registry.robots.all() == []
