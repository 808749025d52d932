"""A robot, a clock that counts, and an open registry: in a real file, and on a PostgreSQL server where there is one.

Every test that asks for `registry` (or `address`) runs on both, except those that look into the file at `path`.
"""

import os
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest
from sqlalchemy import Engine, create_engine, make_url, text

from msbot.config import Blueprint, Library, load_blueprint, load_library, write_sample
from msbot.registry import Registry, open_registry
from msbot.registry.database.tables import metadata
from msbot.registry.registry import BUSY_TIMEOUT_S
from tests.registry.postgres import MISSING, NEEDED, find_server, running_server

BACKENDS = ("sqlite", "postgresql")
SERVER_S = 30.0
"""How long connecting to a server may take, be this machine ever so busy."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Both databases for every test that does not look into a file."""
    if "backend" in metafunc.fixturenames and "path" not in metafunc.fixturenames:
        metafunc.parametrize("backend", BACKENDS, indirect=True)


@pytest.fixture
def backend(request: pytest.FixtureRequest) -> str:
    """The kind of database."""
    return str(getattr(request, "param", "sqlite"))


@pytest.fixture(scope="session")
def library() -> Library:
    return load_library()


@pytest.fixture(scope="session")
def blueprint(tmp_path_factory: pytest.TempPathFactory, library: Library) -> Blueprint:
    path = tmp_path_factory.mktemp("blueprint") / "robot.toml"
    write_sample(path)
    return load_blueprint(path, library)


@pytest.fixture
def epoch_ns() -> Callable[[], int]:
    """A wall clock that is one second later at each look."""
    seconds = count(1_700_000_000)
    return lambda: next(seconds) * 1_000_000_000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "robot.db"


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A database with tables and no rows; making one takes a tenth of a second, copying it nothing."""
    path = tmp_path_factory.mktemp("empty") / "robot.db"
    open_registry(path).close()
    return path.read_bytes()


@pytest.fixture(scope="session")
def server() -> Iterator[str]:
    """A PostgreSQL server; its address with `{}` in place of the database's name."""
    programs = find_server()
    if programs is None:
        assert NEEDED not in os.environ, MISSING
        pytest.skip(MISSING)
    with running_server(programs) as address:
        yield address


@pytest.fixture(scope="session")
def server_database(server: str) -> str:
    """The address of a database with all tables."""
    engine = create_engine(_url(server.format("postgres")), isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(text("CREATE DATABASE pattern"))
        open_registry(server.format("pattern"), busy_timeout_s=SERVER_S).close()
        connection.execute(text("CREATE DATABASE robot TEMPLATE pattern"))
    engine.dispose()
    return server.format("robot")


@pytest.fixture(scope="session")
def sweeper(server_database: str) -> Iterator[Engine]:
    """How the same database is emptied; connecting takes longer than that."""
    engine = create_engine(_url(server_database), isolation_level="AUTOCOMMIT")
    yield engine
    engine.dispose()


@pytest.fixture
def clean_server_database(server_database: str, sweeper: Engine) -> str:
    """A database with all tables and no rows."""
    # Far quicker than TRUNCATE when there are few rows.
    sweep = [f"DELETE FROM {table.name}" for table in reversed(metadata.sorted_tables)]
    counters = [f"{table.name}_id_seq" for table in metadata.sorted_tables if "id" in table.columns]
    with sweeper.connect() as connection:
        connection.exec_driver_sql("; ".join(sweep + [f"ALTER SEQUENCE {name} RESTART" for name in counters]))
    return server_database


@pytest.fixture
def address(request: pytest.FixtureRequest, backend: str) -> str:
    """Where an empty database is."""
    if backend == "postgresql":
        return str(request.getfixturevalue("clean_server_database"))
    path: Path = request.getfixturevalue("path")
    path.write_bytes(request.getfixturevalue("empty_database"))
    return str(path)


@pytest.fixture
def registry(address: str, backend: str, epoch_ns: Callable[[], int]) -> Iterator[Registry]:
    patience_s = SERVER_S if backend == "postgresql" else BUSY_TIMEOUT_S
    with open_registry(address, epoch_ns=epoch_ns, busy_timeout_s=patience_s) as registry:
        yield registry


@pytest.fixture
def impatient(path: Path, empty_database: bytes) -> Iterator[Registry]:
    """A registry that does not wait for other programs."""
    if not path.exists():
        path.write_bytes(empty_database)
    with open_registry(path, busy_timeout_s=0.01) as registry:
        yield registry


def _url(address: str) -> str:
    return str(make_url(address).set(drivername="postgresql+psycopg"))
