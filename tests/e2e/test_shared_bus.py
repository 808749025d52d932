"""One simulated CAN bus for several processes: a robot on it, tools that watch it, and a bus that dies."""

from __future__ import annotations

import re
import signal
from contextlib import ExitStack
from pathlib import Path

import pytest

import can
from tests.e2e.processes import run, running


@pytest.fixture
def env(tmp_path: Path) -> dict[str, str]:
    return {"XDG_RUNTIME_DIR": str(tmp_path), "XDG_STATE_HOME": str(tmp_path / "state")}


def test_a_robot_in_processes_of_its_own_survives_the_death_of_its_bus(tmp_path: Path, env: dict[str, str]) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    with ExitStack() as stack:
        part = stack.enter_context(running("part", "AA", "--link", "sim:bench1", cwd=tmp_path, env=env))
        part.wait_for("waiting for the simulated bus 'bench1'")
        bus = stack.enter_context(running("bus", "serve", "bench1", "--bitrate", "125000", cwd=tmp_path, env=env))
        bus.wait_for("simulated bus bench1 (CAN, 125 kbit/s) is up")
        master = stack.enter_context(running("master", "--no-page", "--link", "sim:bench1", cwd=tmp_path, env=env))
        master.wait_for("is up on sim:bench1")
        part.wait_for("active")

        dump = run("bus", "dump", "sim:bench1", "--count", "4", cwd=tmp_path, env=env)
        assert dump.returncode == 0
        frames = dump.stdout.splitlines()
        assert len(frames) == 4
        assert all(re.search(r"bench1 +[0-9A-F]{3} +\[\d\] .* {2}\w+", frame) for frame in frames)
        load = run("bus", "load", "sim:bench1", "--seconds", "1", cwd=tmp_path, env=env)
        assert "of 125 kbit/s" in load.stdout
        taken = run("bus", "serve", "bench1", cwd=tmp_path, env=env)
        assert (taken.returncode, "serves a simulated bus 'bench1' already" in taken.stderr) == (2, True)
        demo = run("demo", "--robot", "thesis", "--bus", "bench1", "--seconds", "1", cwd=tmp_path, env=env)
        assert (demo.returncode, "serves a simulated bus 'bench1' already" in demo.stderr) == (2, True)
        assert "Traceback" not in demo.stderr

        bus.end(signal.SIGKILL)
        part.wait_for("lost", "the simulated bus 'bench1' has ended")
        part.wait_for("active")  # the master serves the bus now


def test_tools_of_python_can_sit_on_the_bus_of_the_demo(
    tmp_path: Path, env: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with running("demo", "--robot", "thesis", "--bus", "demo1", "--no-page", cwd=tmp_path, env=env) as demo:
        demo.wait_for("AA", "active")
        with can.Bus(interface="msbot", channel="demo1") as tool:
            ids: set[int] = set()
            while not ids >= {0x101, 0x181, 0x700}:
                message = tool.recv(20.0)
                assert message is not None
                ids.add(message.arbitration_id)
        assert run("bus", "send", "sim:demo1", "7DF#0201050000000000", cwd=tmp_path, env=env).returncode == 0
        assert demo.end(signal.SIGINT) == 0
    assert not list((tmp_path / "msbot").glob("bus-*"))


def test_a_bus_that_is_ended_leaves_no_name_behind(tmp_path: Path, env: dict[str, str]) -> None:
    with running("bus", "serve", "fast", "--fd", "--data-bitrate", "5000000", cwd=tmp_path, env=env) as bus:
        bus.wait_for("CAN FD, 500 and 5000 kbit/s")
        assert (tmp_path / "msbot" / "bus-fast.json").exists()
        assert bus.end(signal.SIGTERM) == 0
    assert not list((tmp_path / "msbot").iterdir())
    assert bus.lines[-1] == "0 frames, 0 attempts failed"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("bus", "serve", "a/b"), "is not a name for a simulated bus"),
        (("demo", "--robot", "thesis", "--bus", "a/b", "--seconds", "1"), "is not a name for a simulated bus"),
        (("demo", "--robot", "thesis", "--bus", "x", "--link", "udp"), "--bus is for a CAN bus"),
    ],
)
def test_mistakes_are_said(arguments: tuple[str, ...], words: str, tmp_path: Path, env: dict[str, str]) -> None:
    result = run(*arguments, cwd=tmp_path, env=env)
    assert (result.returncode, words in result.stderr) == (2, True)
    assert "Traceback" not in result.stderr
