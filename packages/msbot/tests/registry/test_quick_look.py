"""A quick look shows what the registry shows, and leaves to it what it does not know."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from msbot.config import Blueprint, Library
from msbot.pnp import PartState
from msbot.registry import Registry, RobotRecord, RobotStore, open_registry
from msbot.registry.read_only_database import NO_MASTER, ReadOnlyDatabase, look_into
from msbot_agent.text.sentence import said
from tests.registry.events import CLAIM, UID, changed
from tools import read_only_queries

WHY = said("no beat for {seconds:.1f} s", seconds=5.04)


@pytest.fixture
def registry(path: Path) -> Any:
    with open_registry(path) as opened:
        yield opened


@pytest.fixture
def robot(registry: Registry, blueprint: Blueprint, library: Library) -> RobotRecord:
    return registry.robots.apply_blueprint(blueprint, library)


@pytest.fixture
def store(registry: Registry, robot: RobotRecord) -> RobotStore:
    """A robot that is run, with a part that was seen."""
    begun = registry.runs.begin(robot)
    begun.remember(UID, "AA", CLAIM)
    begun.journal(changed(PartState.ACTIVE, reason="it fits"))
    begun.journal(changed(PartState.LATE, before=PartState.ACTIVE, reason=WHY))
    registry.storage.flush()
    return begun


def quick(path: Path) -> ReadOnlyDatabase:
    look = look_into(str(path))
    assert look is not None
    return look


def test_it_shows_what_the_registry_shows(
    registry: Registry, store: RobotStore, robot: RobotRecord, path: Path
) -> None:
    with quick(path) as look:
        assert look.robots() == registry.robots.all()
        assert look.is_run(robot)
        assert look.is_run(robot) is registry.runs.is_run(robot)
        assert look.slot_names(robot) == registry.robots.slot_names(robot) == ["AA", "BB", "CC"]
        assert look.parts() == registry.robots.parts() != []
        assert look.parts(robot) == registry.robots.parts(robot)
        for word in ("AA", "aa", UID.hex(), "nobody"):
            for limit in (1, 5):
                assert look.journal(limit, word) == registry.robots.journal(limit, word)
                for one in look.robots():
                    found = registry.robots.journal(limit, word, robot=one)
                    assert look.journal(limit, word, one) == found
        reason: Any = look.journal(1, "AA")[0].event.reason
    assert (reason, reason.form) == (WHY, WHY.form)


def test_parts_of_a_robot_that_nobody_runs_are_lost(store: RobotStore, registry: Registry, path: Path) -> None:
    registry.close()
    with quick(path) as look, open_registry(path, read_only=True) as again:
        (part,) = look.parts()
        assert part.state == "lost"
        assert look.parts() == again.robots.parts()
        assert not look.is_run(look.robots()[0])


def test_an_active_part_is_lost_when_its_master_was_killed(store: RobotStore, path: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(tmp_path / "copy.db")) as target:
        source.backup(target)  # as after a kill: the part is active, and no lock says that a master runs
    with quick(tmp_path / "copy.db") as look:
        assert [(part.state, part.reason) for part in look.parts()] == [("lost", NO_MASTER)]


@pytest.mark.parametrize("address", ["postgresql://robots@localhost/class", "sqlite:///robot.db"])
def test_what_is_no_plain_file_is_left_to_the_registry(address: str) -> None:
    assert look_into(address) is None


def test_what_is_no_database_of_this_version_is_left_to_the_registry(
    store: RobotStore, registry: Registry, path: Path, tmp_path: Path
) -> None:
    registry.close()
    assert look_into(str(tmp_path / "none.db")) is None
    assert not (tmp_path / "none.db").exists()
    (tmp_path / "other.db").write_text("no database")
    assert look_into(str(tmp_path / "other.db")) is None
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    assert look_into(str(path)) is None


def test_its_queries_are_made_from_the_tables() -> None:
    assert read_only_queries.TARGET.read_text() == read_only_queries.text(), "run tools/read_only_queries.py"
