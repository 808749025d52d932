"""The `msbot` command on a bus of the kernel, as a user types it."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.e2e.processes import Process, run, running


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_four_processes_make_a_robot_on_a_can_bus(stack: ExitStack, tmp_path: Path) -> None:
    state = {"XDG_STATE_HOME": str(tmp_path / "state")}
    assert run("init", cwd=tmp_path).returncode == 0

    def start(*arguments: str) -> Process:
        return stack.enter_context(running(*arguments, "--link", "can:vcan0", cwd=tmp_path, env=state))

    master = start("master", "--no-page")
    master.wait_for("is up on", "can:vcan0")
    parts = {name: start("part", name) for name in ("AA", "BB", "CC")}
    for part in parts.values():
        part.wait_for("active")
    parts["BB"].wait_for("output", "on")
    parts["BB"].end(signal.SIGKILL)
    again = start("part", "BB")
    again.wait_for("active")
    again.wait_for("output", "on")
    listing = run("parts", "--json", cwd=tmp_path)
    assert {row["slot"]: row["state"] for row in json.loads(listing.stdout)} == dict.fromkeys(parts, "active")


def test_a_master_without_its_interface_says_what_to_do(tmp_path: Path) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    done = run("master", "--no-page", "--link", "can:vcan7", cwd=tmp_path)
    assert done.returncode == 2
    assert "sudo ip link add dev vcan7 type vcan && sudo ip link set vcan7 mtu 72 up" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_agent_serves_eprosimas_framing(stack: ExitStack, tmp_path: Path) -> None:
    agent = stack.enter_context(running("agent", "canfd", "-D", "vcan0", cwd=tmp_path))
    agent.wait_for("agent on", "vcan0")
