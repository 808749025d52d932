"""SocketCAN: the CAN interfaces of Linux, by raw sockets of the standard library.

Theory of operation. The event loop's reader call-back reads frames until the kernel has no more, and hands them over in
one go. Frames are sent at once; the socket's send buffer is kept as small as the kernel allows, so that few frames wait
behind it where nothing can overtake them. After EAGAIN (the buffer is full), the socket reports when it can be written
again. After ENOBUFS (the interface's queue is full because several programs send), it does not, so sending is retried
after a moment. The kernel reports a lost interface once, with ENETDOWN or ENODEV; the driver then reopens it when it is
up again.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
from collections.abc import Callable, Sequence
from struct import Struct
from typing import Final

from msbot_agent.link.can.adapters.can_driver import ChannelOwner
from msbot_agent.link.can.adapters.error_frames import (
    BACK_WORDS,
    EXTENDED,
    FD_SIZE,
    ID_MASK,
    REMOTE,
    STATE_WORDS,
    pack_frame,
    read_report,
    unpack_frame,
)
from msbot_agent.link.can.adapters.interface import CanInterface, can_interfaces, find_interface, restart_controller
from msbot_agent.link.can.adapters.remedies import ELSEWHERE, Wanted, open_error, restart_advice, up_commands, why_not
from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.filters import IdFilter
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.errors import LinkDown

RECEIVE_BUFFER: Final = 4 << 20
"""Octets asked for; the kernel gives at most `net.core.rmem_max`, unless the program may ask for more."""
SEND_BUFFER: Final = 1
"""Octets asked for: the kernel takes its smallest, about six frames."""
AGAIN_S: Final = 0.002
"""Pause before a retry after ENOBUFS: eight frames at 500 kbit/s."""

KERNEL_FULL: Final = "the computer is too slow for this bus: the kernel's receive buffer was full"
NO_FRAME: Final = "the kernel gave something that is not a frame"

_FILTER: Final = Struct("=II")
_COUNT: Final = Struct("=I")
_ERR_FILTER: Final = 2  # CAN_RAW_ERR_FILTER: missing in Python's socket module
_RECEIVE_BUFFER_FORCE: Final = 33  # SO_RCVBUFFORCE
_OVERFLOW: Final = 40  # SO_RXQ_OVFL
_OVERFLOW_ROOM: Final = 64
_VANISHED: Final = (errno.ENODEV, errno.ENXIO)


class SocketCanAdapter:
    """One CAN interface of Linux. Satisfies `Adapter`."""

    def __init__(
        self,
        wanted: Wanted,
        info: CanBusInfo,
        *,
        filters: Sequence[IdFilter] | None = None,
        error_frames: bool = False,
        find: Callable[[str], CanInterface | None] = find_interface,
        connect: Callable[[Wanted, Sequence[IdFilter] | None], socket.socket] | None = None,
        restart: Callable[[int], None] = restart_controller,
    ) -> None:
        """Name an interface; it is opened by the driver.

        Args:
            wanted: the interface, and how it is to be used.
            info: what the driver says about it.
            filters: which frames to receive; None = all.
            error_frames: hand the controller's reports over as frames, too (for tools that show them).
            find: asks the kernel for an interface.
            connect: opens a socket; a kernel socket if absent.
            restart: asks the kernel to restart the controller of that index.
        """
        self.info = info
        self.wanted = wanted
        self.error_frames = error_frames
        self.find = find
        self.restart = restart
        self._filters = filters
        self._connect = connect or open_socket

    async def open(self, owner: ChannelOwner) -> SocketCanChannel:
        """See `Adapter`."""
        wanted, name = self.wanted, self.info.name
        if not hasattr(socket, "AF_CAN"):
            # Checked first: on other systems, advice to run Linux commands would be of no use.
            raise LinkDown(f"{name}: {ELSEWHERE}")
        try:
            found = self.find(wanted.name)
        except OSError as error:
            raise LinkDown(f"{name}: {open_error(wanted, error)}") from error
        problem = why_not(wanted, found, can_interfaces() if found is None or not found.is_can else [])
        if problem or found is None:
            raise LinkDown(f"{name}: {problem}")
        try:
            sock = self._connect(wanted, self._filters)
        except OSError as error:
            raise LinkDown(f"{name}: {open_error(wanted, error)}") from error
        channel = SocketCanChannel(self, sock, found, owner)
        if found.state in (BusState.OFF, BusState.PASSIVE):
            owner.state(channel, found.state, STATE_WORDS[found.state], asyncio.get_running_loop().time())
        return channel


class SocketCanChannel:
    """An open CAN_RAW socket. Satisfies `Channel`."""

    def __init__(
        self, adapter: SocketCanAdapter, sock: socket.socket, found: CanInterface, owner: ChannelOwner
    ) -> None:
        """Serve a socket that is open, non-blocking and bound."""
        self._adapter = adapter
        self._socket = sock
        self._found = found
        self._owner = owner
        self._loop = asyncio.get_running_loop()
        self._again: asyncio.TimerHandle | None = None
        self._is_writing = False
        self._lost_by_kernel = 0
        self._closed = False
        self._loop.add_reader(sock, self._read)

    def send(self, frame: Frame) -> bool:
        """See `Channel`."""
        try:
            self._socket.send(pack_frame(frame))
        except BlockingIOError:
            self._wait_for_writing()
            return False
        except OSError as error:
            if error.errno == errno.ENOBUFS:
                self._again = self._again or self._loop.call_later(AGAIN_S, self._try_again)
            else:
                self._loop.call_soon(self._fail, error)
            return False
        return True

    def pending(self) -> int:
        """See `Channel`: the kernel does not say."""
        return 0

    def restart(self) -> None:
        """See `Channel`."""
        self._loop.call_soon(self._restart)

    async def close(self) -> None:
        """See `Channel`."""
        self._closed = True
        if self._again is not None:
            self._again.cancel()
        self._loop.remove_reader(self._socket)
        self._loop.remove_writer(self._socket)
        self._socket.close()

    def _read(self) -> None:
        now = self._loop.time()
        most = self._owner.free_slots()
        if not most:
            return  # the kernel keeps the rest, and counts what it cannot keep
        frames: list[Frame] = []
        read, failure = self._socket.recv, None
        try:
            raw, about, _, _ = self._socket.recvmsg(FD_SIZE, _OVERFLOW_ROOM)
            if about:
                self._count_lost(about, now)
            while True:
                frame = unpack_frame(raw)
                if frame is None:
                    self._owner.events((NO_FRAME,), now)
                elif frame.error:
                    self._report(frame, frames, now)
                else:
                    frames.append(frame)
                most -= 1
                if not most:
                    break
                raw = read(FD_SIZE)
        except BlockingIOError:
            pass
        except OSError as error:
            failure = error
        if frames:
            self._owner.take(frames, now)
        if failure is not None:
            self._fail(failure)

    def _report(self, frame: Frame, frames: list[Frame], now: float) -> None:
        report = read_report(frame.can_id, frame.data)
        if self._adapter.error_frames:
            frames.append(frame)
        if report.events:
            self._owner.events(report.events, now)
        if report.state is not None:
            if frames:  # frames that came before the change
                self._owner.take(frames.copy(), now)
                frames.clear()
            self._owner.state(self, report.state, report.words, now)

    def _count_lost(self, about: list[tuple[int, int, bytes]], now: float) -> None:
        for level, kind, content in about:
            if level == socket.SOL_SOCKET and kind == _OVERFLOW and len(content) >= _COUNT.size:
                total = _COUNT.unpack_from(content)[0]
                self._owner.events((KERNEL_FULL,), now, times=total - self._lost_by_kernel & 0xFFFFFFFF)
                self._lost_by_kernel = total

    def _wait_for_writing(self) -> None:
        if not self._is_writing:
            self._is_writing = True
            self._loop.add_writer(self._socket, self._writable)

    def _writable(self) -> None:
        self._is_writing = False
        self._loop.remove_writer(self._socket)
        self._owner.room_available(self, self._loop.time())

    def _try_again(self) -> None:
        self._again = None
        self._owner.room_available(self, self._loop.time())

    def _restart(self) -> None:
        """Have the kernel restart the controller, and report the resulting state."""
        if self._closed:
            return
        wanted, off = self._adapter.wanted, STATE_WORDS[BusState.OFF]
        found = self._look()
        state = BusState.OFF if found is None or found.state is None else found.state
        words = off if state is BusState.OFF else BACK_WORDS
        if found is not None and state is BusState.OFF and not found.restart_ms:
            try:
                self._adapter.restart(found.index)
            except OSError as error:
                words = f"{off}; {restart_advice(wanted.name, error)}"
            else:
                state, words = BusState.ACTIVE, BACK_WORDS
        self._owner.state(self, state, words, self._loop.time())

    def _look(self) -> CanInterface | None:
        with contextlib.suppress(OSError):
            return self._adapter.find(self._adapter.wanted.name)
        return None

    def _fail(self, error: OSError) -> None:
        if self._closed:
            return
        wanted = self._adapter.wanted
        if error.errno == errno.ENETDOWN:
            words = f"the interface {wanted.name} is down: `{up_commands(wanted, self._found)}` brings it up"
        elif error.errno in _VANISHED:
            words = f"the interface {wanted.name} has vanished: plug the adapter in again"
        else:
            words = f"the interface {wanted.name} failed: {error.strerror or error}"
        self._owner.lost(self, words)


def open_socket(wanted: Wanted, filters: Sequence[IdFilter] | None) -> socket.socket:
    """A CAN_RAW socket on an interface, non-blocking, that does not receive its own frames.

    Raises:
        OSError: it cannot be opened.
    """
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    try:
        sock.setblocking(False)
        _set_buffers(sock)
        if filters is not None:
            sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, pack_filters(filters))
        sock.setsockopt(socket.SOL_CAN_RAW, _ERR_FILTER, ID_MASK)
        sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 0)
        if wanted.fd:
            sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        sock.bind((wanted.name,))
    except BaseException:
        sock.close()
        raise
    return sock


def pack_filters(filters: Sequence[IdFilter]) -> bytes:
    """Filters as an array of `struct can_filter`; remote frames never pass."""
    return b"".join(
        _FILTER.pack(one.can_id | (EXTENDED if one.extended else 0), one.mask | EXTENDED | REMOTE) for one in filters
    )


def _set_buffers(sock: socket.socket) -> None:
    try:
        sock.setsockopt(socket.SOL_SOCKET, _RECEIVE_BUFFER_FORCE, RECEIVE_BUFFER)
    except OSError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    sock.setsockopt(socket.SOL_SOCKET, _OVERFLOW, 1)
