"""What only a server does: connections that break, locks of sessions, copies before a migration."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import Engine, create_engine, make_url, text
from sqlalchemy.exc import DBAPIError

from msbot.config import Blueprint, Library
from msbot.pnp import PartState
from msbot.registry import open_registry
from msbot.registry.database.engine import make_engine, parse_address
from msbot_xrce.errors import RegistryError
from tests.registry.database.test_schema import BROKEN, NEXT, NOW, _migrations
from tests.registry.events import changed

HOLDER = """
import sys
from msbot.registry import open_registry

registry = open_registry(sys.argv[1])
registry.runs.begin(registry.robots.all()[0])
print("running", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def database(server: str, server_database: str) -> Iterator[str]:
    """An address of a database with all tables that may be spoilt."""
    engine = create_engine(
        make_url(server.format("postgres")).set(drivername="postgresql+psycopg"), isolation_level="AUTOCOMMIT"
    )
    with engine.connect() as connection:
        connection.execute(text("CREATE DATABASE spoilt TEMPLATE pattern"))
    yield server.format("spoilt")
    with engine.connect() as connection:
        connection.execute(text("DROP DATABASE spoilt WITH (FORCE)"))
    engine.dispose()


@pytest.fixture
def engine(database: str) -> Iterator[Engine]:
    engine = make_engine(parse_address(database), busy_timeout_s=1, read_only=False)
    yield engine
    engine.dispose()


def _cut_all(engine: Engine) -> None:
    """End every other connection, as a restart of the server would."""
    others = "FROM pg_stat_activity WHERE datname = current_database() AND pid <> pg_backend_pid()"
    with engine.connect() as connection:
        connection.execute(text(f"SELECT pg_terminate_backend(pid) {others}"))


def test_a_database_without_an_encoding_of_its_own_keeps_every_letter(
    server: str, blueprint: Blueprint, library: Library
) -> None:
    admin = create_engine(
        make_url(server.format("postgres")).set(drivername="postgresql+psycopg"), isolation_level="AUTOCOMMIT"
    )
    try:
        with admin.connect() as connection:
            connection.execute(text("CREATE DATABASE plain ENCODING 'SQL_ASCII' LOCALE 'C' TEMPLATE template0"))
        named = replace(blueprint, robot=replace(blueprint.robot, manufacturer="Škola 学校"))
        for _ in range(2):
            with open_registry(server.format("plain")) as registry:
                robot = registry.robots.apply_blueprint(named, library)
                assert registry.robots.blueprint(robot).robot.manufacturer == "Škola 学校"
    finally:
        with admin.connect() as connection:
            connection.execute(text("DROP DATABASE IF EXISTS plain WITH (FORCE)"))
        admin.dispose()


def test_the_robot_goes_on_when_the_server_is_restarted(
    database: str, engine: Engine, blueprint: Blueprint, library: Library
) -> None:
    with open_registry(database) as registry:
        robot = registry.robots.apply_blueprint(blueprint, library)
        store = registry.runs.begin(robot)
        configuration = store.configuration("AA")
        _cut_all(engine)
        assert store.configuration("AA") == configuration
        store.journal(changed(PartState.ACTIVE))
        registry.storage.flush()
        assert registry.storage.flush()
        assert [entry.event.slot for entry in registry.robots.journal()] == ["AA"]
        assert registry.storage.health.trouble is None


def test_a_second_master_is_refused_until_the_first_is_killed(
    clean_server_database: str, blueprint: Blueprint, library: Library
) -> None:
    with open_registry(clean_server_database, busy_timeout_s=0.05) as registry:
        robot = registry.robots.apply_blueprint(blueprint, library)
        command = [sys.executable, "-W", "error", "-c", HOLDER, clean_server_database]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as master:
            assert master.stdout is not None
            assert master.stdout.readline() == "running\n"
            with pytest.raises(RegistryError, match="is being run by another msbot master"):
                registry.runs.begin(robot)
            master.kill()
    with open_registry(clean_server_database) as registry:
        registry.runs.begin(robot)


def test_reading_only_is_kept_by_the_server(clean_server_database: str) -> None:
    engine = make_engine(parse_address(clean_server_database), busy_timeout_s=1, read_only=True)
    with engine.connect() as connection, pytest.raises(DBAPIError, match="read-only transaction"):
        connection.execute(text("DELETE FROM robots"))
    engine.dispose()


def test_an_older_database_is_copied_within_and_brought_up_to_date(
    database: str,
    engine: Engine,
    tmp_path: Path,
    blueprint: Blueprint,
    library: Library,
    caplog: pytest.LogCaptureFixture,
) -> None:
    with open_registry(database) as registry:
        registry.robots.apply_blueprint(blueprint, library)
    with pytest.raises(RegistryError, match='syntax error at or near "this"'):
        open_registry(database, migrations=_migrations(tmp_path / "broken", BROKEN))
    open_registry(database, migrations=_migrations(tmp_path / "good", NEXT)).close()
    copy = f"msbot_schema{NOW}_1_backup"
    assert caplog.messages[-1].endswith(f"is brought to {NOW + 1}; a copy is kept in its schema {copy}")
    with engine.connect() as connection:
        assert connection.execute(text("SELECT name, colour FROM robots")).all() == [("MSBOT_MASTER", "red")]
        assert connection.execute(text(f"SELECT name FROM {copy}.robots")).all() == [("MSBOT_MASTER",)]
        assert connection.execute(text(f"SELECT version_num FROM {copy}.alembic_version")).all() == [(f"{NOW:04}",)]
    with pytest.raises(RegistryError, match="was written by a newer MsBOT") as refused:
        open_registry(database)
    assert str(refused.value).endswith(
        f"; copies from before updates are its schemas {copy}; a backup can be restored into an empty database "
        "(`createdb NAME`)"
    )


def test_a_copy_within_takes_no_name_that_is_in_use(database: str, engine: Engine, tmp_path: Path) -> None:
    taken = [f"msbot_schema{NOW}_{number}_backup" for number in (1, 3)]
    with engine.begin() as connection:
        for name in taken:
            connection.execute(text(f"CREATE SCHEMA {name}"))
    open_registry(database, migrations=_migrations(tmp_path, NEXT)).close()
    with engine.connect() as connection:
        names = "SELECT DISTINCT table_schema FROM information_schema.tables WHERE table_schema LIKE '%_backup'"
        assert connection.execute(text(names)).all() == [(f"msbot_schema{NOW}_2_backup",)]


def test_columns_have_comments(clean_server_database: str) -> None:
    engine = make_engine(parse_address(clean_server_database), busy_timeout_s=1, read_only=True)
    query = "SELECT count(*) FROM pg_description JOIN pg_class ON objoid = oid WHERE relname = 'edits' AND objsubid > 0"
    with engine.connect() as connection:
        assert connection.execute(text(query)).scalar() == 11
    engine.dispose()


def test_a_database_that_is_not_there(server: str, tmp_path: Path) -> None:
    with pytest.raises(RegistryError, match='database "nowhere" does not exist'):
        open_registry(server.format("nowhere"))
    with pytest.raises(RegistryError, match=r"cannot be used .*: mend that, or choose another --db"):
        open_registry(f"postgresql://msbot@/robot?host={tmp_path}")
