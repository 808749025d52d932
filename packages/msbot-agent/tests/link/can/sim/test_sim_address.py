"""Addresses of simulated buses, and a master and a part that meet on one."""

from __future__ import annotations

import asyncio
from pathlib import Path
from random import Random

import pytest

from msbot_agent.link import Signal, open_link
from msbot_agent.link.can import CanMasterLink, CanPartLink, CanSettings, Codec
from msbot_agent.link.can.sim.bus_names import existing_bus, find_bus
from msbot_agent.link.can.sim.sim_address import open_sim_bus, parse_sim
from msbot_agent.link.can.sim.sim_bus_client import SimBusRequest
from msbot_xrce.errors import ConfigError
from tests.link.can.sim.virtual import virtually
from tests.link.sim_programs import PATIENCE_S

CODEC = Codec(bytes, bytes)


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.mark.parametrize(
    ("text", "wish"),
    [
        ("classroom", SimBusRequest("classroom")),
        ("bench-2?bitrate=125000", SimBusRequest("bench-2", 125_000)),
        ("bench_2?fd=1", SimBusRequest("bench_2", fd=True)),
        ("b?fd=1&dbitrate=8000000&bitrate=1000000", SimBusRequest("b", 1_000_000, 8_000_000, fd=True)),
        ("b?fd=0", SimBusRequest("b", fd=False)),
    ],
)
def test_an_address_names_a_bus(text: str, wish: SimBusRequest) -> None:
    assert parse_sim(text) == wish


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("sim:", "'' is not a name for a simulated bus"),
        ("sim:127.0.0.1:8888", "not a name for a simulated bus"),
        ("sim:b?speed=1", "no option 'speed'; there are bitrate, dbitrate, fd, compression"),
        ("sim:b?bitrate=fast", "a bit rate from 5000"),
        ("sim:b?fd=2", "1 means yes"),
        ("sim:b?dbitrate=2000000", "add fd=1"),
        ("sim:b?compression=no", "1 means yes"),
        ("sim:b?compression=1=0", "1 means yes"),
        ("sim:b?bitrate=1000001", "a bit rate from 5000 to 1000000"),
        ("sim:b?fd=1&dbitrate=8000001", "a bit rate from 5000 to 8000000"),
    ],
)
@pytest.mark.parametrize("serve", [False, True])
def test_wrong_addresses_show_a_right_one(address: str, words: str, serve: bool) -> None:
    with pytest.raises(ConfigError, match=words) as raised:
        open_link(address, serve=serve)
    assert "write it like `sim:classroom`" in str(raised.value)


def test_compression_is_used_unless_the_address_says_no() -> None:
    settings = CanSettings(codec=CODEC)
    assert open_link("sim:classroom", can=settings).info.compresses
    assert open_link("sim:classroom?compression=1", can=settings).info.compresses
    assert not open_link("sim:classroom?compression=0&bitrate=125000", can=settings).info.compresses
    assert not open_link("sim:classroom").info.compresses


def test_a_tool_gets_the_controller() -> None:
    info = open_sim_bus("classroom?fd=1", node="tool", listen_only=True).info
    assert (info.name, info.fd) == ("sim:classroom", True)


@pytest.mark.parametrize("serve", [False, True])
@virtually
async def test_only_a_master_serves_the_bus_a_part_waits(serve: bool) -> None:
    settings = CanSettings(codec=CODEC, uid=b"12345678", random=Random(1))
    link = open_link("sim:classroom", serve=serve, can=settings)
    running = asyncio.ensure_future(link.run())
    await asyncio.sleep(1.0)
    assert (find_bus("classroom") is not None) == serve
    running.cancel()
    await asyncio.wait([running])


@pytest.mark.parametrize("options", ["", "?bitrate=250000&fd=1&dbitrate=1000000"])
async def test_a_master_and_a_part_meet_whoever_comes_first(options: str) -> None:
    address = f"sim:classroom{options}"
    settings = CanSettings(codec=CODEC, uid=b"12345678", random=Random(1))
    part, master = open_link(address, can=settings), open_link(address, serve=True, can=settings)
    assert isinstance(part, CanPartLink)
    assert isinstance(master, CanMasterLink)
    loop = asyncio.get_running_loop()
    answered = loop.create_future()

    def joined(signal: Signal, _peer: object, _words: str, _now: float) -> None:
        if signal is Signal.LINK_UP:
            part.send(b"hello, master", 0)

    part.attach(signal=joined)
    master.attach(packet=lambda packet, peer, _now: master.send(packet[:5] + bytes(100), peer))
    part.attach(packet=lambda packet, _peer, _now: answered.set_result(packet))
    tasks = [loop.create_task(part.run())]
    await asyncio.sleep(0)
    tasks.append(loop.create_task(master.run()))
    async with asyncio.timeout(PATIENCE_S):
        assert await answered == b"hello" + bytes(100)
    bus = existing_bus("classroom")
    assert bus.rates() == ("CAN FD, 250 and 1000 kbit/s" if options else "CAN, 500 kbit/s")
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
