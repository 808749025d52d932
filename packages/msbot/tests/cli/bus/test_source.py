"""Which names are buses and which are logs, and what becomes of errors of those who listen."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.cli.bus.bus_source import Listening, is_bus, is_log, open_bus
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from msbot_xrce.errors import ConfigError
from tests.cli.live_bus import bus, runtime_folder, talking

__all__ = ["bus", "runtime_folder", "talking"]


@pytest.mark.parametrize(
    "name", ["can0", "vcan0", "can:can0", "can:slcan:/dev/ttyACM0?bitrate=500000", "sim:classroom"]
)
def test_names_of_buses(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert is_bus(name)
    assert not is_log(name)


@pytest.mark.parametrize("name", ["-", "bus.log", "x/bus.ASC", "bus.blf", "bus.trc", "bus.csv", "bus.db"])
def test_names_of_logs(name: str) -> None:
    assert is_log(name)


def test_a_file_is_a_file_whatever_it_is_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("can0").write_text("")
    assert is_log("can0")
    assert not is_bus("can0")
    assert not is_bus("robot.toml")


@pytest.mark.parametrize("address", ["can0", "can:can0", "sim:classroom"])
def test_addresses_give_controllers(address: str) -> None:
    expected = address if ":" in address else f"can:{address}"
    assert open_bus(address, node="test").info.name == expected


def test_what_is_neither_is_said() -> None:
    with pytest.raises(ConfigError, match="neither a CAN bus nor a log"):
        open_bus("udp:127.0.0.1:1", node="test")


def test_an_error_of_the_listener_ends_the_listening_and_not_the_controller(talking: MsbotBus) -> None:
    heard: list[Frame] = []

    def fail(frame: Frame, _at: float) -> None:
        heard.append(frame)
        raise BrokenPipeError

    async def main() -> None:
        listening = Listening(open_bus("sim:bench1", node="test", listen_only=True), complaints.append)
        listening.on_frame(fail)
        await listening.run()

    complaints: list[str] = []
    with pytest.raises(BrokenPipeError):
        asyncio.run(main())
    assert len(heard) == 1
    assert complaints == []


def test_an_error_of_the_work_beside_it_is_raised(bus: MsbotBus) -> None:
    async def work() -> None:
        raise ValueError("seven")

    async def main() -> None:
        await Listening(open_bus("sim:bench1", node="test", listen_only=True), print).run_with(work())

    with pytest.raises(ValueError, match="seven"):
        asyncio.run(main())
