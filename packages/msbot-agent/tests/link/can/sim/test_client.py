"""Controllers on a simulated bus of another program, and of this one when there is none."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import frame_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim import sim_bus_client as sim_client
from msbot_agent.link.can.sim.bus_names import NamedBus, existing_bus, find_bus, publish, withdraw
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES, SimBus
from msbot_agent.link.can.sim.model.sim_bus_messages import BusFrame, FrameSent, Restart, Welcome, encode
from msbot_agent.link.can.sim.sim_bus_client import LOST_WORDS, SimAdapter, SimBusRequest, WhenAbsent
from msbot_xrce.errors import ConfigError, LinkDown, LinkFull
from tests.link.sim_programs import Ear, served

WISH = SimBusRequest("classroom")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "msbot"


async def on_the_bus(ear: Ear, task: asyncio.Task[None]) -> None:
    """Wait until the controller is on the bus; raises what its driver has ended with, if it has."""
    task.add_done_callback(ear.poke)
    await ear.until(lambda: [state for state, _ in ear.states[-1:]] == [BusState.ACTIVE] or task.done())
    if task.done():
        task.result()


@contextlib.asynccontextmanager
async def running(adapter: SimAdapter) -> AsyncIterator[Ear]:
    """A controller that is looked after, with all it tells."""
    driver = CanDriver(adapter)
    ear = Ear(driver)
    task = asyncio.create_task(driver.run())
    await on_the_bus(ear, task)
    try:
        yield ear
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_frames_go_both_ways(folder: Path) -> None:
    async with served(folder) as (_, driver), running(SimAdapter(WISH, node="A", folder=folder)) as client:
        ear = Ear(driver.attach("ear"))
        client.bus.send(Frame(0x123, b"to"))
        await ear.until(lambda: ear.frames != [])
        ear.bus.send(Frame(0x124, b"fro"))
        await client.until(lambda: client.frames != [] and client.bus.pending() == 0)
        assert (ear.frames[0][0], client.frames[0][0]) == (Frame(0x123, b"to"), Frame(0x124, b"fro"))
        assert client.frames[0][1] == pytest.approx(asyncio.get_running_loop().time(), abs=30)
        assert client.rooms >= 1


async def test_who_is_too_slow_for_the_bus_is_less_than_a_second_behind_and_told_so(folder: Path) -> None:
    a_second = 500_000 // frame_bits(Frame(0x123, bytes(8))).nominal_bits
    async with served(folder) as (server, _), running(SimAdapter(WISH, node="A", folder=folder)) as client:
        (program,) = server._programs
        bus: Any = client.bus
        reading = bus._channel._transport
        reading.pause_reading()
        frames = 0
        while not server.counters.dropped and frames < 100 * a_second:
            frames += 1
            program._heard(Frame(0x123, bytes(8)), float(frames))
            if not frames % 100:
                await asyncio.sleep(0)  # what the system takes, it takes
        assert frames < a_second
        reading.resume_reading()
        (lost,) = server.counters.dropped.values()
        await client.until(lambda: len(client.frames) == frames - lost and bus.dropped == {LOST_WORDS: 1})
        assert [at for _, at in client.frames] == sorted(at for _, at in client.frames)


async def test_what_is_known_of_the_bus(folder: Path) -> None:
    assert SimAdapter(WISH, folder=folder).info.bits_per_second == 500_000
    fast = SimAdapter(SimBusRequest("classroom", 250_000, 4_000_000, fd=True), folder=folder).info
    assert (fast.name, fast.bits_per_second, fast.data_bits_per_second, fast.fd) == (
        "sim:classroom",
        250_000,
        4_000_000,
        True,
    )
    async with served(folder, bus=SimBus(125_000, 1_000_000, fd=True)):
        info = SimAdapter(WISH, folder=folder).info
        assert (info.bits_per_second, info.data_bits_per_second, info.fd) == (125_000, 1_000_000, True)


async def test_a_controller_holds_a_few_frames_and_then_is_full(folder: Path) -> None:
    async with served(folder), running(SimAdapter(WISH, folder=folder)) as client:
        for number in range(MAILBOXES + 1):  # one more is held by the driver
            client.bus.send(Frame(number))
        assert client.bus.pending() == MAILBOXES + 1
        assert not client.bus.has_room()
        with pytest.raises(LinkFull):
            client.bus.send(Frame(9))


async def test_states_are_told_and_bus_off_is_left_by_a_restart(folder: Path) -> None:
    async with served(folder) as (_, driver), running(SimAdapter(WISH, folder=folder)) as client:
        Ear(driver.attach("ear"))
        driver.short_circuit()
        client.bus.send(Frame(1))
        await client.until(lambda: client.states[-1][0] is BusState.OFF)
        assert [state for state, _ in client.states] == [
            BusState.GONE,
            BusState.ACTIVE,
            BusState.PASSIVE,
            BusState.OFF,
        ]
        assert client.bus.pending() == 0
        driver.repair()
        client.bus.restart()
        await client.until(lambda: client.states[-1][0] is BusState.ACTIVE)


async def test_without_a_bus_a_tool_is_told_how_to_start_one(folder: Path) -> None:
    with pytest.raises(LinkDown, match="start one with `msbot bus serve classroom`"):
        async with running(SimAdapter(WISH, folder=folder)):
            pass


async def test_a_part_waits_for_its_bus_and_comes_back_when_the_bus_does(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sim_client, "LOOK_S", 0.01)
    driver = CanDriver(SimAdapter(WISH, absent=WhenAbsent.WAIT, folder=folder))
    ear = Ear(driver)
    task = asyncio.create_task(driver.run())
    for _ in range(2):
        async with served(folder):
            await on_the_bus(ear, task)
        await ear.until(lambda: ear.states[-1] == (BusState.GONE, "the simulated bus 'classroom' has ended"))
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_a_master_serves_the_bus_itself_when_nobody_does(folder: Path) -> None:
    wish = SimBusRequest("classroom", 125_000)
    async with running(SimAdapter(wish, node="master", absent=WhenAbsent.SERVE, folder=folder)) as master:
        assert existing_bus("classroom", folder).bitrate == 125_000
        async with running(SimAdapter(WISH, absent=WhenAbsent.SERVE, folder=folder)) as part:
            part.bus.send(Frame(0x101, b"up"))
            await master.until(lambda: master.frames != [])
            for number in range(MAILBOXES + 1):
                master.bus.send(Frame(0x181 + number, b"down"))
            await part.until(lambda: len(part.frames) == MAILBOXES + 1)
            assert (master.bus.pending(), master.bus.has_room()) == (0, True)
    assert find_bus("classroom", folder) is None


async def test_a_bus_that_cannot_be_served_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    adapter = SimAdapter(WISH, node="master", absent=WhenAbsent.SERVE, folder=tmp_path / "file")
    with pytest.raises((ConfigError, LinkDown)):
        async with running(adapter):
            pass


async def test_a_master_off_its_own_bus_comes_back(folder: Path) -> None:
    adapter = SimAdapter(WISH, absent=WhenAbsent.SERVE, folder=folder)
    async with running(adapter) as master:
        host = master.bus._channel  # type: ignore[attr-defined]  # the bus itself, to be harmed
        assert isinstance(host, sim_client.LocalBusChannel)
        host.driver.attach("other")
        host.driver.short_circuit()
        master.bus.send(Frame(1))
        await master.until(lambda: master.states[-1][0] is BusState.OFF)
        assert not master.bus.has_room()
        assert not host.send(Frame(1))
        host.driver.repair()
        master.bus.restart()
        await master.until(lambda: master.states[-1][0] is BusState.ACTIVE)


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        (SimBusRequest("classroom", 250_000), "is CAN, 500 kbit/s, not CAN, 250 kbit/s"),
        (SimBusRequest("classroom", fd=True), "is CAN, 500 kbit/s, not CAN FD, 500 kbit/s"),
    ],
)
async def test_a_bus_of_other_rates_is_refused(folder: Path, wish: SimBusRequest, words: str) -> None:
    async with served(folder):
        with pytest.raises(LinkDown, match=words):
            async with running(SimAdapter(wish, absent=WhenAbsent.SERVE, folder=folder)):
                pass


async def test_other_data_rates_are_refused(folder: Path) -> None:
    async with served(folder, bus=SimBus(500_000, 2_000_000, fd=True)):
        with pytest.raises(LinkDown, match="500 and 2000 kbit/s, not CAN FD, 500 and 4000 kbit/s"):
            async with running(SimAdapter(SimBusRequest("classroom", data_bitrate=4_000_000, fd=True), folder=folder)):
                pass
        async with running(SimAdapter(SimBusRequest("classroom", 500_000, 2_000_000), folder=folder)):
            pass


def test_what_is_no_name_is_refused() -> None:
    with pytest.raises(ConfigError, match="not a name"):
        SimAdapter(SimBusRequest("a/b"))


async def test_a_file_of_a_program_that_has_gone_is_removed(folder: Path) -> None:
    server = await asyncio.start_server(lambda _r, _w: None, "127.0.0.1", 0)
    port = int(server.sockets[0].getsockname()[1])
    server.close()
    publish(NamedBus("classroom", port, "ab" * 16, os.getpid(), 500_000, None, False), folder)
    with pytest.raises(LinkDown, match="there is no simulated bus"):
        async with running(SimAdapter(WISH, folder=folder)):
            pass
    assert find_bus("classroom", folder) is None


@contextlib.asynccontextmanager
async def impostor(folder: Path, answer: bytes, then: bytes = b"") -> AsyncIterator[None]:
    """Somebody who serves something else under the name of a bus."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        writer.write(answer)
        await reader.read(100)
        writer.write(then)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    bus = NamedBus("classroom", int(server.sockets[0].getsockname()[1]), "ab" * 16, os.getpid(), 500_000, None, False)
    publish(bus, folder)
    try:
        yield
    finally:
        server.close()


WELCOME = encode(Welcome(500_000, None, fd=False))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n", "talks nonsense: message of an impossible length"),
        (encode(Restart()), "talks nonsense: message that a server does not send"),
    ],
)
async def test_a_server_that_talks_nonsense_is_left(folder: Path, answer: bytes, words: str) -> None:
    async with impostor(folder, answer):
        with pytest.raises(LinkDown, match=words):
            async with running(SimAdapter(WISH, folder=folder)):
                pass


async def test_a_server_that_says_nothing_is_given_up(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sim_client, "CONNECT_S", 0.05)
    async with impostor(folder, b""):
        with pytest.raises(LinkDown, match="does not answer"):
            async with running(SimAdapter(WISH, folder=folder)):
                pass


async def test_a_part_waits_for_a_server_that_says_nothing_yet(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(sim_client, "CONNECT_S", 0.02)
    driver = CanDriver(SimAdapter(WISH, absent=WhenAbsent.WAIT, folder=folder))
    ear = Ear(driver)
    async with impostor(folder, b""):
        task = asyncio.create_task(driver.run())
        await asyncio.wait([task], timeout=0.2)  # ten tries
        assert not task.done()
        bus = existing_bus("classroom", folder)
    assert [one.message for one in caplog.records] == [
        f"cannot join the simulated bus 'classroom' of process {os.getpid()}: it does not answer; trying again"
    ]
    withdraw(bus, folder)
    monkeypatch.setattr(sim_client, "CONNECT_S", 30.0)
    async with served(folder):
        await on_the_bus(ear, task)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_a_part_waits_for_another_server_when_this_one_ends_while_it_joins(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    hung_up = asyncio.Event()

    async def hang_up(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.close()
        hung_up.set()

    server = await asyncio.start_server(hang_up, "127.0.0.1", 0)
    bus = NamedBus("classroom", int(server.sockets[0].getsockname()[1]), "ab" * 16, os.getpid(), 500_000, None, False)
    publish(bus, folder)
    driver = CanDriver(SimAdapter(WISH, absent=WhenAbsent.WAIT, folder=folder))
    ear = Ear(driver)
    task = asyncio.create_task(driver.run())
    await hung_up.wait()
    server.close()
    withdraw(bus, folder)
    async with served(folder):
        await on_the_bus(ear, task)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert [one.message for one in caplog.records] == ["the simulated bus 'classroom' has ended; trying again"]


async def test_a_part_waits_for_another_server_when_this_one_ends_before_it_accepts(folder: Path) -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    bus = NamedBus("classroom", int(listener.getsockname()[1]), "ab" * 16, os.getpid(), 500_000, None, False)
    publish(bus, folder)
    driver = CanDriver(SimAdapter(WISH, absent=WhenAbsent.WAIT, folder=folder))
    ear = Ear(driver)
    task = asyncio.create_task(driver.run())
    await asyncio.sleep(0)  # it is connecting: what the system has begun is now reset, not refused
    listener.close()
    withdraw(bus, folder)
    async with served(folder):
        await on_the_bus(ear, task)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_a_program_that_does_not_wait_says_that_the_bus_has_ended(folder: Path) -> None:
    async def hang_up(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.close()

    server = await asyncio.start_server(hang_up, "127.0.0.1", 0)
    port = int(server.sockets[0].getsockname()[1])
    publish(NamedBus("classroom", port, "ab" * 16, os.getpid(), 500_000, None, False), folder)
    with pytest.raises(LinkDown, match="'classroom' has ended"):
        await CanDriver(SimAdapter(WISH, folder=folder)).run()
    server.close()


@pytest.mark.parametrize("with_frame", [False, True])
async def test_nonsense_after_the_welcome_ends_the_bus(folder: Path, with_frame: bool) -> None:
    heard = encode(FrameSent(99, 0.0)) + encode(BusFrame(Frame(1)))
    async with impostor(folder, WELCOME + (heard if with_frame else b"\0\0"), b"\0\0"):
        driver = CanDriver(SimAdapter(WISH, folder=folder))
        ear = Ear(driver)
        task = asyncio.create_task(driver.run())
        task.add_done_callback(ear.poke)
        if with_frame:
            await ear.until(lambda: ear.frames != [])
            driver.send(Frame(2))
            await ear.until(lambda: any("talks nonsense" in words for _, words in ear.states))
            task.cancel()
        else:
            await ear.until(task.done)
            with pytest.raises(LinkDown, match="talks nonsense"):
                task.result()
        await asyncio.gather(task, return_exceptions=True)


async def test_a_wrong_key_is_a_refusal(folder: Path) -> None:
    async with served(folder):
        bus = existing_bus("classroom", folder)
        (folder / "bus-classroom.json").unlink()
        publish(NamedBus("classroom", bus.port, "00" * 16, bus.pid, bus.bitrate, None, False), folder)
        with pytest.raises(LinkDown, match="refuses this program: the key"):
            async with running(SimAdapter(WISH, folder=folder)):
                pass


async def test_who_listens_only_hears_and_does_not_send(folder: Path) -> None:
    async with served(folder) as (_, driver):
        one, other = Ear(driver.attach("one")), Ear(driver.attach("other"))
        async with running(SimAdapter(WISH, listen_only=True, folder=folder)) as listener:
            one.bus.send(Frame(5))
            await listener.until(lambda: listener.frames != [])
            assert listener.frames[0][0] == Frame(5)
            listener.bus.send(Frame(6))
            one.bus.send(Frame(7))
            await other.until(lambda: len(other.frames) == 2)
            assert [frame.can_id for frame, _ in other.frames] == [5, 7]
