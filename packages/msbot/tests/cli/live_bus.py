"""A simulated bus with a talking node on it, for tests of commands that work on live buses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import can
from msbot.cli.bus.bus_commands import command
from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from msbot_xrce.errors import MsbotError


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Names of buses are those of this test alone."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "msbot"


@pytest.fixture
def bus() -> Iterator[MsbotBus]:
    """A bus that this process serves, at 500 kbit/s."""
    with MsbotBus("bench1") as bus:
        yield bus


@pytest.fixture
def talking(bus: MsbotBus) -> Iterator[MsbotBus]:
    """The same with a second node, so that frames are acknowledged, and a frame every 5 ms."""
    with MsbotBus("bench1"):
        frame = can.Message(arbitration_id=0x103, data=b"\xc1\x81\x01\x07\x00", is_extended_id=False)
        task = bus.send_periodic(frame, 0.005)
        yield bus
        task.stop()


def invoke(*arguments: str, text: str | None = None) -> Result:
    """Run `msbot bus ...`; a user's mistake is raised."""
    result = CliRunner().invoke(command, list(arguments), input=text)
    if isinstance(result.exception, MsbotError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result
