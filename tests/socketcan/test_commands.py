"""The `msbot` command on a bus of the kernel, as a user types it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.e2e.processes import run, running


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_a_master_without_its_interface_says_what_to_do(tmp_path: Path) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    done = run("master", "--no-page", "--link", "can:vcan7", cwd=tmp_path)
    assert done.returncode == 2
    assert "sudo ip link add dev vcan7 type vcan && sudo ip link set vcan7 mtu 72 up" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_agent_serves_eprosimas_framing(stack: ExitStack, tmp_path: Path) -> None:
    agent = stack.enter_context(running("agent", "canfd", "-D", "vcan0", cwd=tmp_path))
    agent.wait_for("agent on", "vcan0")
