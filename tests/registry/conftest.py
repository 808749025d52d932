"""A robot, a clock that counts, and an open registry in a real file."""

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest

from msbot.config import Blueprint, Library, load_blueprint, load_library, write_sample
from msbot.registry import Registry, open_registry


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


@pytest.fixture
def registry(path: Path, epoch_ns: Callable[[], int], empty_database: bytes) -> Iterator[Registry]:
    path.write_bytes(empty_database)
    with open_registry(path, epoch_ns=epoch_ns) as registry:
        yield registry


@pytest.fixture
def impatient(path: Path, empty_database: bytes) -> Iterator[Registry]:
    """A registry that does not wait for other programs."""
    if not path.exists():
        path.write_bytes(empty_database)
    with open_registry(path, busy_timeout_s=0.01) as registry:
        yield registry
