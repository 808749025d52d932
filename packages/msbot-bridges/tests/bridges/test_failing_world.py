"""A mistake in a world ends neither the robot nor the world for good: it is said, and the world is tried again."""

from __future__ import annotations

import asyncio

import pytest

from msbot.config import BridgeTable
from msbot_agent.link import InprocHub
from msbot_bridges.bridge import World, WorldHost, WorldKind
from msbot_bridges.cli import bridge_runner
from msbot_bridges.cli.device_process import DeviceProcess
from msbot_xrce.errors import ConfigError, LocalProtocolError


class _Failing(World):
    """One that ends with each of these errors in turn, then runs."""

    def __init__(self, errors: list[Exception], runs: asyncio.Event) -> None:
        self._errors, self._runs = errors, runs

    async def run(self, host: WorldHost) -> None:
        if self._errors:
            raise self._errors.pop(0)
        self._runs.set()
        await asyncio.Event().wait()


async def _run(monkeypatch: pytest.MonkeyPatch, *errors: Exception) -> list[str]:
    left, runs, told = list(errors), asyncio.Event(), list[str]()
    kind = WorldKind("fails", "here", lambda _: _Failing(left, runs))
    monkeypatch.setattr(bridge_runner, "worlds", lambda: {"fails": kind})
    monkeypatch.setattr(bridge_runner, "AGAIN_S", 0.01)
    hub = InprocHub()
    (work,) = bridge_runner.RUNNER.coroutines([BridgeTable("fails", "here")], lambda _: hub.connect(), told.append)
    task, until = asyncio.create_task(work), asyncio.create_task(runs.wait())
    try:
        async with asyncio.timeout(60):
            await asyncio.wait([task, until], return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
    finally:
        task.cancel()
        until.cancel()
        await asyncio.wait([task, until])
    return told


async def test_mistakes_of_a_world_are_said_and_it_is_tried_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    told = await _run(monkeypatch, ZeroDivisionError("in a world"), LocalProtocolError("no room"))
    assert told == [
        "bridge for fails: ZeroDivisionError: in a world; tried again in 0.01 s",
        "bridge for fails: LocalProtocolError: no room; tried again in 0.01 s",
    ]
    assert "Traceback" in caplog.text


async def test_a_network_that_cannot_be_used_ends_the_robot_with_its_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="no such bus"):
        await _run(monkeypatch, ConfigError("no such bus"))


class _Noting(World):
    """One that notes when it has ended; its devices are told something until then."""

    def __init__(self, runs: asyncio.Event, ended: list[str]) -> None:
        self._runs, self._ended = runs, ended

    async def run(self, host: WorldHost) -> None:
        self._runs.set()
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0.1)
            self._ended.append("bridge")


class _Device(DeviceProcess):
    def __init__(self, table: BridgeTable, ended: list[str]) -> None:
        super().__init__(table, "device", {}, "")
        self._noted = ended

    async def run(self, address: str) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            self._noted.append("device")


async def test_simulated_devices_are_there_until_their_bridge_has_left_them(monkeypatch: pytest.MonkeyPatch) -> None:
    runs, ended, table = asyncio.Event(), list[str](), BridgeTable("notes", "here")
    kind = WorldKind("notes", "here", lambda _: _Noting(runs, ended))
    monkeypatch.setattr(bridge_runner, "worlds", lambda: {"notes": kind})
    devices = [_Device(table, ended)]
    (work,) = bridge_runner.RUNNER.coroutines([table], lambda _: InprocHub().connect(), print, devices)
    task = asyncio.create_task(work)
    await runs.wait()
    await asyncio.sleep(0)
    task.cancel()
    await asyncio.wait([task])
    assert ended == ["bridge", "device"]
