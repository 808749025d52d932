"""A running robot with its page, whose database is slow, stands still, is gone, or is held by another program.

In each state parts come in, STOP gets through, what is not stored is said by page and command, and a change is either
stored or refused. In the end the master is killed, and everything that was acknowledged is there.
"""

from __future__ import annotations

import os
import signal
import socket
import socketserver
import sqlite3
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest

from msbot.registry import open_registry
from tests.e2e.processes import run
from tests.hostile.robot import PATIENCE_S, Robot, frozen, until
from tests.registry import postgres

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="this system has no Unix sockets"),
    pytest.mark.timeout(300),  # five processes one after the other, each slow beside other work
]

SLOW_S = 0.02
"""So long a slow server's answers, and what it is asked, are on their way: some seconds for each change."""


class SlowWay:
    """Stands between a master and its PostgreSQL server; a Unix socket in a folder of its own."""

    def __init__(self, server: Path, folder: Path) -> None:
        self.delay_s = 0.0
        way = self

        class Visit(socketserver.BaseRequestHandler):
            def handle(self) -> None:
                with socket.socket(socket.AF_UNIX) as onward:
                    try:
                        onward.connect(str(server / ".s.PGSQL.5432"))
                    except OSError:
                        return  # the server is gone: so is the way to it
                    back = threading.Thread(target=way.carry, args=(onward, self.request), daemon=True)
                    back.start()
                    way.carry(self.request, onward)
                    back.join()

        self.listening = socketserver.ThreadingUnixStreamServer(str(folder / ".s.PGSQL.5432"), Visit)
        self.listening.daemon_threads = True

    def carry(self, source: socket.socket, target: socket.socket) -> None:
        """All that comes from one side, until it ends."""
        try:
            while octets := source.recv(65536):
                time.sleep(self.delay_s)
                target.sendall(octets)
        except OSError:
            pass  # the other direction has ended it
        for end in (source, target):
            with_no_more = end.shutdown
            try:
                with_no_more(socket.SHUT_RDWR)
            except OSError:
                continue


@contextmanager
def slow_way(server: Path, folder: Path) -> Iterator[SlowWay]:
    way = SlowWay(server, folder)
    thread = threading.Thread(target=way.listening.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield way
    finally:
        way.listening.shutdown()
        way.listening.server_close()
        thread.join()


class Changes:
    """Changes by a person; remembers which were acknowledged."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.acknowledged: list[object] = []

    def make(self) -> str:
        """Block or unblock a kind of part; gives what was said."""
        deed = "unblock" if len(self.acknowledged) % 2 else "block"
        status, answer = self.robot.call("POST", f"/parts/WXYZ/{deed}", {"reason": "a test"} if deed == "block" else {})
        if status == 200:
            self.acknowledged.append(answer["edit"])
        return str(answer)


def trouble(robot: Robot) -> str:
    """What the page says of the database."""
    status, answer = robot.call("GET", "/robot")
    assert status == 200
    return str(answer["trouble"])


@pytest.fixture
def server() -> Iterator[tuple[Path, Path]]:
    """The programs of PostgreSQL, and the folder of a server of this test's own."""
    programs = postgres.find_server()
    if programs is None:
        if os.environ.get(postgres.NEEDED):
            pytest.fail(postgres.MISSING)
        pytest.skip(postgres.MISSING)
    with postgres.running_server(programs) as address:
        yield programs, Path(address.partition("host=")[2])


@pytest.mark.promise("Nothing acknowledged is lost when the database is slow, locked, frozen or gone")
def test_with_a_slow_a_frozen_and_a_crashed_database_server(server: tuple[Path, Path], tmp_path: Path) -> None:
    programs, cluster = server
    (tmp_path / "way").mkdir()
    with slow_way(cluster, tmp_path / "way") as way, ExitStack() as stack:
        robot = Robot(tmp_path, stack, f"postgresql://msbot@/postgres?host={tmp_path / 'way'}")
        master = robot.master(page=True)
        changes = Changes(robot)
        changes.make()
        assert len(changes.acknowledged) == 1

        way.delay_s = SLOW_S
        with ThreadPoolExecutor(1) as aside:
            change = aside.submit(changes.make)
            robot.parts("AA")
            stops(robot)
            assert change.result(PATIENCE_S)
        way.delay_s = 0.0

        with frozen(cluster):
            refused(changes)
            robot.parts("BB")  # what it claims is looked up in memory
            stops(robot)
            until(lambda: "has not answered for" in trouble(robot))
            done = run("parts", "--db", robot.db or "", cwd=robot.folder, env=robot.env)
            assert "may be older than the robot: the database" in done.stderr
            assert "Traceback" not in done.stderr
        until(lambda: not trouble(robot))

        crash(int((cluster / "data/postmaster.pid").read_text().split()[0]))
        refused(changes)
        robot.parts("CC")
        stops(robot)
        until(lambda: bool(trouble(robot)))
        with postgres.serving(programs, cluster):
            until(lambda: not trouble(robot))
            before = len(changes.acknowledged)
            changes.make()
            assert len(changes.acknowledged) == before + 1
            run("parts", "--db", robot.db or "", cwd=robot.folder, env=robot.env)  # waits until all is stored
            master.end(signal.SIGKILL)
            everything_is_there(robot, changes, {"AA", "BB", "CC"})


@pytest.mark.promise("Nothing acknowledged is lost when the database is slow, locked, frozen or gone")
def test_with_another_program_that_holds_the_lock_of_the_file(tmp_path: Path) -> None:
    with ExitStack() as stack:
        robot = Robot(tmp_path, stack)
        master = robot.master(page=True)
        changes = Changes(robot)
        changes.make()
        with closing(sqlite3.connect(tmp_path / "robot.db", isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")  # for as long as all this takes
            assert "is locked by another program" in refused(changes)
            robot.parts("AA")
            stops(robot)
            until(lambda: "is locked by another program" in trouble(robot))
            done = run("parts", cwd=robot.folder, env=robot.env)
            assert "is locked by another program" in done.stderr
            assert "Traceback" not in done.stderr
        until(lambda: not trouble(robot))
        changes.make()
        assert len(changes.acknowledged) == 2
        run("parts", cwd=robot.folder, env=robot.env)
        master.end(signal.SIGKILL)
        everything_is_there(robot, changes, {"AA"})


def crash(server: int) -> None:
    """End a server and all its sessions at once, as it does when one of them has damaged its memory."""
    os.kill(server, signal.SIGQUIT)

    def is_gone() -> bool:
        try:
            return Path(f"/proc/{server}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
        except FileNotFoundError:
            return True

    until(is_gone)


def stops(robot: Robot) -> None:
    """STOP reaches the master and every part, and is stored; by the page, too."""
    robot.tell("stop")
    until(lambda: robot.tell("status")["stored"] is True)  # the file has it
    robot.tell("go")
    status, answer = robot.call("POST", "/stop", {})
    assert status == 200, answer
    assert robot.tell("status")["stopped"]
    robot.tell("go")


def refused(changes: Changes) -> str:
    """A change is not acknowledged, in words."""
    before = len(changes.acknowledged)
    words = changes.make()
    assert len(changes.acknowledged) == before
    assert "nothing was changed" in words or "not known yet" in words or "does not answer" in words, words
    return words


def everything_is_there(robot: Robot, changes: Changes, slots: set[str]) -> None:
    """What was acknowledged is stored, and so is who came in while nothing could be."""
    with open_registry(robot.db or robot.folder / "robot.db", read_only=True) as registry:
        (record,) = registry.robots.all()
        kept = {edit.id for edit in registry.edits.latest(record, 100)}
        assert set(changes.acknowledged) <= kept
        assert {part.slot for part in registry.robots.parts(record)} == slots
