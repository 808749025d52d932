"""Buses of python-can: its virtual one, and some made here that do what the test says."""

from __future__ import annotations

import asyncio
import importlib.util
import socket
import threading
from contextlib import AsyncExitStack

import pytest
from hypothesis import given, settings

import can
from msbot_agent.link.can.adapters import python_can
from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.adapters.python_can import MAILBOXES, PythonCanAdapter, frame_of, message_of
from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.errors import LinkDown
from tests.link.can.adapters.test_socketcan_frames import frames

FRAME = Frame(0x123, b"\1\2\3")
FD_FRAME = Frame(0x1234567, bytes(64), extended=True, fd=True, brs=True)
PATIENCE_S = 60.0


@given(frames())
@settings(deadline=None)
def test_a_frame_survives_python_cans_message(frame: Frame) -> None:
    if not frame.error and not frame.long_dlc:  # python-can knows no data length codes beyond 8
        assert frame_of(message_of(frame)) == frame


class Node:
    """A driver on a bus of python-can, and what it told."""

    def __init__(self, interface: str, channel: str, *, fd: bool = False, error_frames: bool = False) -> None:
        info = CanBusInfo(f"can:{interface}:{channel}", 500_000, None, fd)
        self.driver = CanDriver(PythonCanAdapter(interface, channel, info, {}, error_frames=error_frames))
        self.frames: asyncio.Queue[Frame] = asyncio.Queue()
        self.states: asyncio.Queue[tuple[BusState, str]] = asyncio.Queue()
        self.rooms: asyncio.Queue[float] = asyncio.Queue()
        self.driver.attach(frame=lambda frame, _: self.frames.put_nowait(frame))
        self.driver.attach(state=lambda state, words, _: self.states.put_nowait((state, words)))
        self.driver.attach(room=self.rooms.put_nowait)

    async def __aenter__(self) -> Node:
        self._stack = AsyncExitStack()
        await self._stack.enter_async_context(asyncio.timeout(PATIENCE_S))
        tasks = await self._stack.enter_async_context(asyncio.TaskGroup())
        serving = tasks.create_task(self.driver.run())
        self._stack.callback(serving.cancel)
        while (await self.states.get())[0] is not BusState.ACTIVE:
            pass
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()


async def test_frames_travel_over_the_virtual_bus_with_a_thread_that_reads() -> None:
    async with Node("virtual", "travel", fd=True) as one, Node("virtual", "travel", fd=True) as other:
        for frame in (FRAME, FD_FRAME, Frame(0x7, remote=True, remote_length=4)):
            one.driver.send(frame)
            assert await other.frames.get() == frame
        other.driver.send(FRAME)
        assert await one.frames.get() == FRAME
        assert other.frames.empty()  # nobody hears itself


async def test_few_frames_are_handed_over_at_a_time_and_each_that_leaves_is_told() -> None:
    async with Node("virtual", "room") as one, Node("virtual", "room") as other:
        sent = [Frame(0x100, bytes((number,))) for number in range(MAILBOXES + 1)]
        for frame in sent:
            assert one.driver.has_room()
            one.driver.send(frame)
        assert not one.driver.has_room()
        assert one.driver.pending() == MAILBOXES + 1
        for frame in sent:
            assert await other.frames.get() == frame
        while one.driver.pending():
            await one.rooms.get()
        assert one.driver.has_room()


async def test_threads_end_with_the_link() -> None:
    async with Node("virtual", "threads"):
        assert any(thread.name == "msbot-can" for thread in threading.enumerate())
    assert not any(thread.name == "msbot-can" for thread in threading.enumerate())


class SocketBus(can.BusABC):
    """A bus that can be waited for: datagrams of a local socket, one octet each, are frames of one octet."""

    def __init__(self, channel: str, **settings: object) -> None:
        super().__init__(channel)
        self.settings = {"channel": channel, **settings}
        self.ours, self.wire = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.ours.setblocking(False)
        self.trouble: Exception | None = None
        self.send_trouble: Exception | None = None
        self.refusals = 0

    def fileno(self) -> int:
        return self.ours.fileno()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            data = self.ours.recv(9)
        except BlockingIOError:
            return None, False
        if self.trouble is not None:
            raise self.trouble
        kind = {b"E": 0x40, b"W": 0x24}.get(data[:1])
        if kind is not None:
            return can.Message(
                arbitration_id=kind, data=b"\0\x08" + bytes(6), is_error_frame=True, is_extended_id=False
            ), False
        return can.Message(arbitration_id=0x100, data=data, is_extended_id=False, is_rx=data != b"own"), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.send_trouble is not None:
            raise self.send_trouble
        if self.refusals:
            self.refusals -= 1
            raise can.CanOperationError("transmit buffer full")
        self.ours.send(bytes(msg.data))

    def shutdown(self) -> None:
        super().shutdown()
        self.ours.close()
        self.wire.close()


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[SocketBus]:
    """Every bus that python-can is asked for is a `SocketBus`; the list has them all."""
    buses: list[SocketBus] = []

    def make(channel: str, interface: str, *, ignore_config: bool, **settings: object) -> SocketBus:
        assert ignore_config
        if any(bus.trouble for bus in buses[-1:]) and len(buses) < 3:
            buses.append(SocketBus(channel))
            buses[-1].shutdown()
            raise can.CanInitializationError("not there yet")
        buses.append(SocketBus(channel, interface=interface, **settings))
        return buses[-1]

    monkeypatch.setattr(can, "Bus", make)
    return buses


async def test_a_bus_that_can_be_waited_for_is_read_in_the_event_loop(made: list[SocketBus]) -> None:
    async with Node("made", "3") as node:
        assert made[0].settings == {"channel": 3, "interface": "made", "bitrate": 500_000}
        assert [thread.name for thread in threading.enumerate()].count("msbot-can") == 1  # the one that sends
        made[0].wire.send(b"own")
        made[0].wire.send(b"a")
        made[0].wire.send(b"b")
        assert await node.frames.get() == Frame(0x100, b"a")
        assert await node.frames.get() == Frame(0x100, b"b")


async def test_where_the_event_loop_cannot_wait_for_it_a_thread_reads(
    made: list[SocketBus], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise NotImplementedError  # as the usual event loop of Windows

    monkeypatch.setattr(asyncio.get_running_loop(), "add_reader", refuse)
    async with Node("made", "0") as node:
        made[0].wire.send(b"a")
        assert await node.frames.get() == Frame(0x100, b"a")


async def test_reports_of_the_adapter_become_states_and_a_restart_opens_it_anew(made: list[SocketBus]) -> None:
    async with Node("made", "0") as node:
        made[0].wire.send(b"W")
        state, words = await node.states.get()
        assert state is BusState.ACTIVE
        assert words.startswith("error-warning")
        assert list(node.driver.dropped) == ["nobody acknowledges: no other node is on the bus, or at another bit rate"]
        made[0].wire.send(b"E")
        assert (await node.states.get())[0] is BusState.OFF
        node.driver.restart()
        assert (await node.states.get())[0] is BusState.GONE
        assert await node.states.get() == (BusState.ACTIVE, "back")
        assert len(made) == 2


async def test_tools_get_reports_as_frames_too(made: list[SocketBus]) -> None:
    async with Node("made", "0", error_frames=True) as node:
        made[0].wire.send(b"W")
        frame = await node.frames.get()
        assert (frame.error, frame.can_id) == (True, 0x24)


async def test_an_adapter_that_was_pulled_out_is_opened_again(made: list[SocketBus]) -> None:
    async with Node("made", "0") as node:
        made[0].trouble = can.CanOperationError("no such device")
        made[0].wire.send(b"x")
        assert await node.states.get() == (BusState.GONE, "the adapter has gone: no such device")
        assert await node.states.get() == (BusState.ACTIVE, "back")
        assert len(made) == 3  # once in vain
        made[2].wire.send(b"y")
        assert await node.frames.get() == Frame(0x100, b"y")


async def test_a_frame_that_the_adapter_does_not_take_is_sent_again(made: list[SocketBus]) -> None:
    async with Node("made", "0") as node:
        made[0].refusals = 3
        node.driver.send(FRAME)
        await node.rooms.get()
        assert (made[0].refusals, made[0].wire.recv(9)) == (0, b"\1\2\3")


async def test_an_adapter_that_takes_nothing_for_long_is_opened_anew(
    made: list[SocketBus], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(python_can, "GIVE_UP_S", 0.0)
    async with Node("made", "0") as node:
        made[0].send_trouble = can.CanOperationError("transmit buffer full")
        node.driver.send(FRAME)
        assert await node.states.get() == (BusState.GONE, "the adapter takes no frames: transmit buffer full")
        assert (await node.states.get())[0] is BusState.ACTIVE
        node.driver.send(FRAME)
        await node.rooms.get()
        assert made[-1].wire.recv(9) == b"\1\2\3"


async def test_whatever_else_a_library_raises_is_told(made: list[SocketBus]) -> None:
    async with Node("made", "0") as node:
        made[0].send_trouble = ZeroDivisionError("in the driver")
        node.driver.send(FRAME)
        assert await node.states.get() == (BusState.GONE, "the adapter takes no frames: in the driver")


class ThreadBus(SocketBus):
    def fileno(self) -> int:
        raise NotImplementedError

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.ours.settimeout(timeout)
        try:
            return super()._recv_internal(timeout)
        except TimeoutError:
            return None, False


async def test_a_thread_that_reads_tells_of_a_pulled_adapter_and_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    buses: list[ThreadBus] = []

    def make(channel: str, interface: str, **_: object) -> ThreadBus:
        buses.append(ThreadBus(channel))
        return buses[-1]

    monkeypatch.setattr(can, "Bus", make)
    monkeypatch.setattr(python_can, "RING_FRAMES", 0)
    async with Node("made", "0") as node:
        buses[0].wire.send(b"x")
        buses[0].wire.send(b"E")
        buses[0].trouble = OSError(19, "No such device")
        buses[0].wire.send(b"x")
        assert await node.states.get() == (BusState.GONE, "the adapter has gone: [Errno 19] No such device")
        assert node.frames.empty()


def opening(interface: str, channel: str, *, info: CanBusInfo | None = None) -> str:
    """What a user reads when that bus cannot be opened."""
    adapter = PythonCanAdapter(interface, channel, info or CanBusInfo("can:x", None), {})
    with pytest.raises(LinkDown) as caught:
        asyncio.run(CanDriver(adapter).run())
    return str(caught.value)


def test_an_unknown_interface_is_told_with_those_there_are() -> None:
    words = opening("nonsense", "0")
    assert words.startswith("can:x: python-can knows no interface 'nonsense'; it knows ")
    assert "slcan" in words


def test_a_bus_that_cannot_be_opened_says_why() -> None:
    words = opening("socketcan", "msbot-absent")
    assert words.startswith("can:x: socketcan msbot-absent cannot be opened: ")


def test_a_library_that_an_interface_needs_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def make(*_: object, **__: object) -> can.BusABC:
        raise can.CanInterfaceNotImplementedError("The serial module is not installed")

    monkeypatch.setattr(can, "Bus", make)
    assert opening("slcan", "/dev/ttyACM0") == (
        "can:x: the interface slcan of python-can needs `pip install 'python-can[serial]'` "
        "(The serial module is not installed)"
    )


def test_a_driver_that_is_missing_on_this_system_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def make(*_: object, **__: object) -> can.BusABC:
        raise OSError("PCBUSB library not found")

    monkeypatch.setattr(can, "Bus", make)
    assert opening("pcan", "PCAN_USBBUS1") == (
        "can:x: pcan PCAN_USBBUS1 cannot be opened: PCBUSB library not found; it needs the driver PCAN-Basic of "
        "PEAK-System"
    )


def test_a_driver_that_is_there_is_not_blamed_for_a_wrong_number(monkeypatch: pytest.MonkeyPatch) -> None:
    def make(*_: object, **__: object) -> can.BusABC:
        raise ValueError("Invalid bitrate.")

    monkeypatch.setattr(can, "Bus", make)
    assert opening("pcan", "PCAN_USBBUS1") == "can:x: pcan PCAN_USBBUS1 cannot be opened: Invalid bitrate"


def test_without_python_can_the_command_that_brings_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(name: str, package: str | None = None) -> None:
        assert (name, package) == ("can", None)

    monkeypatch.setattr(importlib.util, "find_spec", find)
    assert opening("slcan", "/dev/ttyACM0") == (
        "can:x: this adapter needs the library python-can: `pip install 'msbot-agent[can]'` brings it"
    )


def timing_of(clock: int, bitrate: int, data_bitrate: int) -> can.BitTimingFd:
    """With all sample points at 80 %."""
    return can.BitTimingFd.from_sample_point(clock, bitrate, 80.0, data_bitrate, 80.0)


@pytest.mark.parametrize(
    ("interface", "info", "expected"),
    [
        (
            "kvaser",
            CanBusInfo("", 500_000, 2_000_000, fd=True),
            {"fd": True, "bitrate": 500_000, "data_bitrate": 2_000_000},
        ),
        ("kvaser", CanBusInfo("", 500_000, None, fd=True), {"fd": True, "bitrate": 500_000}),
        (
            "pcan",
            CanBusInfo("", 500_000, 2_000_000, fd=True),
            {"fd": True, "timing": timing_of(80_000_000, 500_000, 2_000_000)},
        ),
        (
            "pcan",
            CanBusInfo("", 500_000, None, fd=True),
            {"fd": True, "timing": timing_of(80_000_000, 500_000, 500_000)},
        ),
        ("pcan", CanBusInfo("", None, None, fd=True), {"fd": True}),
        (
            "slcan",
            CanBusInfo("", 250_000, 1_000_000, fd=True),
            {"fd": True, "timing": timing_of(8_000_000, 250_000, 1_000_000)},
        ),
        ("virtual", CanBusInfo("", None, None, fd=True), {"protocol": can.CanProtocol.CAN_FD}),
        ("gs_usb", CanBusInfo("", 500_000), {"bitrate": 500_000}),
        ("vector", CanBusInfo("", None), {}),
    ],
)
async def test_rates_are_given_as_each_interface_wants_them(
    interface: str, info: CanBusInfo, expected: dict[str, object], made: list[SocketBus]
) -> None:
    driver = CanDriver(PythonCanAdapter(interface, "0", info, {}))
    opened = asyncio.Event()
    driver.attach(state=lambda state, *_: opened.set() if state is BusState.ACTIVE else None)
    async with asyncio.timeout(PATIENCE_S), asyncio.TaskGroup() as tasks:
        serving = tasks.create_task(driver.run())
        await opened.wait()
        serving.cancel()
    assert made[0].settings == {"channel": 0, "interface": interface, **expected}


async def test_a_bus_that_opens_after_the_end_is_closed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    may_open, opened = threading.Event(), threading.Event()
    buses: list[SocketBus] = []

    def make(channel: str, *_: object, **__: object) -> SocketBus:
        opened.set()
        may_open.wait(PATIENCE_S)
        buses.append(SocketBus(channel))
        return buses[-1]

    monkeypatch.setattr(can, "Bus", make)
    driver = CanDriver(PythonCanAdapter("made", "0", CanBusInfo("can:x", None), {}))
    serving = asyncio.ensure_future(driver.run())
    await asyncio.to_thread(opened.wait, PATIENCE_S)
    serving.cancel()
    await asyncio.wait([serving])
    may_open.set()
    async with asyncio.timeout(PATIENCE_S):
        while not buses or buses[0].ours.fileno() >= 0:
            await asyncio.to_thread(may_open.wait, 0)
    assert serving.cancelled()


@pytest.mark.parametrize("refusals", [0, 3, 10**9])
def test_a_frame_that_is_refused_is_tried_again_after_a_pause_until_it_is_given_up(
    refusals: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Adapter:
        """Refuses so often; each try takes a while."""

        now, tries = 0.0, 0
        paused: list[float] = []  # noqa: RUF012 - made anew for each test

        def monotonic(self) -> float:
            return self.now

        def send(self, message: can.Message, timeout: float) -> None:
            self.tries += 1
            self.now += 0.01
            if self.tries <= refusals:
                raise can.CanOperationError("no room")

        def is_set(self) -> bool:
            return False

        def wait(self, pause_s: float) -> None:
            self.now += pause_s
            self.paused.append(pause_s)

    adapter = Adapter()
    monkeypatch.setattr(python_can, "time", adapter)
    channel = python_can.PythonCanChannel.__new__(python_can.PythonCanChannel)
    channel._bus = channel._stop = adapter  # type: ignore[assignment]
    error = channel._send_one(message_of(FRAME))
    assert set(adapter.paused) <= {python_can.AGAIN_S}
    assert len(adapter.paused) == adapter.tries - 1, "a pause after each refusal but the last"
    if refusals > 3:
        assert isinstance(error, can.CanOperationError)
        assert python_can.GIVE_UP_S <= adapter.now <= python_can.GIVE_UP_S + 0.01 + python_can.AGAIN_S
    else:
        assert (error, adapter.tries) == (None, refusals + 1)
