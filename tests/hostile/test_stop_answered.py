"""What the answer to a STOP says is true, whatever the process has run out of, and whatever the request looks like."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import httpx
import pytest

from tests.e2e.processes import Process, run
from tests.effort import THOROUGH
from tests.hostile.robot import TOKEN, Robot, until

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux limits a running process")

OK, CONFLICT = 200, 409
ROUNDS = 5 if THOROUGH else 1
"""How often the master is killed after each way of saying STOP."""
PRESSES = 500


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield Robot(tmp_path, stack)


def stop(robot: Robot, **request: object) -> httpx.Response:
    """STOP by the API, over a connection of its own."""
    headers = {"authorization": f"Bearer {TOKEN}", **request.pop("headers", {})}  # type: ignore[dict-item]
    return httpx.post(f"{robot.page}/stop", headers=headers, timeout=90.0, **request)  # type: ignore[arg-type]


def by_api(robot: Robot) -> bool:
    return stop(robot).json()["stored"] is True


def by_socket(robot: Robot) -> bool:
    """As `msbot stop` says it."""
    return robot.tell("stop")["stored"] is True


@pytest.mark.promise("A STOP that was answered as stored holds after kill -9, by whatever way it was said")
def test_what_is_told_as_stored_holds_after_kill_9(robot: Robot) -> None:
    master = robot.master(page=True)
    for say in (by_api, by_socket) * ROUNDS:
        assert say(robot)
        master.end(signal.SIGKILL)
        master = robot.master(page=True)
        assert robot.tell("status")["stopped"], say.__name__
        robot.tell("go")


# What a process can run out of


@contextmanager
def nothing_can_be_written(_robot: Robot, master: Process) -> Iterator[None]:
    """The disk takes nothing more, neither in the file nor in the database."""
    with limited(master, "RLIMIT_FSIZE", lambda: 0):
        yield


@contextmanager
def no_descriptor_left(_robot: Robot, master: Process) -> Iterator[None]:
    """The master can open nothing any more."""
    with limited(master, "RLIMIT_NOFILE", lambda: len(os.listdir(f"/proc/{master.pid}/fd"))):
        yield


@contextmanager
def no_thread_can_be_started(_robot: Robot, master: Process) -> Iterator[None]:
    """There is no memory left for the stack of another thread, and little for anything else."""

    def size() -> int:
        found = re.search(r"VmSize:\s+(\d+) kB", Path(f"/proc/{master.pid}/status").read_text())
        assert found is not None
        return (int(found[1]) + 1024) * 1024

    with limited(master, "RLIMIT_AS", size):
        yield


@contextmanager
def limited(master: Process, name: str, most: Callable[[], int]) -> Iterator[None]:
    import resource

    which = getattr(resource, name)
    before = resource.prlimit(master.pid, which)
    resource.prlimit(master.pid, which, (most(), before[1]))
    yield
    resource.prlimit(master.pid, which, before)


@pytest.mark.promise("STOP is obeyed and truly told without threads, descriptors, memory or room on the disk")
def test_the_first_stop_is_obeyed_and_truly_told_whatever_has_run_out(robot: Robot) -> None:
    master = robot.master(page=True)
    robot.parts("AA")
    assert robot.call("GET", "/robot")[0] == OK
    for state in (no_descriptor_left, no_thread_can_be_started):
        with state(robot, master):
            answer = stop(robot)
            assert (answer.status_code, answer.json().get("stored")) == (OK, True), (state.__doc__, answer.text)
            assert robot.tell("status")["stopped"], state.__doc__
            assert robot.call("POST", "/go", {"stop": answer.json()["stop"]})[0] == OK
            assert robot.tell("stop")["stored"] is True, state.__doc__
            robot.tell("go")
    with nothing_can_be_written(robot, master):
        answer = stop(robot)
        assert answer.status_code == OK
        assert answer.json()["stored"] is False
        assert "not stored" in answer.json()["words"]
        until(lambda: "not stored" in str(robot.tell("status")["trouble"]))
        assert "not stored" in run("stop", cwd=robot.folder, env=robot.env).stdout
        status, shown = robot.call("GET", "/robot")
        assert status == OK
        assert "not stored" in str(shown["stop"])
    until(lambda: by_api(robot))
    assert robot.open_page().get("/blueprint").status_code == OK, "and nothing else is broken afterwards"
    master.end(signal.SIGKILL)
    robot.master()
    assert robot.tell("status")["stopped"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own, of 24 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=24m", "msbot-test", place], capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.skip(f"this user may not mount a file system: {done.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", place], check=True)


def fill(place: Path) -> Path:
    """Takes all the room that there is, to the last octet."""
    file = place / "of others"
    with file.open("ab", buffering=0) as stream, suppress(OSError):
        for size in (65536, 512, 1):
            with suppress(OSError):
                while stream.write(b"x" * size):
                    pass
    return file


@pytest.mark.promise("STOP is obeyed and truly told without threads, descriptors, memory or room on the disk")
def test_on_a_full_disk_stop_and_go_are_stored(small_disk: Path) -> None:
    """Full as others fill it: file, database and its journal share what there is, and that is nothing."""
    with ExitStack() as stack:
        robot = Robot(small_disk, stack)
        master = robot.master(page=True)
        robot.parts("AA")
        for say in (by_api, by_socket):
            taken = fill(small_disk)
            assert say(robot), "stored, although nothing else can be"
            master.end(signal.SIGKILL)
            taken.unlink()
            master = robot.master(page=True)
            assert robot.tell("status")["stopped"], say.__name__
            taken = fill(small_disk)
            assert robot.tell("go")["stored"] is True
            master.end(signal.SIGKILL)
            taken.unlink()
            master = robot.master(page=True)
            assert not robot.tell("status")["stopped"], say.__name__


@pytest.mark.promise("Every request of who may say STOP is a STOP, and a GO ends none that its sayer did not know of")
def test_every_request_of_who_may_say_it_is_a_stop(robot: Robot) -> None:
    robot.master(page=True)
    form, json_type = {"content-type": "application/x-www-form-urlencoded"}, {"content-type": "application/json"}
    for odd in (
        {"json": {"reason": "x" * 5000}},
        {"json": {"reason": "fire", "unknown": 1, "who": "eve", "operation": "go"}},
        {"json": {"reason": 7}},
        {"json": [1, 2]},
        {"content": b"reason=fire", "headers": form},
        {"content": b"fire"},
        {"content": b"{half", "headers": json_type},
        {"content": b"\xff\xfe{", "headers": {"content-type": "application/json; charset=no-such"}},
        {"content": b"[" * 30_000, "headers": json_type},
        {"content": b"x" * 3_000_000},
        {"content": (b"x" * 100 for _ in range(20))},
        {"headers": {"content-type": b"\xe4"}},
        {"headers": {"x-stop-press": "x" * 500}},
        {},
    ):
        answer = stop(robot, **odd)
        assert answer.status_code == OK, (odd, answer.text)
        assert robot.call("POST", "/go", {"stop": answer.json()["stop"]})[0] == OK, odd
    assert httpx.post(f"{robot.page}/stop").status_code in (401, 403), "whoever it is must be known"
    assert robot.tell("status")["stopped"] is False
    # A press is one STOP while it holds, and is never told as said when it was not.
    press = {"x-stop-press": "the same"}
    first = stop(robot, headers=press).json()["stop"]
    assert stop(robot, headers=press).json()["stop"] == first
    assert robot.call("POST", "/go", {"stop": first})[0] == OK
    refused = stop(robot, headers=press)
    assert (refused.status_code, robot.tell("status")["stopped"]) == (CONFLICT, False)
    assert "somebody has ended it since" in refused.json()["error"]
    # GO ends what its sayer knew of.
    first, second = (stop(robot).json()["stop"] for _ in range(2))
    status, words = robot.call("POST", "/go", {"stop": first})
    assert (status, robot.tell("status")["stopped"]) == (400, True)
    assert f"STOP {second} was said since" in str(words["error"])
    status, words = robot.call("POST", "/go", {"stop": second + 1})
    assert (status, robot.tell("status")["stopped"]) == (400, True), "nobody has seen that one"
    assert f"there was no STOP {second + 1}" in str(words["error"])
    assert f"STOP {second} was said since" in run("go", "--stop", str(first), cwd=robot.folder, env=robot.env).stderr
    assert run("go", "--stop", str(second), cwd=robot.folder, env=robot.env).returncode == 0


@pytest.mark.promise("STOP is never limited, and does no harm")
def test_many_stops_of_one_person_are_one_line_and_push_nothing_out(robot: Robot) -> None:
    robot.master(page=True)
    assert robot.call("POST", "/parts/WXYZ/block", {"reason": "loud"})[0] == OK
    page = robot.open_page()
    size = (robot.folder / "robot.db").stat().st_size
    for _ in range(PRESSES):
        assert page.post("/stop", json={"reason": "a finger"}).status_code == OK

    def lines() -> list[str]:
        edits = page.get("/edits", params={"limit": 100}).json()
        return [str(one["words"]) for one in edits if one["kind"] == "stop"]

    until(lambda: any(f"({PRESSES} times in" in line for line in lines()))
    assert len(lines()) == 1
    assert "loud" in str(robot.call("POST", "/undo", {})[1]["words"]), "the teacher's list is as it was"
    assert (robot.folder / "robot.db").stat().st_size - size < 200_000
