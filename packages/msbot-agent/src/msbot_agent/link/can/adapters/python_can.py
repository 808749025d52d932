"""Every adapter that the library python-can knows: slcan, gs_usb, PCAN, Kvaser, Vector, socketcand, ...

Theory of operation. A bus that can be waited for (`fileno`) is read in the event loop. Any other has a thread that
reads and passes frames on through a bounded ring. Sending may block in an adapter's library, so it has a thread of its
own, too, which takes three frames at a time, as a controller does. python-can is imported when a bus is opened (`pip
install 'msbot-agent[can]'`).
"""

from __future__ import annotations

import asyncio
import importlib.util
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING, Final

from msbot_agent.link.can.adapters.can_driver import RING_FRAMES, RING_FULL, ChannelOwner
from msbot_agent.link.can.adapters.error_frames import read_report
from msbot_agent.link.can.controller import CanBusInfo
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.errors import LinkDown

if TYPE_CHECKING:
    import can

Value = str | int | float | bool
"""Value of an option for python-can."""

MAILBOXES: Final = 3
"""Frames that an adapter is given at a time; STOP can overtake those that wait behind them."""
WAIT_S: Final = 0.1
"""Longest time that a thread waits in the library before it checks whether it should end."""
AGAIN_S: Final = 0.005
END_S: Final = 2.0
"""A thread that hangs in an adapter's library is abandoned after this time."""
GIVE_UP_S: Final = 5.0
"""An adapter that has not accepted a frame after this time is reopened."""
FRAMES_AT_ONCE: Final = 256

_LIBRARIES: Final = {
    "slcan": "`pip install 'python-can[serial]'`",
    "serial": "`pip install 'python-can[serial]'`",
    "robotell": "`pip install 'python-can[serial]'`",
    "seeedstudio": "`pip install 'python-can[seeedstudio]'`",
    "gs_usb": "`pip install 'python-can[gs_usb]'` and libusb",
    "udp_multicast": "`pip install 'python-can[multicast]'`",
    "canalystii": "`pip install 'python-can[canalystii]'`",
    "cantact": "`pip install 'python-can[cantact]'`",
    "neovi": "`pip install 'python-can[neovi]'`",
    "nixnet": "`pip install 'python-can[nixnet]'`",
    "pcan": "the driver PCAN-Basic of PEAK-System",
    "kvaser": "the driver and library CANlib of Kvaser",
    "vector": "the XL Driver Library of Vector (Windows)",
    "ixxat": "the VCI driver of HMS (Windows)",
    "etas": "the driver BOA of ETAS (Windows)",
    "systec": "the driver of SYS TEC (Windows)",
    "usb2can": "the driver of 8devices (Windows)",
}
_TIMING: Final = {"pcan": 80_000_000, "slcan": 8_000_000}
"""Interfaces that take CAN FD rates as a `BitTimingFd` of that clock."""


class PythonCanAdapter:
    """One bus of python-can. Satisfies `Adapter`."""

    def __init__(
        self, interface: str, channel: str, info: CanBusInfo, settings: dict[str, Value], *, error_frames: bool = False
    ) -> None:
        """Name a bus; it is opened by the driver.

        Args:
            interface: as python-can calls it.
            channel: the interface's name for its bus: a serial port, a number, a name.
            info: what the driver says about it.
            settings: further arguments for the interface.
            error_frames: hand the adapter's reports over as frames, too (for tools that show them).
        """
        self.info = info
        self.error_frames = error_frames
        self._interface = interface
        self._channel = channel
        self._settings = settings

    async def open(self, owner: ChannelOwner) -> PythonCanChannel:
        """See `Adapter`."""
        name = self.info.name
        if importlib.util.find_spec("can") is None:
            raise LinkDown(
                f"{name}: this adapter needs the library python-can: `pip install 'msbot-agent[can]'` brings it"
            )
        opening = asyncio.get_running_loop().run_in_executor(None, self._make)
        try:
            bus = await asyncio.shield(opening)
        except asyncio.CancelledError:
            opening.add_done_callback(_shut_down)
            raise
        except Exception as error:  # a manufacturer's library may raise anything
            raise LinkDown(f"{name}: {self._why_not(error)}") from error
        return PythonCanChannel(bus, owner, error_frames=self.error_frames)

    def _make(self) -> can.BusABC:
        import can

        info, settings = self.info, dict(self._settings)
        make: Callable[..., can.BusABC] = partial(
            can.Bus, channel_of(self._channel), self._interface, ignore_config=True
        )
        if info.bits_per_second is not None:
            settings.setdefault("bitrate", info.bits_per_second)
        if not info.fd:
            return make(**settings)
        clock, fast = _TIMING.get(self._interface), info.data_bits_per_second
        if clock is not None and info.bits_per_second is not None:
            del settings["bitrate"]
            timing = can.BitTimingFd.from_sample_point(
                f_clock=clock,
                nom_bitrate=info.bits_per_second,
                nom_sample_point=80.0,
                data_bitrate=fast or info.bits_per_second,
                data_sample_point=80.0,
            )
            return make(fd=True, timing=timing, **settings)
        if fast is not None:
            settings.setdefault("data_bitrate", fast)
        if self._interface == "virtual":
            return make(protocol=can.CanProtocol.CAN_FD, **settings)
        return make(fd=True, **settings)

    def _why_not(self, error: Exception) -> str:
        import can

        needs = _LIBRARIES.get(self._interface)
        what = f"{str(error).rstrip('.') or type(error).__name__}"
        if isinstance(error, can.CanInterfaceNotImplementedError | ImportError | NameError) and needs is not None:
            return f"the interface {self._interface} of python-can needs {needs} ({what})"
        if isinstance(error, NotImplementedError):
            known = ", ".join(sorted(can.VALID_INTERFACES))
            return f"python-can knows no interface {self._interface!r}; it knows {known}"
        more = f"; it needs {needs}" if needs is not None and isinstance(error, OSError) else ""
        return f"{self._interface} {self._channel} cannot be opened: {what}{more}"


class PythonCanChannel:
    """An open bus of python-can. Satisfies `Channel`."""

    def __init__(self, bus: can.BusABC, owner: ChannelOwner, *, error_frames: bool = False) -> None:
        """Serve a bus that is open."""
        self._bus = bus
        self._owner = owner
        self._error_frames = error_frames
        self._loop = asyncio.get_running_loop()
        self._stop = threading.Event()
        self._outbox: SimpleQueue[Frame | None] = SimpleQueue()
        self._in_flight = 0
        self._inbox: deque[Frame] = deque()
        self._overflow = 0
        self._woken = False
        self._fileno = _fileno(bus)
        threads: list[Callable[[], None]] = [self._send_all]
        if self._fileno is None or not self._watch(self._fileno):
            self._fileno = None
            threads.append(self._receive_all)
        self._threads = [threading.Thread(target=work, name="msbot-can", daemon=True) for work in threads]
        for thread in self._threads:
            thread.start()

    def send(self, frame: Frame) -> bool:
        """See `Channel`."""
        if self._in_flight >= MAILBOXES:
            return False
        self._in_flight += 1
        self._outbox.put(frame)
        return True

    def pending(self) -> int:
        """See `Channel`."""
        return self._in_flight

    def restart(self) -> None:
        """See `Channel`: python-can knows no restart, so the adapter is reopened."""
        self._owner.lost(self, "the adapter is reopened after bus-off")

    async def close(self) -> None:
        """See `Channel`."""
        self._stop.set()
        self._outbox.put(None)
        if self._fileno is not None:
            self._loop.remove_reader(self._fileno)
        await self._loop.run_in_executor(None, self._finish)

    def _finish(self) -> None:
        for thread in self._threads:
            thread.join(END_S)
        with suppress(Exception):  # the adapter may have gone: then its library cannot close it
            self._bus.shutdown()

    def _watch(self, fileno: int) -> bool:
        try:
            self._loop.add_reader(fileno, self._read)
        except NotImplementedError:
            return False  # an event loop of Windows
        return True

    # In the event loop.

    def _read(self) -> None:
        frames: list[Frame] = []
        most = min(FRAMES_AT_ONCE, self._owner.free_slots())
        try:
            while len(frames) < most and (message := self._bus.recv(0)) is not None:
                if message.is_rx:
                    frames.append(frame_of(message))
        except Exception as error:  # see `_make`
            self._lose(f"the adapter has gone: {error}")
        self._hand_over(frames)

    def _take_inbox(self) -> None:
        self._woken = False
        inbox = self._inbox
        frames = [inbox.popleft() for _ in range(len(inbox))]
        overflow, self._overflow = self._overflow, 0
        if overflow:
            self._owner.events((RING_FULL,), self._loop.time(), times=overflow)
        self._hand_over(frames)

    def _hand_over(self, frames: list[Frame]) -> None:
        if self._stop.is_set():
            return
        now = self._loop.time()
        if any(frame.error for frame in frames):
            for frame in frames:
                if frame.error:
                    self._report(frame, now)
            if not self._error_frames:
                frames = [frame for frame in frames if not frame.error]
        if frames:
            self._owner.take(frames, now)

    def _report(self, frame: Frame, now: float) -> None:
        report = read_report(frame.can_id, frame.data)
        if report.events:
            self._owner.events(report.events, now)
        if report.state is not None:
            self._owner.state(self, report.state, report.words, now)

    def _sent(self) -> None:
        self._in_flight -= 1
        if not self._stop.is_set():
            self._owner.room_available(self, self._loop.time())

    def _lose(self, words: str) -> None:
        if not self._stop.is_set():
            self._owner.lost(self, words)

    # In the threads.

    def _receive_all(self) -> None:
        while not self._stop.is_set():
            try:
                message = self._bus.recv(WAIT_S)
            except Exception as error:  # see `_make`
                self._call(self._lose, f"the adapter has gone: {error}")
                return
            if message is None or not message.is_rx:
                continue
            if len(self._inbox) >= RING_FRAMES:
                self._overflow += 1
                continue
            self._inbox.append(frame_of(message))
            if not self._woken:
                self._woken = True
                self._call(self._take_inbox)

    def _send_all(self) -> None:
        while (frame := self._outbox.get()) is not None and not self._stop.is_set():
            error = self._send_one(message_of(frame))
            if error is not None:
                self._call(self._lose, f"the adapter takes no frames: {error}")
                return
            self._call(self._sent)

    def _send_one(self, message: can.Message) -> Exception | None:
        """Try to send for a while; returns why it could not be done, or None."""
        import can

        give_up_at = time.monotonic() + GIVE_UP_S
        while not self._stop.is_set():
            try:
                self._bus.send(message, timeout=WAIT_S)
            except can.CanError as error:
                if time.monotonic() >= give_up_at:
                    return error
                self._stop.wait(AGAIN_S)
            except Exception as error:  # see `_make`
                return error
            else:
                return None
        return None

    def _call(self, function: Callable[..., None], *arguments: object) -> None:
        with suppress(RuntimeError):  # the loop has been closed in the meantime
            self._loop.call_soon_threadsafe(function, *arguments)


def channel_of(text: str) -> str | int:
    """The channel as python-can's interfaces want it: a number where it is one."""
    return int(text) if text.isdecimal() else text


def frame_of(message: can.Message) -> Frame:
    """A message of python-can as a frame."""
    remote = message.is_remote_frame
    return Frame(
        message.arbitration_id,
        b"" if remote else bytes(message.data),
        message.is_extended_id and not message.is_error_frame,
        message.is_fd,
        message.bitrate_switch,
        remote,
        message.is_error_frame,
        message.error_state_indicator,
        message.dlc if remote else 0,
    )


def message_of(frame: Frame) -> can.Message:
    """A frame as a message of python-can."""
    import can

    return can.Message(
        arbitration_id=frame.can_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=frame.remote_length if frame.remote else len(frame.data),
        data=frame.data,
        is_fd=frame.fd,
        bitrate_switch=frame.brs,
        error_state_indicator=frame.esi,
    )


def _fileno(bus: can.BusABC) -> int | None:
    """The descriptor that can be waited for; None = there is none."""
    try:
        number = bus.fileno()
    except Exception:  # python-can: NotImplementedError, or whatever the adapter's library says
        return None
    return number if isinstance(number, int) and number >= 0 else None


def _shut_down(opened: asyncio.Future[can.BusABC]) -> None:
    if not opened.cancelled() and opened.exception() is None:
        opened.result().shutdown()
