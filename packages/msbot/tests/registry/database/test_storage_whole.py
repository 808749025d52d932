"""An open database in tables: who waits how long, what is tried again, what a broken cable and the end do to it."""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, text
from sqlalchemy.exc import OperationalError

from msbot.registry.database import storage as storage_module
from msbot.registry.database.engine import WAIT_S, WRITE, make_engine, parse_address
from msbot.registry.database.storage import Storage, StorageHealth
from msbot_xrce.errors import RegistryError


@contextmanager
def opened(path: Path, *, read_only: bool = False, busy_timeout_s: float = 0.01) -> Iterator[Storage]:
    address = parse_address(path)
    engine = make_engine(address, busy_timeout_s=busy_timeout_s, read_only=read_only)
    storage = Storage(engine, address, lambda: 5, busy_timeout_s=busy_timeout_s, read_only=read_only)
    try:
        yield storage
    finally:
        storage.close()


@pytest.fixture
def ours(path: Path, empty_database: bytes) -> Path:
    path.write_bytes(empty_database)
    return path


def test_all_is_well_while_nothing_is_wrong_and_nothing_lost() -> None:
    for trouble, waiting, lost in product((None, "is away"), (0, 3), (0, 1)):
        assert StorageHealth(trouble, waiting, lost).is_well is (trouble is None and lost == 0)


@pytest.mark.parametrize(
    ("busy_s", "runs", "patience_s", "limit_s"),
    [(0.1, False, 0.1, 60.1), (3.0, False, 3.0, 63.0), (0.1, True, 0.1, 5.1), (3.0, True, 0.4, 5.4)],
)
def test_how_long_a_person_waits(
    ours: Path, monkeypatch: pytest.MonkeyPatch, busy_s: float, runs: bool, patience_s: float, limit_s: float
) -> None:
    with opened(ours, busy_timeout_s=busy_s) as storage:
        assert not storage.runs_a_robot
        storage.runs_a_robot = runs
        assert (storage.patience_s, storage.limit_s) == (patience_s, limit_s)
        waits: list[float] = []

        def submit(_change: object, *, wait_s: float) -> _Job:
            waits.append(wait_s)
            return _Job(waits)

        with monkeypatch.context() as patch:
            patch.setattr(storage.writer, "submit", submit)
            assert storage.change(lambda _: "made") == "made"
        assert waits == [patience_s, limit_s]
        flushed: list[float] = []
        with monkeypatch.context() as patch:
            patch.setattr(storage.writer, "flush", flushed.append)
            storage.catch_up()
        assert flushed == ([0.5] if runs else [])


class _Job:
    def __init__(self, waits: list[float]) -> None:
        self._waits = waits

    def wait(self, limit_s: float) -> str:
        self._waits.append(limit_s)
        return "made"


def test_who_reads_only_changes_nothing_and_starts_no_thread(ours: Path) -> None:
    before = threading.active_count()
    with opened(ours, read_only=True) as storage:
        assert threading.active_count() == before
        assert (storage.health, storage.flush()) == (StorageHealth(None, 0, 0), True)
        storage.runs_a_robot = True
        storage.catch_up()
        for ask in (lambda: storage.writer, lambda: storage.change(lambda _: None)):
            with pytest.raises(RegistryError) as caught:
                ask()
            assert str(caught.value) == f"the database {ours} was opened for reading only"
        assert storage.read(lambda connection: connection.execute(text("SELECT 7")).scalar()) == 7


class _Ended(Exception):
    sqlstate = "25P03"


@pytest.mark.parametrize(("ended", "sqlstate"), [*((ended, "25P03") for ended in range(6)), (1, "40001")])
def test_a_transaction_that_was_ended_for_standing_still_is_begun_again_three_times(
    ours: Path, ended: int, sqlstate: str
) -> None:
    times: list[object] = []

    def write(connection: Connection) -> int:
        options = connection.get_execution_options()
        times.append((options[WRITE], options[WAIT_S]))
        connection.execute(text("UPDATE alembic_version SET version_num = :n"), {"n": str(len(times))})
        if len(times) <= ended:
            cause = _Ended("gone")
            cause.sqlstate = sqlstate
            raise OperationalError("SELECT", {}, cause)
        return len(times)

    with opened(ours) as storage:
        if ended <= 3 and sqlstate == "25P03":
            assert storage.write(write) == ended + 1
        else:
            with pytest.raises(RegistryError, match=r"^the database .*robot\.db cannot be used \(gone\)"):
                storage.write(write)
        tries = min(ended + 1, 4) if sqlstate == "25P03" else 1
        assert times == [(True, 0.01)] * tries
        found = storage.read(
            lambda connection: connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
        )
        assert (found == str(tries)) is (ended <= 3 and sqlstate == "25P03"), "one that was not taken leaves nothing"


def test_while_the_cable_is_out_nothing_is_read_or_stored_and_nothing_is_lost(ours: Path) -> None:
    def count(connection: Connection) -> object:
        return connection.execute(text("SELECT count(*) FROM blocks")).scalar()

    def note(connection: Connection) -> None:
        connection.execute(text("INSERT INTO blocks VALUES ('uid', 'x', 'why', 1)"))

    with opened(ours) as storage:
        storage.break_off(broken=True)
        with pytest.raises(RegistryError) as caught:
            storage.read(count)
        assert str(caught.value) == f"the database {ours} cannot be reached"
        storage.writer.put(note)
        assert not storage.flush()
        with pytest.raises(RegistryError, match=r"nothing was changed: the database .* cannot be reached"):
            storage.change(count)
        assert (storage.health.waiting, storage.health.lost) == (1, 0)
        assert f"the database {ours} cannot be reached; changes kept in memory" in str(storage.health.trouble)
        storage.break_off(broken=False)
        assert storage.flush()
        assert (storage.read(count), storage.change(count), storage.health) == (1, 1, StorageHealth(None, 0, 0))


LIMIT_S = 60.0
"""Longer than a busy computer lets a thread stand still: what shall succeed is in time."""


def time_flies(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """A call that puts the loop's clock forward: a limit is over when the test says so, however busy all is."""
    loop, ahead_s = asyncio.get_running_loop(), 0.0
    real = loop.time
    monkeypatch.setattr(loop, "time", lambda: real() + ahead_s)

    def fly(seconds: float) -> None:
        nonlocal ahead_s
        ahead_s += seconds

    return fly


async def until(condition: Callable[[], bool]) -> None:
    latest = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < latest
        await asyncio.sleep(0.001)


async def test_who_reads_too_long_is_let_go_and_many_of_them_keep_others_out_only_while_they_last(
    ours: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr(storage_module, "monotonic", lambda: now)
    monkeypatch.setattr(storage_module, "LIMIT_S", LIMIT_S)
    fly = time_flies(monkeypatch)
    release, hanging = threading.Event(), list[int]()
    words = f"the database {ours} does not answer: try again in a moment"

    async def told(ask: Callable[..., Any], *arguments: object, **named: object) -> str:
        with pytest.raises(RegistryError) as caught:
            await storage.in_time(ask, *arguments, **named)
        return str(caught.value)

    def fail(*, why: str) -> None:
        raise RegistryError(why)

    def hang(number: int) -> None:
        hanging.append(number)
        release.wait(LIMIT_S)

    with opened(ours) as storage:
        assert await storage.in_time(dict, [("one", 1)], other=2) == {"one": 1, "other": 2}
        assert await told(fail, why="no such slot") == "no such slot"
        four = [asyncio.create_task(told(hang, number)) for number in range(4)]
        await until(lambda: len(hanging) == 4)
        fly(LIMIT_S)
        assert await asyncio.gather(*four) == [words] * 4
        assert len(storage._asking) == 4
        now += LIMIT_S  # all four are busy for as long as anybody waits: one more may still try
        fifth = asyncio.create_task(told(lambda: None))
        await until(lambda: len(storage._asking) == 5)
        fly(LIMIT_S)
        assert await fifth == words
        assert len(storage._asking) == 4, "what nobody waits for any more, and nobody serves, does not count"
        now += 1 / 64  # longer: whoever comes now would wait in vain
        asked = storage._asked
        assert await told(lambda: None) == words
        assert storage._asked == asked, "it was not even put in the queue"
        release.set()
        await until(lambda: not storage._asking)
        assert await storage.in_time(lambda: "again") == "again"


async def test_what_fails_after_its_reader_was_let_go_is_no_error_of_the_program(
    ours: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(storage_module, "LIMIT_S", LIMIT_S)
    fly = time_flies(monkeypatch)
    is_asked, release = threading.Event(), threading.Event()
    told: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(context))

    def fail() -> None:
        is_asked.set()
        assert release.wait(LIMIT_S)
        raise RegistryError("the disk is gone")

    with opened(ours) as storage:
        asking = asyncio.create_task(storage.in_time(fail))
        await until(is_asked.is_set)
        fly(LIMIT_S)
        with pytest.raises(RegistryError, match="does not answer: try again in a moment"):
            await asking
        release.set()
        await until(lambda: not storage._asking)
        assert await storage.in_time(lambda: "again") == "again"
    for _ in range(3):
        await asyncio.sleep(0)
        gc.collect()
    assert told == []


def test_nothing_stays_open_at_the_end(ours: Path) -> None:
    with opened(ours) as storage:
        storage.change(lambda connection: connection.execute(text("SELECT 1")).scalar())
        thread = storage.writer._thread
    assert not thread.is_alive()
    assert storage.engine.pool.checkedin() == 0  # type: ignore[attr-defined]  # a QueuePool
    with pytest.raises(RuntimeError, match="nothing is done any more"):
        storage._threads.submit(lambda: None)
    with pytest.raises(RegistryError, match="is closed"):
        storage.change(lambda _: None)
