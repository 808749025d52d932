"""The same robot as four processes over UDP: kill -9, restarts, a second robot, mistakes."""

import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from random import Random

import pytest

from tests.e2e.processes import Process, run, running, wait_for_states


def free_port() -> int:
    """A port below those that the system gives to clients: it stays free while the master is being restarted."""
    for port in Random().sample(range(20_000, 32_000), 100):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError("no free port")


class Robot:
    def __init__(self, folder: Path, stack: ExitStack, port: int) -> None:
        self.folder, self.stack = folder, stack
        self.link = f"udp:127.0.0.1:{port}"
        self.state = {"XDG_STATE_HOME": str(folder / "state")}
        assert run("init", cwd=folder).returncode == 0

    def master(self) -> Process:
        process = self.stack.enter_context(running("master", "--no-page", "--link", self.link, cwd=self.folder))
        process.wait_for("is up on", self.link)
        return process

    def part(self, name: str) -> Process:
        return self.stack.enter_context(running("part", name, "--link", self.link, cwd=self.folder, env=self.state))


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield Robot(tmp_path, stack, free_port())


def test_four_processes_make_a_robot_and_survive_kill_9(robot: Robot) -> None:
    master = robot.master()
    parts = {name: robot.part(name) for name in ("AA", "BB", "CC")}
    for part in parts.values():
        part.wait_for("active")
    parts["BB"].wait_for("output", "on")  # AA's "turn-on N" switches BB's output N

    parts["BB"].end(signal.SIGKILL)
    again = robot.part("BB")
    again.wait_for("active")
    again.wait_for("output", "on")

    parts["AA"].end(signal.SIGKILL)
    master.wait_for("AA", "late")
    master.wait_for("AA", "lost")

    wait_for_states({"AA": "lost", "BB": "active", "CC": "active"}, cwd=robot.folder)
    why = run("why", "AA", cwd=robot.folder)
    assert why.returncode == 0, why.stderr
    assert "lost" in why.stdout


def test_the_parts_come_back_when_the_master_was_killed_and_started_again(robot: Robot) -> None:
    first = robot.master()
    parts = [robot.part(name) for name in ("AA", "BB", "CC")]
    for part in parts:
        part.wait_for("active")
    first.end(signal.SIGKILL)
    for part in parts:
        part.wait_for("lost")
    second = robot.master()
    for _ in parts:
        second.wait_for("active")
    for part in parts:
        part.wait_for("active")
        assert part.end(signal.SIGINT) == 0
    assert second.end(signal.SIGTERM) == 0


def test_a_port_in_use_is_one_sentence_with_the_remedy(robot: Robot) -> None:
    robot.master()
    (robot.folder / "other").mkdir()
    second = run("init", cwd=robot.folder / "other")
    assert second.returncode == 0
    done = run("master", "--no-page", "--link", robot.link, cwd=robot.folder / "other")
    assert done.returncode == 2
    assert "another program listens there" in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_part_of_an_unknown_name_is_one_sentence(tmp_path: Path) -> None:
    done = run("part", "ZZ", cwd=tmp_path)
    assert done.returncode == 2
    assert "msbot library list" in done.stderr
