"""A running robot whose database freezes, is locked, deleted, replaced or overwritten: it goes on, and says so."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing
from functools import partial
from pathlib import Path
from time import monotonic

import pytest
from sqlalchemy import Connection

from msbot.config import Blueprint, Library
from msbot.pnp import PartState
from msbot.registry import Registry, RobotRecord, RobotStore, open_registry
from msbot.registry.database import storage
from msbot.registry.edits import slot_values
from msbot.registry.maintenance import database_maintenance
from msbot_xrce.errors import DatabaseBusy, RegistryError
from tests.registry.blueprint.test_blueprint_store import LIBRARY, ROBOT
from tests.registry.events import CLAIM, UID, changed
from tests.registry.postgres import MISSING, NEEDED, find_server, running_server

PERIOD = partial(slot_values.set_value, slot="left", name="period_s")


BEATS = 2
"""While a database is waited for, the loop has at least so many turns; one that waits itself has one at most."""


@asynccontextmanager
async def beating() -> AsyncIterator[Callable[[], int]]:
    """How many turns the event loop has had since that was asked last."""
    turns = 0

    async def beat() -> None:
        nonlocal turns
        while True:
            await asyncio.sleep(0)  # not longer: all may stand still for as long as the database is waited for
            turns += 1

    def since() -> int:
        nonlocal turns
        had, turns = turns, 0
        return had

    task = asyncio.create_task(beat())
    try:
        yield since
    finally:
        task.cancel()


async def until(what: Callable[[], bool]) -> None:
    async with asyncio.timeout(60):
        while not what():  # noqa: ASYNC110 - a thread makes no sound
            await asyncio.sleep(0.05)


def _period(registry: Registry, robot: RobotRecord) -> object:
    return next(value.value for value in registry.robots.values(robot, "left") if value.name == "period_s")


@pytest.fixture
def own_server() -> Iterator[str]:
    """A server of this test's own, which it may freeze."""
    programs = find_server()
    if programs is None:
        assert NEEDED not in os.environ, MISSING
        pytest.skip(MISSING)
    with running_server(programs) as address:
        yield address.format("postgres")


def _processes_of(address: str) -> list[int]:
    """The server and all it has forked."""
    folder = Path(address.rpartition("host=")[2].replace("%2F", "/"))
    (first, *_rest) = (next(folder.rglob("postmaster.pid"))).read_text().split()
    children = Path(f"/proc/{first}/task/{first}/children").read_text().split()
    return [int(first), *map(int, children)]


async def test_a_frozen_server_holds_nobody_up_and_loses_nothing(
    own_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(storage, "SLOWEST_S", 60.0)  # for what shall be stored
    with open_registry(own_server) as registry:
        robot = registry.robots.apply_blueprint(ROBOT, LIBRARY)
        store = registry.runs.begin(robot)
        await registry.edits.make_soon(robot, "Ann", partial(PERIOD, value=2))
        frozen = _processes_of(own_server)
        for process in frozen:
            os.kill(process, signal.SIGSTOP)
        try:
            async with beating() as turns:
                with monkeypatch.context() as patch:
                    patch.setattr(storage, "SLOWEST_S", 0.5)
                    patch.setattr(storage, "LIMIT_S", 0.5)
                    turns()
                    with pytest.raises(RegistryError, match="nothing was changed: "):
                        await registry.edits.make_soon(robot, "Ann", partial(PERIOD, value=3))
                    assert turns() >= BEATS
                    with pytest.raises(RegistryError, match=r"does not answer|has not answered"):
                        await registry.storage.in_time(registry.robots.values, robot, "left")
                    assert turns() >= BEATS
                store.remember(UID, "left", CLAIM)  # a part comes in
                assert store.remembered_slot(UID) == "left"
                assert store.configuration("left").slot == "left"
                await until(lambda: registry.storage.health.trouble is not None)
                health = registry.storage.health
                assert "has not answered for" in str(health.trouble)
                assert health.waiting >= 1
        finally:
            for process in frozen:
                os.kill(process, signal.SIGCONT)
        await until(lambda: registry.storage.health.is_well and registry.storage.health.waiting == 0)
        assert _period(registry, robot) == 2  # what was told to be stored is, what was refused is not
        assert [part.slot for part in registry.robots.parts(robot)] == ["left"]
        await registry.edits.make_soon(robot, "Ann", partial(PERIOD, value=4))


@pytest.fixture
def running(registry_path: Registry) -> tuple[Registry, RobotRecord, RobotStore]:
    robot = registry_path.robots.apply_blueprint(ROBOT, LIBRARY)
    store = registry_path.runs.begin(robot)
    registry_path.edits.make(robot, "Ann", partial(PERIOD, value=2))
    return registry_path, robot, store


@pytest.fixture
def registry_path(path: Path, empty_database: bytes) -> Iterator[Registry]:
    path.write_bytes(empty_database)
    with open_registry(path) as registry:
        yield registry


Running = tuple[Registry, RobotRecord, RobotStore]


def test_a_file_that_is_deleted_is_written_anew_with_all_it_had(running: Running, path: Path) -> None:
    registry, robot, store = running
    for file in path.parent.glob("robot.db*"):
        file.unlink()
    store.remember(UID, "left", CLAIM)
    assert registry.storage.flush()
    assert registry.storage.health.is_well
    registry.edits.make(robot, "Ann", partial(PERIOD, value=3))
    assert path.stat().st_mode & 0o077 == 0
    registry.close()
    assert database_maintenance.check(str(path)) == []
    with open_registry(path) as again:
        assert _period(again, robot) == 3
        assert next(edit.words for edit in again.edits.latest(robot)).endswith("2 s -> 3 s")
        assert [part.slot for part in again.robots.parts(robot)] == ["left"]


def test_a_file_that_is_deleted_while_nothing_happens_is_noticed(running: Running, path: Path) -> None:
    path.unlink()
    until_s = monotonic() + 60
    while not path.exists():
        assert monotonic() < until_s
    assert database_maintenance.check(str(path)) == []


def test_a_file_that_is_replaced_is_left_alone_and_what_the_robot_had_is_kept(
    running: Running, path: Path, tmp_path: Path, blueprint: Blueprint, library: Library
) -> None:
    registry, robot, store = running
    with open_registry(tmp_path / "other.db") as other:
        other.robots.apply_blueprint(blueprint, library)
    shutil.copyfile(tmp_path / "other.db", tmp_path / "copy.db")
    (tmp_path / "copy.db").replace(path)
    with pytest.raises(RegistryError, match="was replaced by another file while the robot ran: stop the master"):
        registry.edits.make(robot, "Ann", partial(PERIOD, value=3))
    store.remember(UID, "left", CLAIM)
    assert not registry.storage.flush()
    assert "was replaced by another file" in str(registry.storage.health.trouble)
    kept = path.with_name("robot.db.rescued.1")
    assert kept.stat().st_mode & 0o077 == 0
    with open_registry(kept, read_only=True) as rescued:
        assert _period(rescued, robot) == 2
    assert path.read_bytes() == (tmp_path / "other.db").read_bytes()


def test_a_file_that_is_overwritten_is_told_and_nothing_is_acknowledged(running: Running, path: Path) -> None:
    registry, robot, store = running
    with path.open("r+b") as stream:
        stream.write(b"something else" * 1000)
    with pytest.raises(RegistryError, match="was overwritten by something else while the robot ran"):
        registry.edits.make(robot, "Ann", partial(PERIOD, value=3))
    assert store.configuration("left").slot == "left"


async def test_a_locked_file_holds_nobody_up(running: Running, path: Path) -> None:
    registry, robot, store = running
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(DatabaseBusy, match="is locked by another program"):
            await registry.edits.make_soon(robot, "Ann", partial(PERIOD, value=3))
        store.remember(UID, "left", CLAIM)
        await until(lambda: registry.storage.health.trouble is not None)
        with pytest.raises(DatabaseBusy, match="is locked by another program"):  # also behind what waits already
            await registry.edits.make_soon(robot, "Ann", partial(PERIOD, value=3))
        assert await registry.storage.in_time(_period, registry, robot) == 2  # reading goes on
    await until(lambda: registry.storage.health.is_well and registry.storage.health.waiting == 0)
    assert [part.slot for part in registry.robots.parts(robot)] == ["left"]


async def test_a_change_that_nobody_waits_for_any_more_is_not_made(
    running: Running, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    registry, robot, _store = running
    monkeypatch.setattr(storage, "SLOWEST_S", 0.1)
    monkeypatch.setattr(storage, "LOOP_PATIENCE_S", 5.0)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        making = asyncio.create_task(registry.edits.make_soon(robot, "Ann", partial(PERIOD, value=3)))
        await asyncio.sleep(0)
        change = registry.storage.writer.submit(lambda connection: None, wait_s=5.0)
        with pytest.raises(RegistryError, match="nothing was changed"):
            await change.stored(0.05)
        making.cancel()
    registry.storage.flush()
    await registry.edits.make_soon(robot, "Bob", partial(PERIOD, value=4))
    assert _period(registry, robot) == 4


def test_who_reads_after_something_was_noted_finds_it(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    """Notes are stored by a thread of their own; readers of a running robot give it a moment."""
    registry, _robot, store = running
    monkeypatch.setattr(storage, "CATCH_UP_S", 60.0)  # be this machine ever so busy
    release = threading.Event()

    def hold(_: Connection) -> None:
        release.wait(30)

    registry.storage.writer.put(hold)
    store.journal(changed(PartState.ACTIVE))
    threading.Timer(0.05, release.set).start()
    (look,) = registry.robots.in_class()
    assert look.newest is not None
    assert look.newest.event.reason == "because"


def test_how_long_a_change_waits_for_another_program(running: Running, path: Path) -> None:
    """People wait for a robot that runs, a command for itself."""
    registry, _robot, _store = running
    assert (registry.storage.patience_s, registry.storage.limit_s) == (0.4, 5.4)
    with open_registry(path, busy_timeout_s=0.1) as other:
        assert (other.storage.patience_s, other.storage.limit_s) == (0.1, 60.1)
    with open_registry(path, busy_timeout_s=3.0) as other:
        assert (other.storage.patience_s, other.storage.limit_s) == (3.0, 63.0)


async def test_so_many_readers_are_served_and_wait_and_the_next_is_turned_away(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    registry, _robot, _store = running
    monkeypatch.setattr(storage, "LIMIT_S", 60.0)  # be this machine ever so busy
    release = threading.Event()
    asking = [asyncio.create_task(registry.storage.in_time(release.wait, 60)) for _ in range(4 + 64)]
    await asyncio.sleep(0)
    with pytest.raises(RegistryError, match="does not answer: try again in a moment"):
        await registry.storage.in_time(lambda: True)
    release.set()
    assert all(await asyncio.gather(*asking))
    assert await registry.storage.in_time(lambda: True)


LOOK = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1])
print(connection.execute("select max(id) from edits").fetchone()[0])
connection.close()
"""


def _newest_edit(path: Path) -> int:
    """As another process sees it, which closes the file afterwards."""
    return int(subprocess.run([sys.executable, "-c", LOOK, str(path)], capture_output=True, check=True).stdout)


def test_who_looks_into_the_file_and_leaves_takes_nothing_along(running: Running, path: Path, tmp_path: Path) -> None:
    """The last to leave a database tidies its log up; it must know that the robot is still there."""
    registry, robot, _store = running
    for value in (3, 4):
        edit = registry.edits.make(robot, "Ann", partial(PERIOD, value=value))
        assert _newest_edit(path) == edit.id
    database_maintenance.back_up(str(path), tmp_path / "copy.db")
    for value in (5, 6):
        edit = registry.edits.make(robot, "Ann", partial(PERIOD, value=value))
        assert _newest_edit(path) == edit.id
