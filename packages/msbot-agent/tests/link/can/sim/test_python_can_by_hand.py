"""python-can's side of a simulated bus, message by message: what is said to the server, and what its answers do."""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

import can
from msbot_agent.link.can.adapters.python_can import frame_of, message_of
from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim import python_can_interface as sim_interface
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
    Splitter,
    StateTold,
    Welcome,
    encode,
)
from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from msbot_agent.link.can.sim.sim_bus_client import LOST_WORDS, SimBusRequest
from msbot_xrce.errors import LinkDown

KEY = bytes(range(16))
BUS = NamedBus("classroom", 4711, KEY.hex(), 99, 500_000, None, fd=False)
WELCOME = Welcome(500_000, None, fd=False)
FRAME = Frame(0x123, b"x")
INFO = "simulated bus classroom (CAN, 500 kbit/s)"


@dataclass
class Wire:
    """A socket that says what it was given, and then waits for its end."""

    answers: list[bytes | OSError]
    options: list[tuple[int, int, int]] = field(default_factory=list)
    timeout: float | None = -1.0
    closed: int = 0
    broken: bool = False

    def __post_init__(self) -> None:
        self.over = threading.Event()
        self._splitter = Splitter()
        self._said: list[Message] = []

    def recv(self, size: int) -> bytes:
        if self.answers:
            answer = self.answers.pop(0)
            if isinstance(answer, OSError):
                raise answer
            return answer
        self.over.wait()
        return b""

    def sendall(self, data: bytes) -> None:
        if self.broken:
            raise BrokenPipeError(32, "Broken pipe")
        self._said += self._splitter.receive(data)

    def said(self) -> list[Message]:
        said, self._said = self._said, []
        return said

    def setsockopt(self, *option: int) -> None:
        level, name, value = option
        self.options.append((level, name, value))

    def settimeout(self, timeout: float | None) -> None:
        self.timeout = timeout

    def shutdown(self, how: int) -> None:
        assert how == socket.SHUT_RDWR
        self.over.set()

    def close(self) -> None:
        self.closed += 1


class Stage:
    """The rest of the world: who serves what, and what was asked of it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, serves_here: bool = False) -> None:
        self.wishes: list[SimBusRequest] = []
        self.released: list[str] = []
        self.wire = Wire([])
        self.asked: list[object] = []

        def hold(wish: SimBusRequest) -> bool:
            self.wishes.append(wish)
            return serves_here

        def connect(address: tuple[str, int], timeout: float) -> Wire:
            self.asked.append((address, timeout))
            return self.wire

        monkeypatch.setattr(sim_interface, "hold", hold)
        monkeypatch.setattr(sim_interface, "release", self.released.append)
        monkeypatch.setattr(sim_interface, "existing_bus", lambda _: BUS)
        monkeypatch.setattr(socket, "create_connection", connect)
        monkeypatch.setattr(sim_interface, "LINGER_S", 0.0)

    @contextmanager
    def join(self, *others: Message, **options: Any) -> Iterator[MsbotBus]:
        self.wire.answers = [b"".join(map(encode, (WELCOME, *others)))]
        with MsbotBus(**options) as bus:
            yield bus


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Stage:
    return Stage(monkeypatch)


def test_how_a_bus_is_joined_and_left(stage: Stage) -> None:
    with stage.join(node="N", listen_only=True) as bus:
        assert stage.asked == [(("127.0.0.1", 4711), 2.0)]
        assert stage.wire.said() == [Hello(KEY, "N", listen_only=True)]
        assert stage.wire.options == [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)]
        assert stage.wire.timeout is None
        assert (bus.channel_info, bus.protocol, bus.state) == (INFO, can.CanProtocol.CAN_20, can.BusState.ACTIVE)
        assert bus._reader.daemon
    assert (stage.wire.closed, stage.released) == (1, [])
    assert not bus._reader.is_alive()


@pytest.mark.parametrize(
    ("options", "wish"),
    [
        ({}, SimBusRequest("classroom")),
        ({"channel": "b", "bitrate": "250000"}, SimBusRequest("b", 250_000)),
        ({"data_bitrate": 4_000_000}, SimBusRequest("classroom")),
        ({"fd": True}, SimBusRequest("classroom", fd=True)),
        ({"fd": True, "bitrate": 1, "data_bitrate": "4000000"}, SimBusRequest("classroom", 1, 4_000_000, fd=True)),
    ],
)
def test_what_is_asked_for(options: dict[str, Any], wish: SimBusRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, serves_here=True)
    monkeypatch.setattr(SimBusRequest, "check", lambda *_: None)
    with stage.join(**options):
        assert (stage.wishes, stage.released) == ([wish], [])
    assert stage.released == [wish.name]


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (encode(Refused("full")), "the simulated bus 'classroom' refuses this program: full"),
        (
            encode(FramesLost(1)) + encode(WELCOME),
            "process 99 does not serve the simulated bus 'classroom' as it should",
        ),
        (b"HTTP/1.1 400", "cannot join the simulated bus 'classroom' of process 99: message of an impossible length"),
        (b"", "cannot join the simulated bus 'classroom' of process 99: it closed the connection"),
        (TimeoutError("timed out"), "cannot join the simulated bus 'classroom' of process 99: timed out"),
        (encode(WELCOME) + encode(Restart()), "message that a server does not send, or not then"),
    ],
)
def test_why_a_bus_cannot_be_joined(answer: bytes | OSError, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, serves_here=True)
    stage.wire.answers = [answer]
    with pytest.raises(can.CanInitializationError) as caught:
        MsbotBus()
    assert str(caught.value) == words
    assert (stage.wire.closed, stage.released) == (1, ["classroom"])


def test_a_bus_of_other_rates_is_left_before_anything_is_said(stage: Stage) -> None:
    with pytest.raises(can.CanInitializationError, match="is CAN, 500 kbit/s, not CAN, 250 kbit/s"):
        MsbotBus(bitrate=250_000)
    assert (stage.asked, stage.wire.closed) == ([], 0)


def test_what_comes_with_the_welcome_in_pieces_is_not_lost(stage: Stage) -> None:
    octets = encode(WELCOME) + encode(BusFrame(FRAME, 0, 5.0))
    stage.wire.answers = [octets[:3], octets[3:-1], octets[-1:]]
    with MsbotBus() as bus:
        assert (received := bus.recv(60.0)) is not None
        assert frame_of(received) == FRAME


@pytest.mark.parametrize("own", [False, True])
def test_received_and_own_frames(stage: Stage, own: bool) -> None:
    with stage.join(receive_own_messages=own) as bus:
        sent = message_of(FRAME)
        bus.send(sent)
        bus._handle(BusFrame(Frame(5), 1, 10.0))
        bus._handle(FrameSent(2, 11.0))  # somebody else's number
        bus._handle(FrameSent(1, 12.0))
        bus._handle(FrameSent(1, 13.0))
        got = [message for message in (bus.recv(0), bus.recv(0), bus.recv(0)) if message is not None]
        assert [(frame_of(it), it.is_rx, it.channel) for it in got] == [
            (Frame(5), True, "classroom"),
            (FRAME, False, "classroom"),
        ][: 1 + own]
        assert [it.timestamp - bus._epoch_s for it in got] == pytest.approx([10.0, 12.0][: 1 + own], abs=1e-3)
        assert (sent.channel, sent.timestamp) == (None, 0.0), "the caller's message stays as it was"
        assert not bus._outstanding


def test_tags_go_round_and_three_frames_fit(stage: Stage) -> None:
    with stage.join() as bus:
        stage.wire.said()
        bus._tag = 0xFFFFFFFE
        for number in range(3):
            bus.send(message_of(Frame(number)))
        assert [it.tag for it in stage.wire.said() if isinstance(it, BusFrame)] == [0xFFFFFFFF, 0, 1]
        with pytest.raises(can.CanTimeoutError, match="holds 3 frames"):
            bus.send(message_of(FRAME), timeout=0)
        bus._handle(FrameRejected(0, "why not"))
        bus.send(message_of(FRAME), timeout=0)
        assert stage.wire.said() == [BusFrame(FRAME, 2)]


def test_states_are_kept_and_told(stage: Stage, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), stage.join() as bus:
        bus.send(message_of(FRAME))
        stage.wire.said()
        seen = []
        for state in (BusState.PASSIVE, BusState.OFF, BusState.ACTIVE):
            bus._handle(StateTold(state, 1.0, 0, 0, "so"))
            seen.append((bus.state, len(bus._outstanding)))
            if state is BusState.OFF:
                with pytest.raises(can.CanOperationError, match="is bus-off"):
                    bus.send(message_of(FRAME))
            bus.state = can.BusState.ACTIVE
            assert stage.wire.said() == ([Restart()] if state is BusState.OFF else [])
        assert seen == [(can.BusState.PASSIVE, 1), (can.BusState.ERROR, 0), (can.BusState.ACTIVE, 0)]
        bus._handle(FramesLost(3))
        bus._handle(FrameRejected(9, "why not"))
    warned, informed = logging.WARNING, logging.INFO
    assert [(it.levelno, it.message) for it in caplog.records if it.name == sim_interface.__name__] == [
        (warned, f"{INFO}: {BusState.PASSIVE.value}: so"),
        (warned, f"{INFO}: {BusState.OFF.value}: so"),
        (informed, f"{INFO}: {BusState.ACTIVE.value}: so"),
        (warned, f"{INFO}: {LOST_WORDS}"),
        (warned, f"{INFO}: a frame was not sent: why not"),
    ]


@pytest.mark.parametrize("message", [WELCOME, Refused("no"), Hello(KEY, ""), Restart()])
def test_what_a_server_does_not_say_ends_the_bus(stage: Stage, message: Message) -> None:
    stage.wire.answers = [encode(WELCOME), encode(message)]
    bus = MsbotBus()
    with pytest.raises(can.CanOperationError, match="talks nonsense: message that a server does not send, or not then"):
        bus.recv(60.0)
    bus.shutdown()
    with pytest.raises(can.CanOperationError, match="talks nonsense"):
        bus.send(message_of(FRAME))


def test_a_frame_that_cannot_be_handed_over_is_told(stage: Stage) -> None:
    with stage.join() as bus:
        stage.wire.broken = True
        with pytest.raises(can.CanOperationError, match="the simulated bus 'classroom' has ended"):
            bus.send(message_of(FRAME))


def test_after_the_end_a_state_is_told_to_nobody(stage: Stage) -> None:
    with stage.join() as bus:
        bus._bus_state = BusState.OFF
        stage.wire.said()
    bus.state = can.BusState.ACTIVE
    assert stage.wire.said() == []


def test_what_was_kept_is_read_before_the_end_is_told(stage: Stage) -> None:
    with stage.join() as bus:
        bus._handle(BusFrame(FRAME, 0, 1.0))
        assert bus.recv(0) is not None
        assert bus.recv(0) is None
        bus._handle(BusFrame(FRAME, 0, 1.0))
    assert bus.recv(0) is not None
    with pytest.raises(can.CanOperationError, match="was shut down"):
        bus.recv(0)


def test_who_keeps_too_much_loses_the_newest(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(sim_interface, "UNREAD_FRAMES", 2)
    with stage.join() as bus:
        for number in range(4):
            bus._handle(BusFrame(Frame(number), 0, 1.0))
        got = [message.arbitration_id for _ in range(3) if (message := bus.recv(0)) is not None]
        bus._handle(BusFrame(Frame(9), 0, 1.0))
        assert [*got, getattr(bus.recv(0), "arbitration_id", None)] == [0, 1, 9]
    assert len(caplog.records) == 1


def test_a_server_that_has_gone_is_no_reason_to_fail_when_leaving(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_how: int) -> None:
        stage.wire.over.set()
        raise OSError(107, "Transport endpoint is not connected")

    with stage.join() as bus:
        monkeypatch.setattr(stage.wire, "shutdown", fail)
    assert stage.wire.closed == 1
    assert not bus._reader.is_alive()


def test_errors_of_names_are_errors_of_opening(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: SimBusRequest) -> bool:
        raise LinkDown("somebody else serves it")

    monkeypatch.setattr(sim_interface, "hold", fail)
    with pytest.raises(can.CanInitializationError, match="somebody else serves it"):
        MsbotBus()
    assert stage.released == [], "it was not held"
