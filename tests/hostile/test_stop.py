"""STOP gets through to a master whatever else is wrong with it, and survives whatever becomes of the master.

Each state of trouble lasts until the test has its answer: an answer at all shows that STOP did not wait for its end.
How many milliseconds it takes is in docs/explain/reliability.md.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from msbot.agent.status_files import find_files
from msbot.cli.options import database_identity
from msbot.runtime.stop_datagram import ask_masters
from tests.e2e.processes import Process, run, running
from tests.e2e.test_processes import free_port
from tests.registry import postgres

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="this system has no Unix sockets")

PATIENCE_S = 30.0


class Robot:
    """A master and its parts as processes, in folders of their own."""

    def __init__(self, folder: Path, stack: ExitStack, db: str | None = None) -> None:
        self.folder, self.stack, self.db = folder, stack, db
        self.link = f"udp:127.0.0.1:{free_port()}"
        (folder / "run").mkdir(mode=0o700)
        self.env = {"XDG_STATE_HOME": str(folder / "state"), "XDG_RUNTIME_DIR": str(folder / "run")}
        assert run("init", cwd=folder).returncode == 0

    def master(self) -> Process:
        options = () if self.db is None else ("--db", self.db)
        process = running("master", "--no-page", "--link", self.link, *options, cwd=self.folder, env=self.env)
        started = self.stack.enter_context(process)
        started.wait_for("is up on", self.link)
        return started

    def part(self, name: str) -> Process:
        process = running("part", name, "--link", self.link, cwd=self.folder, env=self.env)
        return self.stack.enter_context(process)

    def parts(self, *names: str) -> dict[str, Process]:
        started = {name: self.part(name) for name in names}
        for one in started.values():
            one.wait_for("is active")
        return started

    def ask(self, *words: str) -> dict[str, object]:
        """A command with --json."""
        options = () if self.db is None else ("--db", self.db)
        done = run(*words, *options, "--json", cwd=self.folder, env=self.env)
        assert done.returncode == 0, done.stderr
        answer = json.loads(done.stdout)
        assert isinstance(answer, dict)
        return answer

    def tell(self, do: str) -> dict[str, object]:
        """The same without the time that a command takes to start; STOP waits for its confirmations."""
        database = database_identity(self.db or str(self.folder / "robot.db"))
        ((answer,), _) = ask_masters({"do": do, "who": "ann", "database": database}, PATIENCE_S)
        until(lambda: do != "stop" or not self.tell("status")["silent"])
        return answer | ({"silent": []} if do == "stop" else {})


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield Robot(tmp_path, stack)


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition, and not for ever."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it does not come to that"
        time.sleep(0.05)


def test_stop_survives_the_end_of_the_master_until_go(robot: Robot) -> None:
    master = robot.master()
    parts = robot.parts("AA", "BB")
    said = robot.ask("stop", "--reason", "gear")
    assert (said["told"], said["silent"], said["stored"]) == (2, [], True)
    confirmed = said["confirmed"]
    assert isinstance(confirmed, list)
    assert {one["part"] for one in confirmed} == {"ABCD-local", "EFGH-local"}
    for how in (signal.SIGKILL, signal.SIGTERM):
        master.end(how)
        master = robot.master()
        master.wait_for("STOP holds since before")
        for part in parts.values():
            part.wait_for("STOP: it holds in the robot that the part has joined")
    until(lambda: not robot.tell("status")["silent"])
    assert isinstance(robot.tell("status")["since"], float)
    assert robot.ask("go")["stopped"] is False
    master.end(signal.SIGKILL)
    robot.master()
    assert robot.ask("stop", "--status") == {"stopped": False, "by": None, "since": None}


def test_stop_holds_after_an_older_backup_and_without_the_file(robot: Robot) -> None:
    master = robot.master()
    assert run("db", "backup", "old.db", cwd=robot.folder, env=robot.env).returncode == 0
    robot.tell("stop")
    master.end()
    done = run("db", "restore", "--yes", "old.db", cwd=robot.folder, env=robot.env)
    assert done.returncode == 0, done.stderr
    again = robot.master()
    assert robot.tell("status")["stopped"], "the file is newer than the backup"
    robot.tell("stop")  # said once more, so that the database knows it, too
    again.end()
    for kept in (robot.folder / "state/msbot/stop").glob("*.json"):
        kept.unlink()
    robot.master()
    assert robot.tell("status")["stopped"], "another computer has the database, and no file"


def test_a_frozen_part_is_named(robot: Robot) -> None:
    robot.master()
    parts = robot.parts("AA", "BB")
    parts["BB"].send(signal.SIGSTOP)
    try:
        said = robot.ask("stop")
        assert said["silent"] == ["EFGH-local"]
        assert said["told"] == 2
        done = run("stop", "--status", cwd=robot.folder, env=robot.env)
        assert "NOT confirmed: EFGH-local: they may still move" in done.stdout
    finally:
        parts["BB"].send(signal.SIGCONT)
    until(lambda: not robot.tell("status")["silent"])


# States in which everything else is stuck


@contextmanager
def silent_connections(robot: Robot, _master: Process) -> Iterator[None]:
    """40 programs have connected to the status port and say nothing."""
    (file,) = find_files(robot.folder / "run" / "msbot")
    with ExitStack() as held:
        for _ in range(40):
            held.enter_context(socket.create_connection(("127.0.0.1", file.port)))
        yield


@contextmanager
def somebody_elses_folder(robot: Robot, _master: Process) -> Iterator[None]:
    """The folder of the status files is not this user's alone, so that nothing in it is believed."""
    folder = robot.folder / "run" / "msbot"
    folder.chmod(0o777)
    yield
    folder.chmod(0o700)


@contextmanager
def no_descriptor_left(_robot: Robot, master: Process) -> Iterator[None]:
    """The master can open nothing any more."""
    resource = pytest.importorskip("resource")
    before = resource.prlimit(master.pid, resource.RLIMIT_NOFILE)
    used = len(os.listdir(f"/proc/{master.pid}/fd"))
    resource.prlimit(master.pid, resource.RLIMIT_NOFILE, (used, before[1]))
    yield
    resource.prlimit(master.pid, resource.RLIMIT_NOFILE, before)


@contextmanager
def no_file_can_be_written(robot: Robot, _master: Process) -> Iterator[None]:
    """There is no folder for the file with STOP, and none can be made: the database has to do."""
    kept, aside = robot.folder / "state/msbot/stop", robot.folder / "state/msbot/aside"
    if kept.exists():
        kept.rename(aside)
    kept.write_text("a file where the folder should be")
    yield
    kept.unlink()
    if aside.exists():
        aside.rename(kept)


def test_stop_gets_through_when_everything_else_is_stuck(robot: Robot) -> None:
    master = robot.master()
    robot.parts("AA")
    for state in (silent_connections, somebody_elses_folder, no_descriptor_left, no_file_can_be_written):
        with state(robot, master):
            said = robot.tell("stop")
            assert (said["told"], said["stored"]) == (1, True), state.__doc__
            robot.tell("go")
    master.send(signal.SIGSTOP)
    try:
        done = run("stop", cwd=robot.folder, env=robot.env)
    finally:
        master.send(signal.SIGCONT)
    assert done.returncode == 2
    assert "NOT delivered" in done.stderr


@contextmanager
def frozen(folder: Path) -> Iterator[None]:
    """A PostgreSQL server that does not answer any more: all of its processes stand still."""
    leader = int((folder / "data/postmaster.pid").read_text().split()[0])
    children = subprocess.run(["pgrep", "-P", str(leader)], capture_output=True, text=True, check=False).stdout
    everybody = [leader, *(int(pid) for pid in children.split())]
    for pid in everybody:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in everybody:
            os.kill(pid, signal.SIGCONT)


@pytest.fixture
def server() -> Iterator[str]:
    programs = postgres.find_server()
    if programs is None:
        if os.environ.get(postgres.NEEDED):
            pytest.fail(postgres.MISSING)
        pytest.skip(postgres.MISSING)
    with postgres.running_server(programs) as address:
        yield address


def test_with_a_frozen_database_server(server: str, tmp_path: Path) -> None:
    with ExitStack() as stack:
        robot = Robot(tmp_path, stack, server.format("postgres"))
        robot.master()
        robot.parts("AA")
        with frozen(Path(server.partition("host=")[2])):
            robot.part("BB").wait_for("is active")  # what it claims is looked up in memory
            assert robot.tell("stop")["stored"] is True, "the file has it"


def test_with_the_database_server_gone(server: str, tmp_path: Path) -> None:
    with ExitStack() as stack:
        robot = Robot(tmp_path, stack, server.format("postgres"))
        master = robot.master()
        robot.parts("AA")
        leader = int((Path(server.partition("host=")[2]) / "data/postmaster.pid").read_text().split()[0])
        os.kill(leader, signal.SIGQUIT)
        said = robot.tell("stop")
        assert (said["told"], said["stored"]) == (1, True)
        master.end(signal.SIGKILL)
