"""What the server of a simulated bus answers, message by message, in virtual time and without sockets."""

from __future__ import annotations

import asyncio
import socket

import pytest

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import frame_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim import sim_bus_server as sim_server
from msbot_agent.link.can.sim.model.sim_bus import SimBus
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
from msbot_agent.link.can.sim.sim_bus_server import SimBusConnection, SimBusServer
from tests.link.can.sim.virtual import virtually
from tests.link.can.sim.wire import Wire

FRAME = Frame(0x123, b"x")


class Program:
    """One that is connected, whose every word is known."""

    def __init__(self, server: SimBusServer) -> None:
        self.connection = SimBusConnection(server)
        self.wire = Wire()
        self.connection.connection_made(self.wire)

    @classmethod
    def joined(cls, server: SimBusServer, name: str = "", *, listens: bool = False, classic: bool = False) -> Program:
        it = cls(server)
        it.say(Hello(server.key, name, listen_only=listens, classic=classic))
        assert [type(one) for one in it.wire.said()] == [Welcome]
        return it

    def say(self, *messages: Message) -> None:
        self.connection.data_received(b"".join(map(encode, messages)))


def serve(*, fd: bool = False) -> SimBusServer:
    return SimBusServer(SimBusDriver(SimBus(500_000, fd=fd)), "classroom")


EVERY: dict[str, Message] = {
    "hello": Hello(bytes(16), "A"),
    "frame": BusFrame(FRAME, 7),
    "restart": Restart(),
    "welcome": Welcome(1, None, fd=False),
    "refused": Refused("no"),
    "sent": FrameSent(1, 0.0),
    "rejected": FrameRejected(1, "no"),
    "state": StateTold(BusState.ACTIVE, 0.0, 0, 0, ""),
    "lost": FramesLost(1),
}
TAKEN = {"new": {"hello"}, "joined": {"frame", "restart"}, "listening": set[str]()}


@pytest.mark.parametrize("stage", TAKEN)
@pytest.mark.parametrize("word", EVERY)
@virtually
async def test_what_is_taken_and_when(stage: str, word: str) -> None:
    server = serve()
    it = Program(server) if stage == "new" else Program.joined(server, listens=stage == "listening")
    it.say(Hello(server.key, "A") if word == "hello" else EVERY[word], Restart())
    if word in TAKEN[stage]:
        assert (it.wire.ended, server.programs, server.counters.dropped) == ("", 1, {})
    else:
        assert (it.wire.ended, server.programs) == ("aborted", 0)
        assert server.counters.dropped == {sim_server.UNEXPECTED: 1}, "the message behind it is not looked at"
        assert (server.driver.listeners, server.driver.bus._nodes) == ([], {})


@virtually
async def test_who_says_hello_within_2_s_may_stay() -> None:
    server = serve()
    quick, slow = Program(server), Program(server)
    await asyncio.sleep(1.99)
    quick.say(Hello(server.key, ""))
    assert (quick.wire.ended, slow.wire.ended) == ("", "")
    await asyncio.sleep(0.02)
    assert (quick.wire.ended, slow.wire.ended) == ("", "aborted")
    await asyncio.sleep(60.0)
    assert (quick.wire.ended, server.counters.dropped) == ("", {sim_server.NO_HELLO: 1})


@virtually
async def test_what_waits_for_a_program_is_bounded_here_and_in_the_system() -> None:
    it = Program(serve())
    assert it.wire.most == 16 * 1024
    assert it.wire.options.set == [(socket.SOL_SOCKET, socket.SO_SNDBUF, 16 * 1024)]


@virtually
async def test_a_program_that_is_refused_has_no_time_limit_left_behind() -> None:
    server = serve()
    thief = Program(server)
    thief.say(Hello(bytes(16), ""))
    (refused,) = thief.wire.said()
    assert isinstance(refused, Refused)
    assert thief.wire.ended == "closed", "what was said still arrives"
    await asyncio.sleep(10.0)
    assert server.counters.dropped == {sim_server.WRONG_KEY: 1}


@virtually
async def test_of_too_many_programs_the_last_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sim_server, "MAX_PROGRAMS", 2)
    server = serve()
    first, _, third = Program(server), Program(server), Program(server)
    assert [type(one) for one in third.wire.said()] == [Refused]
    assert (third.wire.ended, server.programs, first.wire.said()) == ("closed", 2, [])
    first.connection.connection_lost(None)
    Program.joined(server)
    assert (server.programs, server.counters.dropped) == (2, {sim_server.TOO_MANY: 1})
    await asyncio.sleep(10.0)


@virtually
async def test_each_controller_has_a_name_of_its_own_and_what_it_understands() -> None:
    server = serve(fd=True)
    names: list[str] = []
    server.driver.tap = lambda _at, name, _frame: names.append(name)
    programs = [Program.joined(server, "A"), Program.joined(server, "A"), Program.joined(server, classic=True)]
    for number, it in enumerate(programs):
        it.say(BusFrame(Frame(number), number))
    await asyncio.sleep(1.0)
    assert names == ["A#1", "A#2", "program#3"]
    for it in programs:
        it.wire.said()
        it.say(BusFrame(Frame(9, fd=True), 9))
    assert [[type(one) for one in it.wire.said()] for it in programs] == [[], [], [FrameRejected]]


@virtually
async def test_every_frame_is_told_with_its_own_time_also_the_same_one_again() -> None:
    server = serve()
    talker = server.driver.attach("talker")
    programs = [Program.joined(server), Program.joined(server, listens=True)]
    length_s = frame_bits(FRAME).nominal_bits / 500_000
    for _ in range(2):
        talker.send(FRAME)
    other = Frame(0x124, b"x")
    talker.send(other)
    await asyncio.sleep(1.0)
    ends = [pytest.approx((number * length_s) - 3 / 500_000) for number in (1, 2)]
    for it in programs:
        heard = [one for one in it.wire.said() if isinstance(one, BusFrame)]
        assert [(one.frame, one.tag) for one in heard] == [(FRAME, 0), (FRAME, 0), (other, 0)]
        assert [one.at for one in heard[:2]] == ends


@virtually
async def test_a_frame_is_encoded_once_for_all_that_hear_it() -> None:
    server = serve()
    octets = server.encode_received(FRAME, 1.0)
    assert octets == encode(BusFrame(FRAME, 0, 1.0))
    assert server.encode_received(FRAME, 1.0) is octets
    assert server.encode_received(FRAME, 2.0) == encode(BusFrame(FRAME, 0, 2.0))
    assert server.encode_received(Frame(0x124), 2.0) == encode(BusFrame(Frame(0x124), 0, 2.0))


@virtually
async def test_of_two_equal_frames_the_older_one_leaves_first() -> None:
    server = serve()
    it = Program.joined(server)
    server.driver.attach("ear")
    it.say(BusFrame(FRAME, 1), BusFrame(Frame(0x001), 2), BusFrame(FRAME, 3))
    await asyncio.sleep(1.0)
    sent = [one for one in it.wire.said() if isinstance(one, FrameSent)]
    assert [one.tag for one in sent] == [2, 1, 3]
    assert [one.at for one in sent] == sorted({one.at for one in sent})
    it.say(*(BusFrame(FRAME, tag) for tag in (4, 5, 6)))
    assert it.wire.ended == "", "all three had left"
    it.say(BusFrame(FRAME, 7))
    assert (it.wire.ended, server.counters.dropped) == ("aborted", {sim_server.OVERRUN: 1})


@virtually
async def test_a_passive_controller_says_so_in_its_frame_and_it_is_the_same_frame() -> None:
    server = serve(fd=True)
    it = Program.joined(server)
    it.say(BusFrame(Frame(0x123, b"x", fd=True), 5))
    await asyncio.sleep(0.1)  # nobody acknowledges
    told = [one for one in it.wire.said() if isinstance(one, StateTold)]
    assert [(one.state, one.transmit_errors, one.receive_errors) for one in told] == [(BusState.PASSIVE, 128, 0)]
    listener = Program.joined(server)
    await asyncio.sleep(0.1)
    heard = [one.frame for one in listener.wire.said() if isinstance(one, BusFrame)]
    assert heard == [Frame(0x123, b"x", fd=True, esi=True)]
    assert [one.tag for one in it.wire.said() if isinstance(one, FrameSent)] == [5]


@virtually
async def test_bus_off_empties_the_controller_and_a_restart_fills_it_again() -> None:
    server = serve()
    it = Program.joined(server)
    server.driver.short_circuit()
    it.say(*(BusFrame(Frame(number), number) for number in (1, 2, 3)))
    await asyncio.sleep(1.0)
    told = [one for one in it.wire.said() if isinstance(one, StateTold)]
    assert [(one.state, one.transmit_errors > 255) for one in told] == [(BusState.PASSIVE, False), (BusState.OFF, True)]
    server.driver.repair()
    it.say(Restart())
    await asyncio.sleep(1.0)
    assert [(one.state, one.transmit_errors) for one in it.wire.said() if isinstance(one, StateTold)] == [
        (BusState.ACTIVE, 0)
    ]
    it.say(*(BusFrame(Frame(number), number) for number in (4, 5, 6)))
    assert it.wire.ended == ""


@virtually
async def test_while_a_program_does_not_read_nothing_is_taken_or_told_but_counted() -> None:
    server = serve()
    it = Program.joined(server)
    talker = server.driver.attach("talker")
    it.connection.pause_writing()
    assert not it.wire.reads
    for number in range(3):
        talker.send(Frame(number))
    await asyncio.sleep(1.0)
    assert it.wire.said() == []
    it.connection.resume_writing()
    assert (it.wire.said(), it.wire.reads) == ([FramesLost(3)], True)
    it.connection.pause_writing()
    it.connection.resume_writing()
    assert it.wire.said() == [], "said once"
    talker.send(FRAME)
    await asyncio.sleep(1.0)
    assert [type(one) for one in it.wire.said()] == [BusFrame]
    assert server.counters.dropped == {sim_server.NOT_READ: 3}


@virtually
async def test_who_goes_while_it_does_not_read_leaves_nothing_behind() -> None:
    server = serve()
    for listens in (False, True):
        it = Program.joined(server, listens=listens)
        other = Program.joined(server, listens=True)
        it.connection.pause_writing()
        it.connection.connection_lost(None)
        it.connection.resume_writing()
        it.connection.pause_writing()
        it.connection.close()
        assert server.programs == 1
        assert len(server.driver.listeners) == 1, "the other's"
        other.connection.close()
    assert (server.driver.listeners, server.driver.bus._nodes, server.counters.dropped) == ([], {}, {})
    closing = Program.joined(server)
    closing.connection.pause_writing()
    closing.wire.ended = "closed"
    closing.connection.resume_writing()
    assert not closing.wire.reads
