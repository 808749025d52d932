"""The firmware in C as a process on a bus of the kernel, with a master as a user starts it."""

from __future__ import annotations

import json
import queue
import shutil
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.e2e.processes import PATIENCE_S, run, running
from tests.firmware.building import SOURCES, linux_board, need

UID = "0000000000c0ffee"


class Board:
    """The process of `examples/linux_socketcan`, with its two pins."""

    def __init__(self, program: Path, interface: str) -> None:
        self._process = subprocess.Popen(
            [program, interface, UID], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._levels: queue.Queue[str] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._levels.put(line.strip())

    def drives(self) -> str:
        """The next level of the pin that it drives."""
        return self._levels.get(timeout=PATIENCE_S)

    def apply(self, level: str) -> None:
        """Put a level on the pin that it reads."""
        assert self._process.stdin is not None
        self._process.stdin.write(level)
        self._process.stdin.flush()

    def pull(self) -> None:
        """Without a word; once is enough."""
        if self._process.returncode is not None:
            return
        self._process.send_signal(signal.SIGKILL)
        self._process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()


@contextmanager
def plugged_in(program: Path) -> Iterator[Board]:
    """A board that is pulled at the latest when the test is over."""
    board = Board(program, "vcan0")
    try:
        yield board
    finally:
        board.pull()


def state_of(folder: Path, slot: str) -> str:
    """What the robot's database says."""
    rows = json.loads(run("parts", "--json", cwd=folder).stdout)
    return str(next((row["state"] for row in rows if row["slot"] == slot), "unknown"))


@pytest.fixture
def program() -> Path:
    need("gcc")
    return linux_board()


def test_a_part_in_c_on_a_can_bus_of_the_kernel(program: Path, tmp_path: Path) -> None:
    shutil.copy(SOURCES / "examples" / "robot.toml", tmp_path)
    shutil.copytree(SOURCES / "examples" / "parts", tmp_path / "parts")
    env = {"XDG_STATE_HOME": str(tmp_path / "state")}
    link = ("--link", "can:vcan0")
    with ExitStack() as stack:
        master = stack.enter_context(running("master", "--no-page", *link, cwd=tmp_path, env=env))
        master.wait_for("is up on", "can:vcan0")
        board = stack.enter_context(plugged_in(program))
        assert board.drives() == "0"
        master.wait_for("board", "active")
        with running("part", "RELAY-1", *link, cwd=tmp_path, env=env) as relay:
            relay.wait_for("active")
            board.apply("1")
            relay.wait_for("closed true")
        assert run("set", "board", "invert", "true", cwd=tmp_path, env=env).returncode == 0
        assert board.drives() == "1", "low is high now"
        assert run("set", "board", "invert", "false", cwd=tmp_path, env=env).returncode == 0
        assert board.drives() == "0"
        with running("part", "TOGGLE", "--set", "lever=true", *link, cwd=tmp_path, env=env):
            assert board.drives() == "1"
        assert board.drives() == "0", "nobody is at the lever any more"
        board.pull()
        master.wait_for("board", "lost")
        assert state_of(tmp_path, "board") == "lost"
        again = stack.enter_context(plugged_in(program))
        assert again.drives() == "0"
        master.wait_for("board", "active")
