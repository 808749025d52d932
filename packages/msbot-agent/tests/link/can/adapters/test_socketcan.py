"""The reader and sender of SocketCAN over a pair of local sockets, which keep packets apart as CAN_RAW does."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import struct
from collections.abc import Callable, Coroutine, Sequence
from contextlib import AsyncExitStack

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can.adapters import socketcan
from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.adapters.error_frames import (
    FD_SIZE,
    NO_ACK_WORDS,
    STATE_WORDS,
    WARNING_WORDS,
    pack_frame,
    unpack_frame,
)
from msbot_agent.link.can.adapters.interface import CanInterface
from msbot_agent.link.can.adapters.remedies import NO_KERNEL_SUPPORT, Wanted
from msbot_agent.link.can.adapters.socketcan import (
    KERNEL_FULL,
    NO_FRAME,
    SocketCanAdapter,
    SocketCanChannel,
    pack_filters,
)
from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.filters import IdFilter, master_filters, one_id
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_xrce.errors import LinkDown

CAN0 = CanInterface("can0", 7, is_can=True, is_up=True, mtu=16, kind="can", bitrate=500_000)
FRAME = Frame(0x123, b"\1\2\3")


class CanSocket(socket.socket):
    """A CAN_RAW socket as far as the driver is concerned; it fails when it is told to."""

    send_error: int | None = None
    receive_error: int | None = None
    overflow = 0
    """What the kernel says it has lost so far."""

    def send(self, data: bytes, /) -> int:  # type: ignore[override]
        if self.send_error is not None:
            raise OSError(self.send_error, os.strerror(self.send_error))
        return super().send(data)

    def recvmsg(self, size: int, room: int = 0, /) -> tuple[bytes, list[tuple[int, int, bytes]], int, object]:  # type: ignore[override]
        if self.receive_error is not None:
            number, self.receive_error = self.receive_error, None
            super().recv(size)
            raise OSError(number, os.strerror(number))
        raw, about, flags, address = super().recvmsg(size, room)
        if self.overflow:
            about = [*about, (socket.SOL_SOCKET, 40, struct.pack("=I", self.overflow))]
        return raw, about, flags, address


class Bench:
    """A driver on SocketCAN, the other end of its socket, and what it told."""

    def __init__(self, *, fd: bool = False, error_frames: bool = False, ring_frames: int = 4096) -> None:
        self.interface: CanInterface | None = CAN0
        self.restart_error: int | None = None
        self.restarts: list[int] = []
        self.sockets: list[CanSocket] = []
        self.wires: list[socket.socket] = []
        self.filters: Sequence[IdFilter] | None = None
        adapter = SocketCanAdapter(
            Wanted("can0", fd),
            CanBusInfo("can:can0", 500_000, None, fd),
            filters=[one_id(0x123)],
            error_frames=error_frames,
            find=lambda _: self.interface,
            connect=self.connect,
            restart=self.restart,
        )
        self.driver = CanDriver(adapter, ring_frames=ring_frames)
        self.frames: list[Frame] = []
        self.states: list[tuple[BusState, str]] = []
        self.rooms = 0
        self.driver.attach(frame=lambda frame, _: self.frames.append(frame))
        self.driver.attach(state=lambda state, words, _: self.states.append((state, words)))
        self.driver.attach(room=lambda _: self.count_room())

    def count_room(self) -> None:
        self.rooms += 1

    def connect(self, wanted: Wanted, filters: Sequence[IdFilter] | None) -> socket.socket:
        self.filters = filters
        kind = socket.SOCK_SEQPACKET if hasattr(socket, "AF_CAN") else socket.SOCK_DGRAM
        ours, wire = socket.socketpair(socket.AF_UNIX, kind)
        wire.setblocking(False)
        self.wires.append(wire)
        sock = CanSocket(fileno=ours.detach())
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        self.sockets.append(sock)
        return sock

    def restart(self, index: int) -> None:
        self.restarts.append(index)
        if self.restart_error is not None:
            raise OSError(self.restart_error, os.strerror(self.restart_error))

    @property
    def sock(self) -> CanSocket:
        return self.sockets[-1]

    @property
    def wire(self) -> socket.socket:
        """The other end of the socket that is open."""
        return self.wires[-1]

    def sock_reads(self) -> None:
        """The event loop finds the socket readable."""
        channel = self.driver._channel
        assert isinstance(channel, SocketCanChannel)
        channel._read()

    def hear(self, *frames: Frame) -> None:
        """Frames come in from the bus."""
        for frame in frames:
            self.wire.send(pack_frame(frame))

    def sent(self) -> list[Frame | None]:
        """What has gone out to the bus."""
        raw = []
        try:
            while True:
                raw.append(self.wire.recv(FD_SIZE))
        except BlockingIOError:
            return [unpack_frame(one) for one in raw]

    async def __aenter__(self) -> Bench:
        self._stack = AsyncExitStack()
        tasks = await self._stack.enter_async_context(asyncio.TaskGroup())
        serving = tasks.create_task(self.driver.run())
        self._stack.callback(serving.cancel)
        await asyncio.sleep(0)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()
        assert all(sock.fileno() < 0 for sock in self.sockets)
        for wire in self.wires:
            wire.close()


def with_bench(
    test: Callable[[Bench], Coroutine[object, object, None]], *, fd: bool = False, error_frames: bool = False
) -> None:
    async def main() -> None:
        async with Bench(fd=fd, error_frames=error_frames) as bench:
            await test(bench)

    run_virtual(main())


def test_frames_come_in_and_go_out() -> None:
    async def test(bench: Bench) -> None:
        frames = [FRAME, Frame(0x1E000001, bytes(8), extended=True), Frame(0x123, remote=True, remote_length=2)]
        bench.hear(*frames)
        await asyncio.sleep(0.1)
        assert bench.frames == frames
        for frame in frames:
            bench.driver.send(frame)
        assert bench.sent() == frames
        assert bench.filters == [one_id(0x123)]

    with_bench(test)


def test_fd_frames_come_in_and_go_out() -> None:
    async def test(bench: Bench) -> None:
        frame = Frame(0x101, bytes(64), fd=True, brs=True)
        bench.hear(frame, FRAME)
        bench.driver.send(frame)
        await asyncio.sleep(0.1)
        assert bench.frames == [frame, FRAME]
        assert bench.sent() == [frame]

    bench_interface = CanInterface("can0", 7, is_can=True, is_up=True, mtu=72, kind="can")

    async def main() -> None:
        bench = Bench(fd=True)
        bench.interface = bench_interface
        async with bench:
            await test(bench)

    run_virtual(main())


def test_a_burst_is_read_to_its_end_in_one_turn() -> None:
    async def test(bench: Bench) -> None:
        frames = [Frame(0x100, bytes((number,))) for number in range(100)]
        bench.hear(*frames)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert bench.frames == frames

    with_bench(test)


def test_the_kernel_keeps_what_the_ring_cannot_take() -> None:
    async def main() -> None:
        async with Bench(ring_frames=300) as bench:
            burst = [Frame(0x100, number.to_bytes(2)) for number in range(400)]
            bench.driver.take(burst[:300], 0.0)
            bench.hear(*burst[300:])
            await asyncio.sleep(0.1)
            assert bench.frames == burst
            assert bench.driver.dropped == {}

    run_virtual(main())


def test_a_full_ring_leaves_everything_in_the_kernel() -> None:
    async def main() -> None:
        async with Bench(ring_frames=300) as bench:
            burst = [Frame(0x100, number.to_bytes(2)) for number in range(310)]
            bench.driver.take(burst[:300], 0.0)
            bench.hear(*burst[300:])
            bench.sock_reads()  # as the event loop may do before the ring has its turn
            assert bench.frames == []
            await asyncio.sleep(0.1)
            assert bench.frames == burst

    run_virtual(main())


def test_what_the_kernel_lost_is_counted() -> None:
    async def test(bench: Bench) -> None:
        for total in (3, 3, 10):
            bench.sock.overflow = total
            bench.hear(FRAME)
            await asyncio.sleep(0.1)
        assert bench.driver.dropped == {KERNEL_FULL: 10}
        assert bench.frames == 3 * [FRAME]

    with_bench(test)


def test_what_is_no_frame_is_counted() -> None:
    async def test(bench: Bench) -> None:
        bench.wire.send(b"abc")
        bench.hear(FRAME)
        await asyncio.sleep(0.1)
        assert bench.frames == [FRAME]
        assert bench.driver.dropped == {NO_FRAME: 1}

    with_bench(test)


def test_a_full_send_buffer_ends_when_the_socket_can_be_written_again() -> None:
    async def test(bench: Bench) -> None:
        frames: list[Frame] = []
        while bench.driver.has_room():
            frames.append(Frame(0x100, len(frames).to_bytes(2)))
            bench.driver.send(frames[-1])
        assert bench.driver.pending() == 1
        assert bench.rooms == 0
        assert bench.sent() == frames[:-1]
        await asyncio.sleep(0.1)
        assert (bench.rooms, bench.sent()) == (1, frames[-1:])
        assert bench.driver.has_room()

    with_bench(test)


def test_a_full_queue_of_the_interface_is_tried_again_after_a_moment() -> None:
    async def test(bench: Bench) -> None:
        bench.sock.send_error = errno.ENOBUFS
        bench.driver.send(FRAME)
        assert not bench.driver.has_room()
        await asyncio.sleep(0.1)
        assert bench.rooms == 0
        bench.sock.send_error = None
        await asyncio.sleep(2 * socketcan.AGAIN_S)
        assert (bench.rooms, bench.sent()) == (1, [FRAME])

    with_bench(test)


def test_a_link_that_is_closed_tries_nothing_again_and_tells_nothing() -> None:
    async def main() -> None:
        async with Bench() as bench:
            bench.sock.send_error = errno.ENOBUFS
            bench.driver.send(FRAME)
        told = len(bench.states)
        await asyncio.sleep(1)
        assert (bench.rooms, len(bench.states)) == (0, told)

    run_virtual(main())


def error_frame(classes: int, data: str = "") -> Frame:
    return Frame(classes, bytes.fromhex(data).ljust(8, b"\0"), error=True)


def test_reports_of_the_controller_become_states_and_counts() -> None:
    async def test(bench: Bench) -> None:
        bench.hear(
            FRAME, error_frame(0x04, "0008"), FRAME, error_frame(0x20), error_frame(0x04, "0020"), error_frame(0x40)
        )
        await asyncio.sleep(0.1)
        assert bench.states[2:] == [
            (BusState.ACTIVE, WARNING_WORDS),
            (BusState.PASSIVE, STATE_WORDS[BusState.PASSIVE]),
            (BusState.OFF, STATE_WORDS[BusState.OFF]),
        ]
        assert bench.frames == [FRAME, FRAME]
        assert bench.driver.dropped == {NO_ACK_WORDS: 1}

    with_bench(test)


def test_tools_get_the_reports_as_frames_too() -> None:
    async def test(bench: Bench) -> None:
        report = error_frame(0x02, "05")
        bench.hear(report, FRAME)
        await asyncio.sleep(0.1)
        assert bench.frames == [report, FRAME]

    with_bench(test, error_frames=True)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENETDOWN, "the interface can0 is down: `sudo ip link set can0 up type can bitrate 500000` brings it up"),
        (errno.ENODEV, "the interface can0 has vanished: plug the adapter in again"),
        (errno.ENXIO, "the interface can0 has vanished: plug the adapter in again"),
        (errno.EIO, "the interface can0 failed: Input/output error"),
    ],
)
@pytest.mark.parametrize("sending", [False, True])
def test_a_lost_interface_is_told_in_words_and_used_again(number: int, words: str, sending: bool) -> None:
    async def test(bench: Bench) -> None:
        if sending:
            bench.sock.send_error = number
            bench.driver.send(FRAME)
        else:
            bench.hear(FRAME)
            bench.sock.receive_error = number
        bench.interface = None
        await asyncio.sleep(0.05)
        assert bench.states[-1] == (BusState.GONE, words)
        await asyncio.sleep(5)
        bench.interface = CAN0
        await asyncio.sleep(1)
        assert bench.states[-1] == (BusState.ACTIVE, "back")
        bench.driver.send(FRAME)
        bench.hear(FRAME)
        await asyncio.sleep(0.1)
        assert bench.sent() == [FRAME]
        assert bench.frames == [FRAME]

    with_bench(test)


def off(bench: Bench) -> None:
    bench.interface = CanInterface("can0", 7, is_can=True, is_up=True, mtu=16, kind="can", state=BusState.OFF)
    bench.hear(error_frame(0x40))


def test_after_bus_off_the_kernel_is_asked_for_a_restart() -> None:
    async def test(bench: Bench) -> None:
        off(bench)
        await asyncio.sleep(0.1)
        bench.driver.restart()
        await asyncio.sleep(0.1)
        assert bench.restarts == [7]
        assert bench.states[-1] == (BusState.ACTIVE, "back on the bus")

    with_bench(test)


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.EPERM, "this program may not restart it: `sudo ip link set can0 type can restart` does"),
        (errno.EOPNOTSUPP, "its driver cannot restart: `sudo ip link set can0 down && sudo ip link set can0 up` does"),
    ],
)
def test_a_restart_that_is_refused_comes_with_advice_and_leaves_it_off(number: int, advice: str) -> None:
    async def test(bench: Bench) -> None:
        bench.restart_error = number
        off(bench)
        await asyncio.sleep(0.1)
        told = len(bench.states)
        bench.driver.restart()
        await asyncio.sleep(0.1)
        ((state, words),) = bench.states[told:]
        assert state is BusState.OFF
        assert advice in words
        assert not bench.driver.has_room()

    with_bench(test)


def test_where_the_kernel_restarts_by_itself_it_is_left_to_it() -> None:
    async def test(bench: Bench) -> None:
        off(bench)
        await asyncio.sleep(0.1)
        bench.interface = CanInterface("can0", 7, is_can=True, is_up=True, mtu=16, state=BusState.OFF, restart_ms=100)
        bench.driver.restart()
        await asyncio.sleep(0.1)
        assert bench.restarts == []
        assert bench.states[-1] == (BusState.OFF, STATE_WORDS[BusState.OFF])
        bench.interface = CAN0
        bench.hear(error_frame(0x100))
        await asyncio.sleep(0.1)
        assert bench.states[-1] == (BusState.ACTIVE, "back on the bus")

    with_bench(test)


def test_somebody_else_may_have_restarted_it() -> None:
    async def test(bench: Bench) -> None:
        off(bench)
        await asyncio.sleep(0.1)
        bench.interface = CanInterface("can0", 7, is_can=True, is_up=True, mtu=16, state=BusState.PASSIVE)
        bench.driver.restart()
        await asyncio.sleep(0.1)
        assert bench.restarts == []
        assert bench.states[-1][0] is BusState.PASSIVE

    with_bench(test)


def test_a_controller_that_is_passive_at_the_start_can_send_as_soon_as_that_is_told() -> None:
    async def main() -> None:
        bench = Bench()
        bench.interface = CanInterface("can0", 7, is_can=True, is_up=True, mtu=16, state=BusState.PASSIVE)
        bench.driver.attach(state=lambda state, *_: bench.driver.send(FRAME) if state is BusState.PASSIVE else None)
        async with bench:
            assert bench.sent() == [FRAME]

    run_virtual(main())


def test_a_controller_that_is_off_at_the_start_is_told_at_once() -> None:
    async def main() -> None:
        bench = Bench()
        bench.interface = CanInterface("can0", 7, is_can=True, is_up=True, mtu=16, state=BusState.OFF)
        async with bench:
            assert [state for state, _ in bench.states] == [BusState.GONE, BusState.OFF]
            assert not bench.driver.has_room()

    run_virtual(main())


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EAFNOSUPPORT, NO_KERNEL_SUPPORT),
        (errno.ENODEV, "there is no interface can0"),
        (errno.EMFILE, "cannot use the interface can0: Too many open files"),
    ],
)
def test_a_socket_that_cannot_be_opened_is_an_error_with_a_remedy(number: int, words: str) -> None:
    def connect(wanted: Wanted, filters: Sequence[IdFilter] | None) -> socket.socket:
        raise OSError(number, os.strerror(number))

    adapter = SocketCanAdapter(Wanted("can0"), CanBusInfo("can:can0", None), find=lambda _: CAN0, connect=connect)
    with pytest.raises(LinkDown) as caught:
        run_virtual(CanDriver(adapter).run())
    assert str(caught.value).startswith(f"can:can0: {words}")


def test_an_interface_that_cannot_be_used_as_wanted_is_an_error() -> None:
    adapter = SocketCanAdapter(Wanted("can0", fd=True), CanBusInfo("can:can0", None, fd=True), find=lambda _: CAN0)
    with pytest.raises(
        LinkDown, match=r"can:can0: CAN FD is asked for, but the interface can0 takes classic frames only \(mtu 16\)"
    ):
        run_virtual(CanDriver(adapter).run())


def test_on_other_systems_the_way_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(_: str) -> CanInterface | None:
        raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")

    monkeypatch.delattr(socket, "AF_CAN", raising=False)
    adapter = SocketCanAdapter(Wanted("can0"), CanBusInfo("can:can0", None), find=find)
    with pytest.raises(LinkDown, match=r"SocketCAN is a part of Linux: .* python-can, for example `can:slcan:COM3"):
        run_virtual(CanDriver(adapter).run())


def test_filters_are_packed_as_struct_can_filter() -> None:
    packed = pack_filters([one_id(0x123), IdFilter(0x1E000000, 0x1F000000, extended=True)])
    assert struct.unpack("=4I", packed) == (0x123, 0xC00007FF, 0x9E000000, 0xDF000000)
    assert len(pack_filters(master_filters(CanIds()))) // 8 <= 512  # CAN_RAW_FILTER_MAX
