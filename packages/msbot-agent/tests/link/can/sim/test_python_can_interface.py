"""The simulated bus as python-can's users see it, in this process and in others."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import TypeVar

import pytest
from can.broadcastmanager import ThreadBasedCyclicSendTask

import can
from msbot_agent.link.can.adapters.python_can import message_of
from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.notation import parse_log_line
from msbot_agent.link.can.sim import python_can_interface as sim_interface
from msbot_agent.link.can.sim import sim_bus_server as sim_server
from msbot_agent.link.can.sim.bus_names import existing_bus, find_bus
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES, SimBus
from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver
from tests.link.sim_programs import PATIENCE_S, served

T = TypeVar("T")


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sim_interface, "LINGER_S", PATIENCE_S)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "msbot"


def message(can_id: int = 0x123, data: bytes = b"hello") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def heard(bus: can.BusABC) -> can.Message:
    received = bus.recv(PATIENCE_S)
    assert received is not None
    return received


class Server:
    """A bus served by another thread, with everything that can be done to it."""

    def __init__(self, loop: asyncio.AbstractEventLoop, server: sim_server.SimBusServer, driver: SimBusDriver) -> None:
        self.loop, self.server, self.driver = loop, server, driver
        self.end = asyncio.Event()

    def do(self, action: Callable[[], T]) -> T:
        """Do something in its thread."""
        done: Future[T] = Future()

        def act() -> None:
            done.set_result(action())

        self.loop.call_soon_threadsafe(act)
        return done.result(PATIENCE_S)


@pytest.fixture
def server(runtime_folder: Path) -> Iterator[Server]:
    started: Future[Server] = Future()

    async def serve() -> None:
        async with served(runtime_folder, bus=SimBus(500_000, 2_000_000, fd=True)) as (server, driver):
            it = Server(asyncio.get_running_loop(), server, driver)
            started.set_result(it)
            await it.end.wait()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    it = started.result(PATIENCE_S)
    yield it
    if not it.end.is_set():  # a test has not ended it already
        it.loop.call_soon_threadsafe(it.end.set)
    thread.join(PATIENCE_S)


def test_python_can_knows_the_interface() -> None:
    with can.Bus(interface="msbot", channel="classroom") as bus:
        assert isinstance(bus, MsbotBus)
        assert str(bus) == "simulated bus classroom (CAN, 500 kbit/s)"
        assert can.detect_available_configs("msbot") == [{"interface": "msbot", "channel": "classroom"}]
        assert bus.protocol is can.CanProtocol.CAN_20
    assert find_bus("classroom") is None
    assert can.detect_available_configs("msbot") == []


def test_messages_with_their_times_flags_and_channel() -> None:
    with MsbotBus() as one, MsbotBus(receive_own_messages=True) as other:
        one.send(message(0x100, b"one"))
        first = heard(other)
        other.send(message(0x101, b"other"))
        second, third = heard(other), heard(one)
        assert (bytes(first.data), first.is_rx) == (b"one", True)
        assert (bytes(second.data), second.is_rx) == (b"other", False)
        assert bytes(third.data) == b"other"
        assert first.timestamp < second.timestamp
        assert second.timestamp == pytest.approx(third.timestamp, abs=1e-3), "two readings of two clocks"
        assert third.channel == "classroom"
        assert one.recv(0) is None


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x1ABCDEF0, b"x", extended=True),
        Frame(0x123, remote=True, remote_length=4),
        Frame(0x123, bytes(64), fd=True, brs=True),
        Frame(0x123, bytes(12), fd=True, esi=True),
    ],
)
def test_every_kind_of_frame(frame: Frame) -> None:
    with (
        MsbotBus(fd=True, bitrate=1_000_000, data_bitrate=5_000_000) as one,
        MsbotBus() as other,
    ):
        assert other.protocol is can.CanProtocol.CAN_FD
        one.send(message_of(frame))
        assert heard(other).equals(message_of(frame), timestamp_delta=None, check_channel=False)


def test_filters() -> None:
    with MsbotBus() as one, MsbotBus(can_filters=[{"can_id": 0x200, "can_mask": 0x700}]) as other:
        for can_id in (0x100, 0x234, 0x300, 0x201):
            one.send(message(can_id))
        assert [heard(other).arbitration_id, heard(other).arbitration_id] == [0x234, 0x201]
        assert other.recv(0) is None


def test_when_nobody_acknowledges_the_controller_fills_up_and_sending_fails() -> None:
    with MsbotBus() as lonely:
        for number in range(3):
            lonely.send(message(number))
        with pytest.raises(can.CanTimeoutError, match="3 frames that nobody acknowledges"):
            lonely.send(message(3), timeout=0.01)
        with pytest.raises(can.CanTimeoutError):
            lonely.send(message(3), timeout=0)
        with MsbotBus() as other:
            lonely.send(message(3))  # waits until there is room
            assert [heard(other).arbitration_id for _ in range(4)] == [0, 1, 2, 3]


def test_what_was_sent_last_is_on_the_bus_before_the_controller_leaves_it() -> None:
    with MsbotBus() as other:
        with MsbotBus() as one:
            for number in range(10):
                one.send(message(number))
        assert [heard(other).arbitration_id for _ in range(10)] == list(range(10))


def test_who_listens_only_neither_sends_nor_acknowledges(server: Server) -> None:
    with MsbotBus(listen_only=True) as listener, MsbotBus() as lonely:
        lonely.send(message())
        with lonely._news:
            assert lonely._news.wait_for(lambda: lonely.state is can.BusState.PASSIVE, PATIENCE_S)
        with pytest.raises(can.CanOperationError, match="listen only"):
            listener.send(message())
        with MsbotBus() as other:
            assert bytes(heard(other).data) == bytes(heard(listener).data) == b"hello"


def test_bus_off_and_back(server: Server) -> None:
    with MsbotBus() as bus, MsbotBus() as other:
        server.do(server.driver.short_circuit)
        bus.send(message())
        with bus._news:
            assert bus._news.wait_for(lambda: bus.state is can.BusState.ERROR, PATIENCE_S)
        with pytest.raises(can.CanOperationError, match="bus-off"):
            bus.send(message())
        server.do(server.driver.repair)
        bus.state = can.BusState.ACTIVE
        with bus._news:
            assert bus._news.wait_for(lambda: bus.state is can.BusState.ACTIVE, PATIENCE_S)
        bus.send(message(7))
        assert heard(other).arbitration_id == 7
        with pytest.raises(ValueError, match="listen_only"):
            bus.state = can.BusState.PASSIVE


def test_a_bus_that_ends_is_an_error(server: Server) -> None:
    bus = MsbotBus()
    server.do(server.end.set)
    with pytest.raises(can.CanOperationError, match="'classroom' has ended"):
        bus.recv(PATIENCE_S)
    with pytest.raises(can.CanOperationError, match="has ended"):
        bus.send(message())
    bus.shutdown()
    bus.shutdown()


def test_nobody_waits_for_room_on_a_bus_that_has_ended_or_in_a_controller_that_is_off(server: Server) -> None:
    lonely = MsbotBus()
    for number in range(3):
        lonely.send(message(number))
    server.do(server.driver.short_circuit)
    with lonely._news:
        assert lonely._news.wait_for(lambda: lonely.state is can.BusState.ERROR, PATIENCE_S)
        assert lonely._is_settled()
    with pytest.raises(can.CanOperationError, match="bus-off"):
        lonely.send(message())
    server.do(server.end.set)
    with lonely._news:
        assert lonely._news.wait_for(lambda: bool(lonely._ended), PATIENCE_S)
        lonely._bus_state = BusState.ACTIVE  # whatever was heard last
        assert lonely._is_settled()
    lonely.shutdown()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (can.Message(is_fd=True, data=bytes(8), is_extended_id=False), "no CAN FD frames"),
        (can.Message(is_error_frame=True), "error report"),
        (can.Message(arbitration_id=1, data=bytes(9), is_fd=True, is_extended_id=False, check=False), "9 bytes"),
    ],
)
def test_what_cannot_be_sent_is_refused_here(wrong: can.Message, words: str) -> None:
    with MsbotBus() as bus, pytest.raises(can.CanOperationError, match=words):
        bus.send(wrong)


def test_wrong_names_and_rates_are_explained() -> None:
    with pytest.raises(can.CanInitializationError, match="not a name for a simulated bus"):
        MsbotBus("a/b")
    with MsbotBus(bitrate=125_000):
        with pytest.raises(can.CanInitializationError, match="is CAN, 125 kbit/s, not CAN, 250 kbit/s"):
            MsbotBus(bitrate=250_000)
        assert existing_bus("classroom").bitrate == 125_000, "the bus of the first one goes on"
    assert find_bus("classroom") is None


def test_a_refusal_is_explained(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sim_server, "MAX_PROGRAMS", 0)
    with pytest.raises(can.CanInitializationError, match="refuses this program: too many"):
        MsbotBus()


def test_frames_that_nobody_reads_are_lost_and_said_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(sim_interface, "UNREAD_FRAMES", 2)
    with MsbotBus() as one, MsbotBus() as other:
        for number in range(5):
            one.send(message(number))
        one.send(message(99))
        with one._news:
            assert one._news.wait_for(lambda: not one._outstanding, PATIENCE_S)
        with other._news:
            assert other._news.wait_for(lambda: other._told_overflow, PATIENCE_S)
        assert [heard(other).arbitration_id for _ in range(2)] == [0, 1]
    assert [record.message for record in caplog.records if record.levelno == logging.WARNING] == [
        "simulated bus classroom: nobody calls recv(), frames are lost (said once)"
    ]


def test_a_notifier_and_a_periodic_task_work() -> None:
    with MsbotBus() as other, MsbotBus() as one:  # left in the other order: somebody acknowledges the last frame
        reader = can.BufferedReader()
        with can.Notifier(other, [reader], timeout=0.01):
            task = one.send_periodic(message(), 0.001)
            received = reader.get_message(PATIENCE_S)
            task.stop()
        assert received is not None
        assert bytes(received.data) == b"hello"


def test_a_periodic_task_that_was_stopped_while_it_sent_says_nothing_when_its_bus_is_left(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(sim_interface, "LINGER_S", 0.01)
    with MsbotBus() as lonely:
        for number in range(MAILBOXES):  # nobody acknowledges them: the task waits for room
            lonely.send(message(number))
        sends = threading.Event()
        task = lonely.send_periodic(message(), 0.001, modifier_callback=lambda _: sends.set())
        assert isinstance(task, ThreadBasedCyclicSendTask)
        assert sends.wait(PATIENCE_S)
        task.stop()
    assert task.thread is not None
    task.thread.join(PATIENCE_S)
    assert not task.thread.is_alive()
    assert [record.message for record in caplog.records if record.levelno >= logging.ERROR] == []


def test_who_goes_on_after_leaving_the_bus_is_told() -> None:
    bus = MsbotBus()
    bus.shutdown()
    with pytest.raises(can.CanOperationError, match="'classroom' was shut down"):
        bus.send(message())
    with pytest.raises(can.CanOperationError, match="'classroom' was shut down"):
        bus.recv(0)


def test_logger_and_player_of_python_can_in_processes_of_their_own(tmp_path: Path) -> None:
    log = tmp_path / "frames.log"
    lines = [f"(0.00{number}000) can0 12{number}#0{number}" for number in range(5)]
    log.write_text("\n".join([*lines, "(0.006000) can0 1ABCDEF0#112233", "(0.007000) can0 7FF#R"]) + "\n")
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with MsbotBus() as bus:
        command = [
            sys.executable,
            "-m",
            "can.logger",
            "-i",
            "msbot",
            "-c",
            "classroom",
            "-f",
            str(tmp_path / "out.log"),
        ]
        logger = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        try:
            assert logger.stdout is not None
            while "Connected to MsbotBus: simulated bus classroom" not in logger.stdout.readline():
                assert logger.poll() is None
            player = [sys.executable, "-m", "can.player", "-i", "msbot", "-c", "classroom", str(log)]
            subprocess.run(player, env=environment, check=True, stdout=subprocess.DEVNULL, timeout=60)
            last = None
            while last is None or last.arbitration_id != 0x7FF:
                last = heard(bus)
        finally:
            logger.send_signal(signal.SIGINT)
            logger.communicate(timeout=60)
    written = [parse_log_line(line).frame for line in (tmp_path / "out.log").read_text().splitlines()]
    assert written == [parse_log_line(line).frame for line in log.read_text().splitlines()]
