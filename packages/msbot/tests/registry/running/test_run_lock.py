"""One master for each robot of a database."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import Engine, text
from sqlalchemy.exc import OperationalError, SQLAlchemyError

from msbot.config import Blueprint, Library
from msbot.pnp import PartState
from msbot.registry import Registry, open_registry
from msbot.registry.database.engine import parse_address
from msbot.registry.running import run_lock
from msbot.registry.running.master_lease import _LOOK, LOCK_CLASS
from msbot.registry.running.run_lock import RunLock
from msbot_xrce.errors import RegistryError
from tests.registry.events import changed

HOLDER = """
import sys
from msbot.registry import open_registry

registry = open_registry(sys.argv[1])
registry.runs.begin(registry.robots.all()[0])
print("running", flush=True)
sys.stdin.read()
"""


def test_a_second_master_is_refused_and_disturbs_nothing(
    registry: Registry, impatient: Registry, path: Path, blueprint: Blueprint, library: Library
) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    registry.runs.begin(robot).journal(changed(PartState.ACTIVE))
    registry.storage.flush()
    with pytest.raises(RegistryError) as caught:
        impatient.runs.begin(impatient.robots.apply_blueprint(blueprint, library))
    assert str(caught.value) == (
        f"robot MSBOT_MASTER is being run by another msbot master with the database {path}: stop that one, "
        "or give this one another --db and another port"
    )
    assert [part.state for part in registry.robots.parts()] == ["active"]
    registry.close()
    impatient.runs.begin(robot)
    assert [part.state for part in impatient.robots.parts()] == ["lost"]


def test_two_robots_of_one_database_are_run_by_two_masters(
    registry: Registry, impatient: Registry, blueprint: Blueprint, library: Library
) -> None:
    registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
    other = replace(blueprint, robot=replace(blueprint.robot, serial_number="2"))
    impatient.runs.begin(impatient.robots.apply_blueprint(other, library))


def test_the_same_master_may_ask_again(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    registry.runs.begin(robot)
    registry.runs.begin(robot)


def test_a_killed_master_leaves_no_lock(path: Path, blueprint: Blueprint, library: Library) -> None:
    with open_registry(path, busy_timeout_s=0.01) as registry:
        robot = registry.robots.apply_blueprint(blueprint, library)
        command = [sys.executable, "-c", HOLDER, str(path)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "running\n"
            with pytest.raises(RegistryError, match="is being run by another msbot master"):
                registry.runs.begin(robot)
            holder.kill()
        registry.runs.begin(robot)


def test_a_lock_that_cannot_be_made_is_told(
    registry: Registry, path: Path, blueprint: Blueprint, library: Library
) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    path.with_name(f"robot.db.running{robot.id}").mkdir()
    with pytest.raises(RegistryError, match=r"robot.db cannot be opened: look at the permissions of the file"):
        registry.runs.begin(robot)


class _Server:
    """Stands in for an engine and its connection; a real server is tested elsewhere."""

    def __init__(self, sqlstate: str) -> None:
        self.said: list[str] = []
        self.url = parse_address("postgresql://teacher:secret@host/robots").url
        self._sqlstate = sqlstate

    def connect(self) -> "_Server":
        return self

    def execution_options(self, **options: str) -> "_Server":
        self.said.append(str(options))
        return self

    def execute(self, statement: object, values: dict[str, int] | None = None) -> "_Server":
        self.said.append(f"{statement} {values}")
        if self._sqlstate and "pg_advisory_lock" in str(statement):
            error = Exception("canceling statement due to lock timeout")
            error.sqlstate = self._sqlstate  # type: ignore[attr-defined]  # as psycopg's errors have it
            raise OperationalError("SELECT", None, error)
        return self

    def one_or_none(self) -> None:
        """No master holds a lease."""

    def scalar_one(self) -> int:
        """The number of the session."""
        return 7

    @property
    def closed(self) -> bool:
        return "close" in self.said

    def invalidate(self) -> None:
        self.said.append("invalidate")

    def close(self) -> None:
        self.said.append("close")


def test_on_a_server_it_is_an_advisory_lock(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    address = parse_address("postgresql://teacher:secret@host/robots")
    server = _Server("")
    lock = RunLock(server, address, robot, 2.0)  # type: ignore[arg-type]  # see _Server
    assert server.said == [
        "{'isolation_level': 'AUTOCOMMIT'}",
        "SELECT pg_backend_pid() None",
        "SET lock_timeout = 2000 None",
        "SELECT pg_advisory_lock(:kind, :robot) {'kind': 1299399252, 'robot': 1}",
        f"{_LOOK} {{'robot': 1}}",
    ]
    lock.release()
    lock.release()
    assert server.said[5:] == ["invalidate", "close"]


def test_a_lock_file_that_somebody_has_deleted_gives_nobody_else_the_robot(
    registry: Registry, impatient: Registry, path: Path, blueprint: Blueprint, library: Library
) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    registry.runs.begin(robot)
    registry.storage.writer.watch(lambda _: None, lambda _: lambda _: None)  # the thread looks when this test says so
    file = path.with_name(f"robot.db.running{robot.id}")

    def look() -> None:
        with registry.storage.engine.connect() as connection:
            registry.runs._look(connection)

    file.unlink()
    assert not impatient.runs.is_run(robot)
    with ThreadPoolExecutor(1) as writer:  # it is another thread that looks
        writer.submit(look).result()
        assert impatient.runs.is_run(robot)
        with pytest.raises(RegistryError, match="is being run by another msbot master"):
            impatient.runs.begin(robot)
        file.unlink()
        file.mkdir()  # it cannot be made anew, by nobody
        writer.submit(look).result()
        file.rmdir()
        writer.submit(look).result()
    assert impatient.runs.is_run(robot)
    registry.runs.release()
    assert not impatient.runs.is_run(robot)


def end_sessions_with_the_lock(engine: Engine) -> None:
    """As a server that restarts does."""
    with engine.connect() as connection:
        ended = connection.execute(
            text(
                "SELECT pg_terminate_backend(pid, 10000) FROM pg_locks WHERE locktype = 'advisory' AND classid = :kind "
                "AND granted AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
            ),
            {"kind": LOCK_CLASS},
        ).all()
    assert [row[0] for row in ended] == [True]


def test_a_session_that_the_server_has_ended_gives_nobody_else_the_robot(
    clean_server_database: str,
    sweeper: Engine,
    blueprint: Blueprint,
    library: Library,
    caplog: pytest.LogCaptureFixture,
) -> None:
    with (
        open_registry(clean_server_database) as first,
        open_registry(clean_server_database) as second,
        first.storage.engine.connect() as looks,
    ):
        robot = first.robots.apply_blueprint(blueprint, library)
        first.runs.begin(robot)
        first.storage.writer.watch(lambda _: None, lambda _: lambda _: None)  # the thread looks when this test says so
        assert second.runs.is_run(robot)
        end_sessions_with_the_lock(sweeper)
        first.runs._look(looks)  # as the writer's thread does once a second
        assert second.runs.is_run(robot)
        end_sessions_with_the_lock(sweeper)
        second.runs.begin(robot)  # before that thread has looked
        caplog.clear()
        for _ in range(3):
            first.runs._look(looks)
        second.close()
        for _ in range(3):
            first.runs._look(looks)
        assert [record.getMessage() for record in caplog.records if record.name == "msbot.registry.running.runs"] == [
            "another master runs MSBOT_MASTER now, beside this one: end one of the two",
            "this master alone runs MSBOT_MASTER again",
        ]
        with open_registry(clean_server_database) as third:
            assert third.runs.is_run(robot)
        first.runs.release()
        first.runs._look(looks)  # once more in that thread, after its end
        with open_registry(clean_server_database) as third:
            third.runs.begin(robot)  # as soon as the server has seen that the session is gone


def test_whoever_ends_leaves_no_lock_behind(
    clean_server_database: str,
    blueprint: Blueprint,
    library: Library,
    sweeper: Engine,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also while the server, on a busy computer, has not noticed yet that the session has ended."""
    unnoticed: list[run_lock._ServerLock] = []
    release = run_lock._ServerLock.release

    def keep(lock: run_lock._ServerLock) -> None:
        unnoticed.append(lock)

    with open_registry(clean_server_database) as first:
        robot = first.robots.apply_blueprint(blueprint, library)
        first.runs.begin(robot)
        monkeypatch.setattr(run_lock._ServerLock, "release", keep)
    locks = text("SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND objid = :robot")
    with sweeper.connect() as connection:
        assert connection.execute(locks, {"robot": robot.id}).scalar_one() == 0
    (lock,) = unnoticed
    release(lock)


def test_a_session_that_broke_on_the_way_does_not_keep_its_own_master_out(
    clean_server_database: str, blueprint: Blueprint, library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_registry(clean_server_database) as first, open_registry(clean_server_database) as second:
        robot = first.robots.apply_blueprint(blueprint, library)
        first.runs.begin(robot)
        first.storage.writer.watch(lambda _: None, lambda _: lambda _: None)
        lock = first.runs._locks[robot.id]
        assert isinstance(lock, RunLock)
        held = lock._lock
        assert isinstance(held, run_lock._ServerLock)
        # The server still has the session, and nothing comes through it: neither an answer nor its end.
        with monkeypatch.context() as broken:
            broken.setattr(held._connection, "execute", _broken)
            broken.setattr(held, "release", lambda: None)
            assert lock.renew()
        assert lock._lock is not held
        assert second.runs.is_run(robot)
        with pytest.raises(SQLAlchemyError):
            held._connection.execute(text("SELECT 1"))
        held.release()
        assert second.runs.is_run(robot)
        first.runs.release()
        second.runs.begin(robot)  # as soon as the server has seen that the session is gone


def _broken(*_: object) -> None:
    raise OperationalError("SELECT 1", None, Exception("no route to host"))


def test_a_lock_that_is_given_back_while_it_is_taken_anew_stays_free(
    registry: Registry, path: Path, blueprint: Blueprint, library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    lock = RunLock(registry.storage.engine, registry.storage.address, robot, 0.1)
    file = path.with_name(f"robot.db.running{robot.id}")
    file.unlink()
    take = lock._take

    def meanwhile(timeout_s: float) -> object:
        taken = take(timeout_s)
        lock.release()  # as another thread does when the master ends
        return taken

    monkeypatch.setattr(lock, "_take", meanwhile)
    assert lock.renew()
    assert not registry.runs.is_run(robot)


@pytest.mark.parametrize(
    ("sqlstate", "words"),
    [
        ("55P03", r"with the database postgresql://teacher:\*\*\*@host/robots: stop that one"),
        ("57P01", r"the database postgresql://teacher:\*\*\*@host/robots cannot be used \(canceling statement"),
    ],
)
def test_on_a_server_a_second_master_is_refused(
    registry: Registry, blueprint: Blueprint, library: Library, sqlstate: str, words: str
) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    server = _Server(sqlstate)
    with pytest.raises(RegistryError, match=words):
        RunLock(server, parse_address("postgresql://teacher:secret@host/robots"), robot, 2.0)  # type: ignore[arg-type]
    assert server.said[-2:] == ["invalidate", "close"]
