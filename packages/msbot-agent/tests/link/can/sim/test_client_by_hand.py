"""What a controller on another program's simulated bus does, message by message, in virtual time without sockets."""

from __future__ import annotations

import asyncio
import logging
import socket
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import pytest

from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim import sim_bus_client as sim_client
from msbot_agent.link.can.sim.bus_names import NamedBus
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
from msbot_agent.link.can.sim.sim_bus_client import (
    LOST_WORDS,
    LocalBusChannel,
    SimAdapter,
    SimBusChannel,
    SimBusRequest,
    WhenAbsent,
)
from msbot_agent.link.can.sim.sim_bus_server import SimBusServer
from msbot_xrce.errors import ConfigError, LinkDown
from tests.link.can.sim.virtual import virtually
from tests.link.can.sim.wire import Wire

FRAME = Frame(0x123, b"x")
HELLO = Hello(bytes(range(16)), "A")
WELCOME = Welcome(500_000, None, fd=False)
BUS = NamedBus("classroom", 4711, HELLO.key.hex(), 99, 500_000, None, fd=False)
FD_BUS = NamedBus("classroom", 4711, HELLO.key.hex(), 99, 500_000, 2_000_000, fd=True)


@dataclass
class Owner:
    """Writes everything down."""

    told: list[tuple[object, ...]] = field(default_factory=list)

    def free_slots(self) -> int:
        raise AssertionError("nobody asks")

    def take(self, frames: list[Frame], now: float) -> None:
        self.told.append(("take", *frames, now))

    def room_available(self, channel: object, now: float) -> None:
        self.told.append(("room", now))

    def state(self, channel: object, state: BusState, words: str, now: float) -> None:
        self.told.append((state, words, now))

    def events(self, words: tuple[str, ...], now: float, *, times: int = 1) -> None:
        self.told.append((*words, now, times))

    def lost(self, channel: object, words: str) -> None:
        self.told.append(("lost", words))


class Client:
    """One that is connected, and what its owner is told."""

    def __init__(self, hello: Hello = HELLO, *, welcome: bool = True) -> None:
        self.owner = Owner()
        self.channel = SimBusChannel(self.owner, hello, "classroom")
        self.wire = Wire()
        self.channel.connection_made(self.wire)
        assert self.wire.said() == [hello]
        if welcome:
            self.hear(WELCOME)

    def hear(self, *messages: Message) -> None:
        self.channel.data_received(b"".join(map(encode, messages)))


def nonsense(words: str) -> tuple[str, str]:
    return ("lost", f"the program that serves the simulated bus 'classroom' talks nonsense: {words}")


NOT_THEN = nonsense("message that a server does not send, or not then")
ANSWERS: list[tuple[Message, list[tuple[object, ...]]]] = [
    (BusFrame(FRAME, 0, 2.5), [("take", FRAME, 2.5)]),
    (FrameSent(1, 2.5), [("room", 2.5)]),
    (FrameRejected(1, "off"), [("off", 7.0, 1), ("room", 7.0)]),
    (StateTold(BusState.PASSIVE, 2.5, 128, 0, "bad"), [(BusState.PASSIVE, "bad", 2.5)]),
    (StateTold(BusState.OFF, 2.5, 256, 0, "off"), [(BusState.OFF, "off", 2.5)]),
    (FramesLost(5), [(LOST_WORDS, 7.0, 1)]),
    (Refused("full"), [("lost", "the simulated bus 'classroom' refuses this program: full")]),
    (WELCOME, [NOT_THEN]),
    (HELLO, [NOT_THEN]),
    (Restart(), [NOT_THEN]),
]


@pytest.mark.parametrize(("message", "told"), ANSWERS)
@virtually
async def test_what_each_message_of_the_server_does(message: Message, told: list[tuple[object, ...]]) -> None:
    await asyncio.sleep(7.0)
    it = Client()
    for _ in range(3):
        assert it.channel.send(FRAME)
    assert not it.channel.send(FRAME)
    it.hear(message, FrameSent(2, 9.0))
    is_end = told[0][0] == "lost"
    assert it.owner.told == (told if is_end else [*told, ("room", 9.0)])
    assert it.wire.ended == ("aborted" if is_end else "")
    left = {FrameSent: 1, FrameRejected: 1}.get(type(message), 2)
    if isinstance(message, StateTold) and message.state is BusState.OFF:
        left = 0
    assert it.channel.pending() == (3 if is_end else left)
    assert it.channel.ended == (told[0][1] if is_end else "")


@virtually
async def test_each_frame_has_a_tag_of_its_own_and_after_the_last_number_comes_0() -> None:
    it = Client()
    it.channel._tag = 0xFFFFFFFE
    assert [it.channel.send(FRAME) for _ in range(4)] == [True, True, True, False]
    assert it.wire.said() == [BusFrame(FRAME, 0xFFFFFFFF), BusFrame(FRAME, 0), BusFrame(FRAME, 1)]
    it.hear(FrameSent(0, 1.0))
    assert (it.channel.pending(), it.channel.send(FRAME)) == (2, True)
    assert it.wire.said() == [BusFrame(FRAME, 2)]
    assert Client().channel.send(FRAME)


@virtually
async def test_who_listens_only_sends_nothing() -> None:
    it = Client(Hello(HELLO.key, "A", listen_only=True))
    assert (it.channel.send(FRAME), it.channel.pending(), it.wire.said()) == (False, 0, [])


@virtually
async def test_the_system_holds_little_for_a_program_that_is_slow() -> None:
    assert Client().wire.options.set == [(socket.SOL_SOCKET, socket.SO_RCVBUF, 16 * 1024)]


@virtually
async def test_a_restart_is_said_as_long_as_there_is_somebody_to_say_it_to() -> None:
    it = Client()
    it.channel.restart()
    assert it.wire.said() == [Restart()]
    await it.channel.close()
    it.channel.restart()
    assert (it.wire.said(), it.wire.ended, it.channel.send(FRAME)) == ([], "closed", False)


@pytest.mark.parametrize("is_welcome", [False, True])
@virtually
async def test_who_leaves_hears_nothing_more(is_welcome: bool) -> None:
    it = Client(welcome=is_welcome)
    it.channel.leave()
    it.channel.leave()
    it.hear(BusFrame(FRAME))
    it.channel.connection_lost(None)
    assert (it.owner.told, it.channel.ended, it.wire.ended) == ([], "", "closed")
    assert it.channel.welcomed.cancelled() != is_welcome


@pytest.mark.parametrize("is_welcome", [False, True])
@virtually
async def test_a_bus_that_ends_is_told_once(is_welcome: bool) -> None:
    it = Client(welcome=is_welcome)
    it.channel.connection_lost(None)
    it.channel.connection_lost(None)
    words = "the simulated bus 'classroom' has ended"
    assert (it.owner.told, it.channel.ended) == ([("lost", words)] if is_welcome else [], words)
    assert str(it.channel.welcomed.exception() or words) == words


@virtually
async def test_a_refusal_is_the_end_of_the_attempt() -> None:
    it = Client(welcome=False)
    it.hear(Refused("full"), WELCOME)
    with pytest.raises(LinkDown, match="refuses this program: full"):
        await it.channel.welcomed
    assert it.owner.told == []


RATES = (None, 250_000, 500_000)
FAST = (None, 2_000_000, 4_000_000)
KINDS = (None, False, True)


@pytest.mark.parametrize("bus", [BUS, FD_BUS], ids=["classic", "fd"])
def test_a_bus_is_as_requested_if_all_that_was_requested_is_so(bus: NamedBus) -> None:
    for bitrate, fast, fd in product(RATES, FAST, KINDS):
        is_so = bitrate in (None, 500_000) and (bus.fd or not fd) and (not bus.fd or fast in (None, 2_000_000))
        wish = SimBusRequest("classroom", bitrate, fast, fd)
        if is_so:
            wish.check(bus)
            continue
        data = fast or bus.data_bitrate if fd else None
        kind, rates = "CAN FD" if fd else "CAN", [rate // 1000 for rate in (bitrate or 500_000, data) if rate]
        with pytest.raises(LinkDown, match=f"not {kind}, {' and '.join(map(str, rates))} kbit/s"):
            wish.check(bus)


@pytest.mark.parametrize(
    ("wish", "bitrate", "data_bitrate", "fd"),
    [
        (SimBusRequest("b"), 500_000, None, False),
        (SimBusRequest("b", 125_000), 125_000, None, False),
        (SimBusRequest("b", fd=False), 500_000, None, False),
        (SimBusRequest("b", fd=True), 500_000, 2_000_000, True),
        (SimBusRequest("b", 1_000_000, 8_000_000, fd=True), 1_000_000, 8_000_000, True),
        (SimBusRequest("b", 4_000_000, fd=True), 4_000_000, 4_000_000, True),
    ],
)
def test_the_bus_that_is_made_and_what_is_known_of_it_before(
    wish: SimBusRequest, bitrate: int, data_bitrate: int | None, fd: bool, tmp_path: Path
) -> None:
    bus = wish.make()
    assert (bus.bitrate, bus.data_bitrate, bus.fd) == (bitrate, data_bitrate, fd)
    if bitrate <= 1_000_000:  # more than CAN allows: the data rate is only said when the bus is made
        assert SimAdapter(wish, folder=tmp_path).info == CanBusInfo("sim:b", bitrate, data_bitrate, fd)


def test_what_a_bus_is_counts_before_what_it_was_wished_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    wish = SimBusRequest("classroom", 125_000, 8_000_000, fd=True)
    monkeypatch.setattr(sim_client, "find_bus", lambda *_: BUS)
    assert SimAdapter(wish).info == CanBusInfo("sim:classroom", 500_000, None, False)
    monkeypatch.setattr(sim_client, "find_bus", lambda *_: FD_BUS)
    assert SimAdapter(SimBusRequest("classroom")).info == CanBusInfo("sim:classroom", 500_000, 2_000_000, True)

    def fail(*_: object) -> None:
        raise ConfigError("somebody else's folder")

    monkeypatch.setattr(sim_client, "find_bus", fail)
    assert SimAdapter(wish).info == CanBusInfo("sim:classroom", 125_000, 8_000_000, True)


class Script:
    """What is found and what a connection comes to, look by look; the last one stays."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *steps: object) -> None:
        self.steps = [*steps]
        self.looks: list[float] = []
        self.withdrawn: list[NamedBus] = []
        self.wires: list[Wire] = []
        self.now: object = None
        loop = asyncio.get_running_loop()
        monkeypatch.setattr(sim_client, "find_bus", self.find)
        monkeypatch.setattr(sim_client, "withdraw", lambda bus, _folder: self.withdrawn.append(bus))
        monkeypatch.setattr(loop, "create_connection", self.connect)
        self._time = loop.time

    def find(self, *_: object) -> NamedBus | None:
        self.looks.append(self._time())
        self.now = self.steps.pop(0) if len(self.steps) > 1 else self.steps[0]
        return None if self.now is None else BUS

    async def connect(self, protocol: object, host: str, port: int) -> None:
        assert (host, port) == ("127.0.0.1", 4711)
        if isinstance(self.now, OSError):
            raise self.now
        assert callable(protocol)
        channel = protocol()
        self.wires.append(Wire())
        channel.connection_made(self.wires[-1])
        if isinstance(self.now, bytes):
            channel.data_received(self.now)


def adapter_of(absent: WhenAbsent) -> SimAdapter:
    return SimAdapter(SimBusRequest("classroom"), node="N", absent=absent, listen_only=True)


@virtually
async def test_a_part_looks_for_its_bus_four_times_a_second(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    script = Script(monkeypatch, None, None, None, None, encode(WELCOME))
    channel = await adapter_of(WhenAbsent.WAIT).open(Owner())
    assert isinstance(channel, SimBusChannel)
    assert script.looks == [0.0, 0.0, 0.25, 0.5, 0.75]
    assert script.wires[0].said() == [Hello(HELLO.key, "N", listen_only=True)]
    assert [one.message for one in caplog.records] == [
        "waiting for the simulated bus 'classroom': nobody serves it yet"
    ]
    channel.leave()


@pytest.mark.parametrize("absent", [WhenAbsent.WAIT, WhenAbsent.FAIL, WhenAbsent.SERVE])
@virtually
async def test_a_server_that_says_nothing_has_2_s(
    absent: WhenAbsent, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    script = Script(monkeypatch, None, b"", b"", encode(WELCOME))
    words = "cannot join the simulated bus 'classroom' of process 99: it does not answer"
    if absent is WhenAbsent.WAIT:
        channel = await adapter_of(absent).open(Owner())
        assert isinstance(channel, SimBusChannel)
        assert script.looks == [0.0, 0.0, 2.0, 4.0], "again at once: so long it has waited already"
        assert [wire.ended for wire in script.wires] == ["closed", "closed", ""]
        assert [one.message for one in caplog.records] == [f"{words}; trying again"]
        channel.leave()
    else:
        with pytest.raises(LinkDown, match=words):
            await adapter_of(absent).open(Owner())
        assert script.looks == [0.0, 0.0]


@pytest.mark.parametrize("absent", [WhenAbsent.WAIT, WhenAbsent.FAIL, WhenAbsent.SERVE])
@virtually
async def test_a_server_that_ends_before_it_accepts_is_waited_for_by_parts(
    absent: WhenAbsent, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    script = Script(monkeypatch, None, ConnectionResetError(), ConnectionResetError(), encode(WELCOME))
    if absent is WhenAbsent.WAIT:
        channel = await adapter_of(absent).open(Owner())
        assert isinstance(channel, SimBusChannel)
        assert script.looks == [0.0, 0.0, 0.25, 0.5]
        assert [one.message for one in caplog.records] == ["the simulated bus 'classroom' has ended; trying again"]
        channel.leave()
    else:
        with pytest.raises(LinkDown, match="'classroom' has ended"):
            await adapter_of(absent).open(Owner())


@virtually
async def test_who_refuses_connections_has_gone_and_its_file_with_it(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    script = Script(monkeypatch, None, ConnectionRefusedError(), encode(WELCOME))
    with caplog.at_level(logging.WARNING):
        channel = await adapter_of(WhenAbsent.WAIT).open(Owner())
    assert (script.withdrawn, script.looks, caplog.records) == ([BUS], [0.0, 0.0, 0.25], [])
    assert isinstance(channel, SimBusChannel)
    channel.leave()


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (OSError(24, "Too many open files"), "of process 99: Too many open files"),
        (OSError("no number"), "of process 99: no number"),
        (encode(Refused("full")), "refuses this program: full"),
        (encode(WELCOME) + b"\0\0", "talks nonsense: message of an impossible length"),
        (encode(WELCOME) + encode(Restart()), "talks nonsense: message that a server does not send, or not then"),
    ],
)
@virtually
async def test_what_waiting_would_not_mend_is_told_at_once(
    step: object, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = Script(monkeypatch, None, step)
    with pytest.raises(LinkDown, match=words):
        await adapter_of(WhenAbsent.WAIT).open(Owner())
    assert script.looks == [0.0, 0.0]
    assert script.withdrawn == []
    assert all(wire.ended for wire in script.wires)


@virtually
async def test_whoever_is_cancelled_while_it_joins_has_left(monkeypatch: pytest.MonkeyPatch) -> None:
    script = Script(monkeypatch, None, b"")
    opening = asyncio.ensure_future(adapter_of(WhenAbsent.WAIT).open(Owner()))
    await asyncio.sleep(1.0)
    opening.cancel()
    await asyncio.wait([opening])
    assert (opening.cancelled(), script.wires[0].ended) == (True, "closed")


@pytest.mark.parametrize("is_another_there", [False, True])
@pytest.mark.parametrize("error", [LinkDown("no port"), ConfigError("no folder")])
@virtually
async def test_only_that_another_serves_the_bus_is_no_error(
    error: Exception, is_another_there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(_self: SimBusServer) -> None:
        raise error

    monkeypatch.setattr(SimBusServer, "run", fail)
    monkeypatch.setattr(sim_client, "find_bus", lambda *_: BUS if is_another_there else None)
    host = LocalBusChannel(Owner(), SimBusRequest("classroom"), "", None)
    if is_another_there and isinstance(error, LinkDown):
        assert not await host.start()
    else:
        with pytest.raises(type(error), match=str(error)):
            await host.start()


class Served:
    """Stands in for a server that can be waited for, and takes a moment to end."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, begins_after_s: float) -> None:
        self.ends: list[float] = []

        async def run(server: SimBusServer) -> None:
            try:
                await asyncio.sleep(begins_after_s)
                server.ready.set()
                await asyncio.get_running_loop().create_future()
            finally:
                await asyncio.sleep(0.5)
                self.ends.append(asyncio.get_running_loop().time())

        monkeypatch.setattr(SimBusServer, "run", run)


@pytest.mark.parametrize(("node", "name"), [("", "host"), ("master", "master")])
@virtually
async def test_who_serves_is_on_the_bus_until_it_has_closed_it(
    node: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    served, owner = Served(monkeypatch, 1.0), Owner()
    host = LocalBusChannel(owner, SimBusRequest("classroom"), node, None)
    assert await host.start()
    assert asyncio.get_running_loop().time() == 1.0
    other = host.driver.attach("other")
    taps: list[str] = []
    host.driver.tap = lambda _at, who, _frame: taps.append(who)
    assert [host.send(Frame(number)) for number in range(4)] == [True, True, True, False]
    assert host.pending() == 3
    await asyncio.sleep(1.0)
    other.send(FRAME)
    await asyncio.sleep(1.0)
    assert taps == [name, name, name, "other"]
    assert [what for what, *_ in owner.told] == ["room", "room", "room", "take"]
    await host.close()
    assert served.ends == [3.5], "who closes it waits for its end"
    other.send(FRAME)
    await asyncio.sleep(1.0)
    assert host.driver.bus.state(other.node) is BusState.PASSIVE, "nobody is left to acknowledge"


@virtually
async def test_whoever_is_cancelled_while_it_begins_to_serve_serves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    served = Served(monkeypatch, 5.0)
    starting = asyncio.ensure_future(LocalBusChannel(Owner(), SimBusRequest("classroom"), "", None).start())
    await asyncio.sleep(1.0)
    starting.cancel()
    await asyncio.wait([starting])
    assert starting.cancelled()
    await asyncio.sleep(10.0)
    assert served.ends == [1.5]
    assert asyncio.all_tasks() == {asyncio.current_task()}
