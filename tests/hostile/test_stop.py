"""STOP gets through to a master whatever else is wrong with it, and survives whatever becomes of the master.

Each state of trouble lasts until the test has its answer: an answer at all shows that STOP did not wait for its end.
How many milliseconds it takes is in bench/results/stop_under_flood.md.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import pytest

from msbot_agent.agent.status_files import find_status_files
from tests.e2e.processes import Process, run
from tests.hostile.robot import Robot, until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="this system has no Unix sockets")

PATIENCE_S = 90.0


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield Robot(tmp_path, stack)


def said_until(robot: Robot, is_so: Callable[[dict[str, object]], bool], *options: str) -> dict[str, object]:
    """The command's answer, when it is so: it waits for parts and disk for 2 s, and a busy computer may need more."""
    said: dict[str, object] = {}

    def is_said() -> bool:
        said.update(robot.ask("stop", *options))
        return is_so(said)

    until(is_said)
    return said


@pytest.mark.promise("STOP holds after the master was killed or ended, until GO")
def test_stop_survives_the_end_of_the_master_until_go(robot: Robot) -> None:
    master = robot.master()
    parts = robot.parts("AA", "BB")
    said = said_until(robot, lambda said: (said["silent"], said["stored"]) == ([], True), "--reason", "gear")
    assert said["told"] == 2
    confirmed = said["confirmed"]
    assert isinstance(confirmed, list)
    assert {one["part"] for one in confirmed} == {"ABCD-local", "EFGH-local"}
    for how in (signal.SIGKILL, signal.SIGTERM):
        master.end(how)
        master = robot.master()
        master.wait_for("STOP holds since before")
        for part in parts.values():
            part.wait_for("is active: in slot")  # it has never ended for the part
    until(lambda: not robot.tell("status")["silent"])
    assert isinstance(robot.tell("status")["since"], float)
    assert robot.ask("go")["stopped"] is False
    master.end(signal.SIGKILL)
    robot.master()
    status = robot.ask("stop", "--status")
    assert (status["stopped"], status["by"], status["since"]) == (False, None, None)


@pytest.mark.promise("STOP holds after an older backup was restored, and without its file")
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


@pytest.mark.promise("A part that does not confirm STOP is named")
def test_a_frozen_part_is_named(robot: Robot) -> None:
    robot.master()
    parts = robot.parts("AA", "BB")
    parts["BB"].send(signal.SIGSTOP)
    try:
        said = said_until(robot, lambda said: said["silent"] == ["EFGH-local"])
        assert said["told"] == 2
        done = run("stop", "--status", cwd=robot.folder, env=robot.env)
        assert "NOT confirmed: EFGH-local: it may still move" in done.stdout
    finally:
        parts["BB"].send(signal.SIGCONT)
    until(lambda: not robot.tell("status")["silent"])


# States in which everything else is stuck


@contextmanager
def silent_connections(robot: Robot, _master: Process) -> Iterator[None]:
    """40 programs have connected to the status port and say nothing."""
    (file,) = find_status_files(robot.folder / "run" / "msbot")
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


@contextmanager
def a_blueprint_is_compared(robot: Robot, master: Process) -> Iterator[None]:
    """Somebody compares a blueprint, and whoever does it for the master does not come to an end."""
    question = ("POST", "/blueprint/diff", {"toml": (robot.folder / "robot.toml").read_text()})
    before = children(master)
    assert robot.call(*question) == (200, {"changes": []})
    (worker,) = children(master) - before  # it stays for the next question
    os.kill(worker, signal.SIGSTOP)
    with ThreadPoolExecutor(1) as aside:
        answer = aside.submit(robot.call, *question)
        try:
            yield
            assert not answer.done()
        finally:
            os.kill(worker, signal.SIGCONT)
        assert answer.result(PATIENCE_S) == (200, {"changes": []})


def children(master: Process) -> set[int]:
    """The processes that a master has started."""
    found = subprocess.run(["pgrep", "-P", str(master.pid)], capture_output=True, text=True, check=False).stdout
    return {int(pid) for pid in found.split()}


@pytest.mark.promise("STOP is obeyed while the master lacks descriptors, disk or its database")
def test_stop_gets_through_when_everything_else_is_stuck(robot: Robot) -> None:
    master = robot.master(page=True)
    robot.parts("AA")
    page = robot.open_page()
    for state in (
        a_blueprint_is_compared,
        silent_connections,
        somebody_elses_folder,
        no_descriptor_left,
        no_file_can_be_written,
    ):
        with state(robot, master):
            assert robot.tell("stop")["told"] == 1, state.__doc__
            until(lambda: robot.tell("status")["stored"] is True)
            robot.tell("go")
            answer = page.post("/stop", json={})
            assert answer.status_code == httpx.codes.OK, (state.__doc__, answer.text)
            assert robot.tell("status")["stopped"], state.__doc__
            robot.tell("go")
    master.send(signal.SIGSTOP)
    try:
        done = run("stop", cwd=robot.folder, env=robot.env)
    finally:
        master.send(signal.SIGCONT)
    assert done.returncode == 2
    assert "NOT delivered" in done.stderr
