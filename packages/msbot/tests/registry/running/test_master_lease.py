"""Several masters of one robot on a server: one has the lease, the others wait, and a former holder writes nothing."""

from __future__ import annotations

import queue
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
from sqlalchemy import URL, Connection, Engine, create_engine, text
from sqlalchemy.exc import DBAPIError

from msbot.config import Blueprint, Library
from msbot.pnp import PartState
from msbot.registry import LeaseLost, MasterLease, Registry, open_registry
from msbot.registry.database import engine as engine_module
from msbot.registry.running import master_lease, run_lock
from msbot_xrce.errors import ConfigError, RegistryError
from tests.registry.events import changed

PATIENCE_S = 90.0
IDLE_MS = master_lease.IDLE_MS
"""The real one."""


@pytest.fixture(autouse=True)
def alarms(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The times after which the system would have ended this process."""
    found: list[float] = []
    monkeypatch.setattr(signal, "setitimer", lambda _, left_s: found.append(left_s))
    return found


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is over by itself while this process, or the server, stands still: `expire` lets a lease be over."""
    monkeypatch.setattr(master_lease, "TTL_S", 60.0)
    monkeypatch.setattr(master_lease, "STILL_S", 60.0)
    monkeypatch.setattr(master_lease, "IDLE_MS", 60_000)
    slow_answers = "-c statement_timeout=60000 -c idle_in_transaction_session_timeout=60000"
    monkeypatch.setattr(engine_module, "_QUICK_ANSWERS", slow_answers)

    def create_patiently(url: URL, *, connect_args: dict[str, object], **options: Any) -> Engine:
        return create_engine(url, connect_args={**connect_args, "connect_timeout": 60}, **options)

    monkeypatch.setattr(engine_module, "create_engine", create_patiently)


@pytest.fixture
def opened(clean_server_database: str) -> Iterator[Callable[[], Registry]]:
    """Opens the same database as another master would."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(open_registry(clean_server_database, busy_timeout_s=30))


def nobody_waits(words: str) -> None:
    raise AssertionError(f"it waits: {words}")


def expire(sweeper: Engine) -> None:
    """Let the time of every lease be over."""
    with sweeper.connect() as connection:
        connection.execute(text("UPDATE master_leases SET until_ns = 0"))


def lasts(lease: MasterLease) -> bool:
    """Whether the lease is renewed, be this machine ever so busy."""
    before, until = lease._valid_until, monotonic() + PATIENCE_S
    while lease._valid_until == before and monotonic() < until:
        lease.left_s()  # the master's loop turns
        lease._ended.wait(0.05)
    return lease._valid_until > before and lease.left_s() > 0


def stand_still(lease: MasterLease) -> None:
    """Nothing renews the lease any more, not even what is being renewed at the moment."""
    lease.silent()
    lease._thread.join(PATIENCE_S)
    assert not lease._thread.is_alive()


class Waiting:
    """A master that waits, in a thread of its own."""

    def __init__(self, registry: Registry, blueprint: Blueprint) -> None:
        self.said: queue.Queue[str] = queue.Queue()
        self.lease: MasterLease | None = None
        self._thread = threading.Thread(target=self._wait, args=(registry, blueprint), daemon=True)
        self._thread.start()

    def _wait(self, registry: Registry, blueprint: Blueprint) -> None:
        robot = registry.robots.find(blueprint)
        assert robot is not None
        self.lease = registry.runs.wait_for_lease(robot, self.said.put)

    def has_it(self) -> MasterLease:
        self._thread.join(PATIENCE_S)
        assert self.lease is not None
        return self.lease


def test_one_master_serves_and_the_next_has_its_turn_when_it_ends(
    opened: Callable[[], Registry], blueprint: Blueprint, library: Library, alarms: list[float]
) -> None:
    first, second = opened(), opened()
    robot = first.robots.apply_blueprint(blueprint, library)
    lease = first.runs.wait_for_lease(robot, nobody_waits)
    assert lasts(lease)
    assert max(alarms) < master_lease.TTL_S
    waiting = Waiting(second, blueprint)
    words = waiting.said.get(timeout=PATIENCE_S)
    assert words.startswith("standby: MSBOT_MASTER is served by ")
    assert "process" in words
    first.close()
    later = waiting.has_it()
    assert later.epoch == lease.epoch + 1


def test_what_a_former_holder_wants_to_write_is_refused(
    opened: Callable[[], Registry], blueprint: Blueprint, library: Library, sweeper: Engine
) -> None:
    first, second = opened(), opened()
    robot = first.robots.apply_blueprint(blueprint, library)
    lease = first.runs.wait_for_lease(robot, nobody_waits)
    store = first.runs.begin(robot)
    stand_still(lease)
    expire(sweeper)
    later = second.runs.wait_for_lease(robot, nobody_waits)
    second.runs.begin(robot).journal(changed(PartState.ACTIVE))
    assert second.storage.flush()

    store.journal(changed(PartState.LOST))
    assert not first.storage.flush()
    with pytest.raises(RegistryError, match=r"takes nothing from this master any more: another one serves MSBOT"):
        first.robots.apply_blueprint(blueprint, library)
    assert lease.left_s() == 0
    assert isinstance(lease.why_lost(), LeaseLost)
    assert str(lease.why_lost()) == "another master serves MSBOT_MASTER now: this one has stopped"
    assert lasts(later)
    assert [part.state for part in second.robots.parts()] == ["active"]


def test_a_renewed_lease_lasts(opened: Callable[[], Registry], blueprint: Blueprint, library: Library) -> None:
    registry = opened()
    lease = registry.runs.wait_for_lease(registry.robots.apply_blueprint(blueprint, library), nobody_waits)
    assert lease.left_s() <= master_lease.TTL_S - master_lease.HARD_S - master_lease.SOFT_S
    assert lasts(lease)
    assert lasts(lease), "again and again"


def test_a_master_whose_loop_stood_still_renews_again_when_it_goes_on(
    opened: Callable[[], Registry], blueprint: Blueprint, library: Library
) -> None:
    registry = opened()
    lease = registry.runs.wait_for_lease(registry.robots.apply_blueprint(blueprint, library), nobody_waits)
    lease._loop_at = monotonic() - master_lease.STILL_S - 1
    until = monotonic() + PATIENCE_S
    while lease._trouble != "the master stood still":
        assert not lease._ended.wait(0.05)
        assert monotonic() < until
    before = lease._valid_until
    while lease._valid_until == before:
        lease.left_s()  # the loop turns again
        assert not lease._ended.wait(0.05)
        assert monotonic() < until
    assert lasts(lease)
    assert lease._trouble == ""


def test_a_master_without_standby_is_refused_while_one_with_it_serves_and_the_other_way_round(
    opened: Callable[[], Registry], blueprint: Blueprint, library: Library
) -> None:
    first, second = opened(), opened()
    robot = first.robots.apply_blueprint(blueprint, library)
    lease = first.runs.wait_for_lease(robot, nobody_waits)
    assert second.runs.is_run(robot)
    with pytest.raises(RegistryError, match="is being run by another msbot master"):
        second.runs.begin(robot)
    stand_still(lease)
    lease.release()
    assert not second.runs.is_run(robot)
    second.runs.begin(robot)
    third = opened()
    waiting = Waiting(third, blueprint)
    words = waiting.said.get(timeout=PATIENCE_S)
    assert words == (
        "standby: MSBOT_MASTER is served by a master without --standby; this one takes over when that ends"
    )
    second.close()
    assert lasts(waiting.has_it())


def test_a_frozen_holder_keeps_nobody_from_taking_over(
    opened: Callable[[], Registry],
    blueprint: Blueprint,
    library: Library,
    sweeper: Engine,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, second = opened(), opened()
    robot = first.robots.apply_blueprint(blueprint, library)
    lease = first.runs.wait_for_lease(robot, nobody_waits)
    stand_still(lease)
    monkeypatch.setattr(master_lease, "IDLE_MS", IDLE_MS)
    with first.storage.engine.connect() as connection:
        transaction = connection.begin()
        lease.fence(connection)  # and here it is frozen, in the middle of a transaction
        expire(sweeper)
        assert Waiting(second, blueprint).has_it().epoch == lease.epoch + 1
        with pytest.raises(DBAPIError):  # the server has ended that
            connection.execute(text("SELECT 1"))
        transaction.rollback()


def test_a_file_cannot_be_shared(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"robot.db is a file: give both the same --db postgresql://user@host/name"):
        master_lease.check_shareable(str(tmp_path / "robot.db"))


def test_a_transaction_that_the_server_ended_for_standing_still_is_begun_again(
    opened: Callable[[], Registry], sweeper: Engine
) -> None:
    storage, times = opened().storage, 0

    def write(connection: Connection) -> int:
        nonlocal times
        times += 1
        if times == 1:
            connection.execute(text("SET LOCAL idle_in_transaction_session_timeout = 20"))
            pid = connection.execute(text("SELECT pg_backend_pid()")).scalar_one()
            with sweeper.connect() as other:  # until the server has ended it
                while other.execute(
                    text("SELECT count(*) FROM pg_stat_activity WHERE pid = :pid"), {"pid": pid}
                ).scalar():
                    pass
        return int(connection.execute(text("SELECT 7")).scalar_one())

    assert (storage.write(write), times) == (7, 2)


def test_whoever_asks_whether_it_is_run_is_not_found_by_who_asks_next(
    opened: Callable[[], Registry],
    blueprint: Blueprint,
    library: Library,
    sweeper: Engine,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also while the server, on a busy computer, has not noticed yet that the session of who asked has ended."""
    registry, unnoticed = opened(), list[run_lock._ServerLock]()
    robot = registry.robots.apply_blueprint(blueprint, library)
    locks = text("SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND objid = :robot")
    lease = registry.runs.wait_for_lease(robot, nobody_waits)
    release = run_lock._ServerLock.release

    def keep(lock: run_lock._ServerLock) -> None:
        unnoticed.append(lock)

    with sweeper.connect() as connection:
        monkeypatch.setattr(run_lock._ServerLock, "release", keep)
        assert opened().runs.is_run(robot)
        stand_still(lease)
        lease.release()
        assert not opened().runs.is_run(robot)
        assert len(unnoticed) == 2
        assert connection.execute(locks, {"robot": robot.id}).scalar_one() == 0
    for lock in unnoticed:
        release(lock)
