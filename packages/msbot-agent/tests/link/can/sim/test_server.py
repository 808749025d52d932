"""A simulated bus served to other programs: what they see of it, and what becomes of those that talk nonsense."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import time
from pathlib import Path

import pytest

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import frame_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim import sim_bus_server as sim_server
from msbot_agent.link.can.sim.bus_names import existing_bus, find_bus
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES, SimBus
from msbot_agent.link.can.sim.model.sim_bus_messages import (
    BusFrame,
    FrameRejected,
    FrameSent,
    FramesLost,
    Hello,
    Message,
    Refused,
    Restart,
    StateTold,
    Welcome,
    encode,
)
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver
from msbot_xrce.errors import LinkDown
from tests.link.sim_programs import PATIENCE_S, Ear, RawProgram, served


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "msbot"


async def test_programs_hear_each_other_with_the_times_of_the_bus(folder: Path) -> None:
    async with served(folder) as (server, _):
        port = existing_bus("classroom", folder).port
        one, other = [await RawProgram.join(server, port, name) for name in ("one", "other")]
        frame = Frame(0x123, b"hello")
        before = time.monotonic()
        one.say(BusFrame(frame, 7))
        heard = await other.hear(BusFrame)
        sent = await one.hear(FrameSent)
        assert (heard.frame, heard.at, sent) == (frame, sent.at, FrameSent(7, sent.at))
        assert before + (frame_bits(frame).nominal_bits - 3) / 500_000 <= sent.at <= time.monotonic() + 1e-3
        assert server.programs == 2
    assert find_bus("classroom", folder) is None
    assert not server.ready.is_set()
    assert await one.ended() == []
    assert await other.ended() == []


@pytest.mark.parametrize("turns", range(4))
async def test_who_comes_in_while_the_bus_ends_is_not_kept_waiting(folder: Path, turns: int) -> None:
    """However far the event loop has come with the new connection."""
    loop = asyncio.get_running_loop()
    async with served(folder) as (server, _):
        late = socket.create_connection(("127.0.0.1", existing_bus("classroom", folder).port))
        late.setblocking(False)
        for _ in range(turns):
            await asyncio.sleep(0)
    with late, contextlib.suppress(ConnectionError):
        async with asyncio.timeout(PATIENCE_S):
            assert await loop.sock_recv(late, 1) == b""
    assert server.programs == 0


async def test_the_bus_says_what_it_is(folder: Path) -> None:
    async with served(folder, bus=SimBus(250_000, 1_000_000, fd=True)) as (server, _):
        word = existing_bus("classroom", folder)
        assert (word.bitrate, word.data_bitrate, word.fd) == (250_000, 1_000_000, True)
        program = await RawProgram.connect(word.port)
        program.say(Hello(server.key, "A"))
        assert await program.hear(Welcome) == Welcome(250_000, 1_000_000, fd=True)
        program.writer.close()


async def test_frames_of_programs_take_part_in_arbitration(folder: Path) -> None:
    async with served(folder) as (server, driver):
        program = await RawProgram.join(server, existing_bus("classroom", folder).port)
        ear = Ear(driver.attach("ear"))
        for can_id in (0x300, 0x200, 0x100):
            program.say(BusFrame(Frame(can_id, bytes(8)), can_id))
        await ear.until(lambda: len(ear.frames) == 3)
        # Together they reach the controller before the first of them has left it: then the lowest goes first.
        assert sorted(frame.can_id for frame, _ in ear.frames) == [0x100, 0x200, 0x300]
        tags = [(await program.hear(FrameSent)).tag for _ in range(3)]
        assert tags == [frame.can_id for frame, _ in ear.frames]
        program.writer.close()


async def test_who_listens_only_hears_everything_and_acknowledges_nothing(folder: Path) -> None:
    async with served(folder) as (server, driver):
        port = existing_bus("classroom", folder).port
        listener = await RawProgram.join(server, port, listen_only=True)
        lonely = Ear(driver.attach("lonely"))
        lonely.bus.send(Frame(0x123, b"x"))
        await lonely.until(lambda: lonely.states != [])
        assert lonely.states[0][0] is BusState.PASSIVE, "nobody acknowledges"
        ear = Ear(driver.attach("ear"))
        await ear.until(lambda: ear.frames != [])
        assert (await listener.hear(BusFrame)).frame == Frame(0x123, b"x")
        listener.say(BusFrame(Frame(1)))
        assert await listener.ended() == []
        assert server.counters.dropped == {sim_server.UNEXPECTED: 1}
        assert driver.listeners == []


async def test_a_lone_program_is_told_that_it_is_error_passive(folder: Path) -> None:
    async with served(folder) as (server, _):
        program = await RawProgram.join(server, existing_bus("classroom", folder).port)
        program.say(BusFrame(Frame(0x123)))
        told = await program.hear(StateTold)
        assert (told.state, told.transmit_errors) == (BusState.PASSIVE, 128)
        program.writer.close()


async def test_bus_off_and_the_way_back(folder: Path) -> None:
    async with served(folder) as (server, driver):
        program = await RawProgram.join(server, existing_bus("classroom", folder).port)
        ear = Ear(driver.attach("ear"))
        driver.short_circuit()
        program.say(BusFrame(Frame(0x123), 1))
        while (await program.hear(StateTold)).state is not BusState.OFF:
            pass
        program.say(BusFrame(Frame(0x123), 2))
        rejected = await program.hear(FrameRejected)
        assert (rejected.tag, "bus-off" in rejected.words) == (2, True)
        driver.repair()
        program.say(Restart())
        assert (await program.hear(StateTold)).state is BusState.ACTIVE
        program.say(BusFrame(Frame(0x124), 3))
        await ear.until(lambda: ear.frames != [])
        assert ear.frames[0][0] == Frame(0x124)
        program.writer.close()


async def test_a_program_that_goes_takes_its_controller_with_it(folder: Path) -> None:
    async with served(folder) as (server, driver):
        ear = Ear(driver.attach("ear"))
        program = await RawProgram.join(server, existing_bus("classroom", folder).port)
        program.say(BusFrame(Frame(0x123)))
        await ear.until(lambda: ear.frames != [])
        program.writer.close()
        left, server.disconnected = server.disconnected, lambda program: (left(program), ear.poke())  # type: ignore[method-assign, assignment, func-returns-value]
        await ear.until(lambda: server.programs == 0)
        ear.bus.send(Frame(0x200))
        await ear.until(lambda: ear.states != [])
        assert ear.states[0][0] is BusState.PASSIVE, "nobody is left to acknowledge"


NONSENSE: list[tuple[bytes | list[Message], str]] = [
    (b"GET / HTTP/1.1\r\n\r\n", "message of an impossible length"),
    (b"\x01\x00\xff", "message of an unknown kind"),
    ([BusFrame(Frame(1))], sim_server.UNEXPECTED),
    ([Restart()], sim_server.UNEXPECTED),
    ([Welcome(1, None, fd=False)], sim_server.UNEXPECTED),
]


@pytest.mark.parametrize(("said", "reason"), NONSENSE)
async def test_who_talks_nonsense_is_dropped_counted_and_said_once(
    folder: Path, caplog: pytest.LogCaptureFixture, said: bytes | list[Message], reason: str
) -> None:
    octets = said if isinstance(said, bytes) else b"".join(map(encode, said))
    with caplog.at_level(logging.WARNING):
        async with served(folder) as (server, _):
            for _ in range(3):
                program = await RawProgram.connect(existing_bus("classroom", folder).port)
                program.writer.write(octets)
                assert await program.ended() == []
            assert server.counters.dropped == {reason: 3}
            assert server.programs == 0
    assert [record.message.count(reason) for record in caplog.records] == [1]


async def test_nonsense_after_the_hello_is_dropped_too(folder: Path) -> None:
    async with served(folder) as (server, _):
        port = existing_bus("classroom", folder).port
        twice, late = [await RawProgram.join(server, port) for _ in range(2)]
        twice.say(Hello(server.key, "again"))
        late.writer.write(encode(Restart()) + b"\0\0" + encode(Restart()))
        assert await twice.ended() == await late.ended() == []
        assert server.counters.dropped == {sim_server.UNEXPECTED: 1, "message of an impossible length": 1}


async def test_a_wrong_key_is_refused_with_words(folder: Path) -> None:
    async with served(folder) as (server, _):
        program = await RawProgram.connect(existing_bus("classroom", folder).port)
        program.say(Hello(bytes(16), "thief"))
        assert "key" in (await program.hear(Refused)).words
        assert await program.ended() == []
        assert server.counters.dropped == {sim_server.WRONG_KEY: 1}


async def test_who_does_not_say_hello_is_dropped(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sim_server, "HELLO_S", 0.0)
    async with served(folder) as (server, _):
        program = await RawProgram.connect(existing_bus("classroom", folder).port)
        assert await program.ended() == []
        assert server.counters.dropped == {sim_server.NO_HELLO: 1}


async def test_too_many_programs_are_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sim_server, "MAX_PROGRAMS", 1)
    async with served(folder) as (server, _):
        port = existing_bus("classroom", folder).port
        one = await RawProgram.join(server, port)
        other = await RawProgram.connect(port)
        assert "too many" in (await other.hear(Refused)).words
        await other.ended()
        assert (server.programs, server.counters.dropped) == (1, {sim_server.TOO_MANY: 1})
        one.writer.close()


async def test_frames_come_only_as_fast_as_the_controller_takes_them(folder: Path) -> None:
    async with served(folder) as (server, driver):
        ear = Ear(driver.attach("ear"))
        program = await RawProgram.join(server, existing_bus("classroom", folder).port)
        program.writer.write(b"".join(encode(BusFrame(Frame(1), tag)) for tag in range(MAILBOXES + 1)))
        assert await program.ended() == []
        assert server.counters.dropped == {sim_server.OVERRUN: 1}
        assert len(ear.frames) < MAILBOXES, "its controller was removed at once"


async def test_a_frame_that_the_controller_does_not_bear_is_rejected(folder: Path) -> None:
    async with served(folder, bus=SimBus(500_000, fd=True)) as (server, _):
        program = await RawProgram.connect(existing_bus("classroom", folder).port)
        program.say(Hello(server.key, "old", classic=True))
        program.say(BusFrame(Frame(1, fd=True), 9))
        rejected = await program.hear(FrameRejected)
        assert (rejected.tag, "cannot send CAN FD" in rejected.words) == (9, True)
        program.writer.close()


async def test_who_does_not_read_loses_frames_and_is_told_how_many(folder: Path) -> None:
    async with served(folder) as (server, driver):
        port = existing_bus("classroom", folder).port
        lazy = await RawProgram.join(server, port)
        talker, ear = Ear(driver.attach("talker")), Ear(driver.attach("ear"))
        (program,) = server._programs
        program.pause_writing()  # as its transport does when octets pile up
        lazy.say(BusFrame(Frame(0x200), 5))
        for number in range(3):
            talker.bus.send(Frame(0x123, bytes([number])))
        await ear.until(lambda: len(ear.frames) == 3)
        assert server.counters.dropped == {sim_server.NOT_READ: 3}
        program.resume_writing()
        assert await lazy.hear(FramesLost) == FramesLost(3)
        assert (await lazy.hear(FrameSent)).tag == 5, "what it said meanwhile was left in the socket"
        lazy.writer.close()


async def test_who_does_not_read_is_told_its_latest_state_only(folder: Path) -> None:
    async with served(folder) as (server, driver):
        lazy = await RawProgram.join(server, existing_bus("classroom", folder).port)
        (program,) = server._programs
        program.pause_writing()
        for state in (BusState.PASSIVE, BusState.OFF, BusState.ACTIVE):
            program._state(state, state.value, driver.now())
        program.resume_writing()
        program.pause_writing()
        program.resume_writing()
        program.close()
        told = [message for message in await lazy.ended() if isinstance(message, StateTold)]
        assert [message.state for message in told] == [BusState.ACTIVE]


async def test_a_computer_without_a_free_port_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(98, "Address already in use")

    monkeypatch.setattr(socket, "create_server", refuse)
    words = "cannot serve the simulated bus 'classroom' on 127.0.0.1: Address already in use"
    with pytest.raises(LinkDown, match=words):
        async with asyncio.timeout(60):
            await sim_server.SimBusServer(SimBusDriver(SimBus(500_000)), "classroom", folder=folder).run()
    assert find_bus("classroom", folder) is None


async def test_a_second_server_of_a_name_is_refused(folder: Path) -> None:
    async with served(folder) as (server, _):
        with pytest.raises(LinkDown, match="already"):
            async with asyncio.timeout(60):
                await sim_server.SimBusServer(server.driver, "classroom", folder=folder).run()
        assert find_bus("classroom", folder) is not None
