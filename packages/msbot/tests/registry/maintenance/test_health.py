"""How a database is, as the doctor looks at it: its schema, its size, who may use it, what is wrong in it."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text

from msbot.config import Blueprint, Library
from msbot.pnp import PartState
from msbot.registry import Registry, open_registry
from msbot.registry.maintenance.health import MB, look_at_health
from msbot_xrce.errors import RegistryError
from tests.registry.database.test_schema import NOW
from tests.registry.events import CLAIM, UID, changed


@pytest.fixture
def used(registry: Registry, blueprint: Blueprint, library: Library) -> Registry:
    """A robot with lines in its journal, at seconds that the clock of the tests gives."""
    store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
    store.remember(UID, "AA", CLAIM)
    store.journal(changed(PartState.ACTIVE))
    store.journal(changed(PartState.LATE))
    registry.storage.flush()
    return registry


def test_a_database_without_a_robot_has_nothing_old(registry: Registry, address: str) -> None:
    health = look_at_health(address)
    assert (health.schema, health.newest_schema, health.faults) == (NOW, NOW, ())
    assert (health.newest_record_ns, health.oldest_ns, health.is_locked) == (None, None, False)


def test_the_oldest_and_the_newest_that_is_noted(used: Registry, address: str) -> None:
    lines = [line.at_ns for line in used.robots.journal()]
    health = look_at_health(address)
    assert len(lines) == 2
    assert health.newest_record_ns == max(lines)
    assert health.oldest_ns is not None
    assert health.oldest_ns < min(lines)  # the robot was put in before
    used.storage.write(lambda connection: connection.execute(text("UPDATE robots SET applied_ns = 9e18")))
    assert look_at_health(address).oldest_ns == min(lines)


def test_what_is_wrong_is_looked_for_only_on_request(used: Registry, address: str) -> None:
    used.storage.write(lambda connection: connection.execute(text("UPDATE slots SET configuration_version = 0")))
    assert len(look_at_health(address).faults) == 3
    assert look_at_health(address, thorough=False).faults == ()


def test_a_server_has_no_file(used: Registry, address: str) -> None:
    health = look_at_health(address)
    if address.startswith("postgresql"):
        assert (health.path, health.size_mb, health.log_mb, health.others_may_read) == (None, 0.0, 0.0, False)
    else:
        assert health.path == Path(address)
        assert health.size_mb == Path(address).stat().st_size / MB > 0
        assert health.log_mb == Path(f"{address}-wal").stat().st_size / MB > 0


def test_who_may_read_the_file_is_told(path: Path) -> None:
    open_registry(path).close()
    assert not look_at_health(str(path)).others_may_read
    path.chmod(0o640)
    assert not look_at_health(str(path)).others_may_read  # a group was chosen on purpose
    path.chmod(0o644)
    health = look_at_health(str(path))
    assert health.others_may_read
    assert health.log_mb == 0.0  # the log goes with the last who closes the file


def test_a_file_that_another_program_writes_is_locked_and_read_all_the_same(path: Path) -> None:
    open_registry(path).close()
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        assert look_at_health(str(path)).is_locked
        other.execute("ROLLBACK")
        assert not look_at_health(str(path)).is_locked
        other.execute("BEGIN IMMEDIATE")  # and looking leaves no lock behind


def test_a_newer_database_is_looked_at_from_outside_only(used: Registry, path: Path) -> None:
    used.close()
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("UPDATE alembic_version SET version_num = printf('%04d', version_num + 1)")
        connection.execute("UPDATE slots SET configuration_version = 0")
        connection.commit()
    health = look_at_health(str(path))
    assert (health.schema, health.newest_schema) == (NOW + 1, NOW)
    assert (health.newest_record_ns, health.oldest_ns, health.faults) == (None, None, ())


def test_what_is_no_database_is_told(path: Path) -> None:
    with pytest.raises(RegistryError, match="there is no database"):
        look_at_health(str(path))
    assert not path.exists()
