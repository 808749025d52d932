"""The way of the library `pycyphal` to a bus of python-can.

Its own way knows only some adapters, and not MsBOT's simulated bus. Two threads wait for the bus; what is to be sent
waits in the order of its identifiers, as in a controller, so that STOP goes before everything else.
"""

from __future__ import annotations

import asyncio
import contextlib
import heapq
import itertools
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from pycyphal.transport import ResourceClosedError, Timestamp
from pycyphal.transport.can.media import DataFrame, Envelope, FilterConfiguration, FrameFormat, Media

import can
from msbot_bridges.canbus import BEACON_ID, FrameSender

MOST_FRAMES: Final = 1000
"""Frames that wait; beyond, the library is told that it cannot send."""
MOST_HEARD: Final = 200
"""Frames that are handed to the event loop at once; orders go out between."""
MOST_UNHEARD: Final = 20
"""So many times that may wait for the loop; what comes beyond is lost and counted."""
LISTEN_S: Final = 0.2
"""A thread sees so soon that it is to end."""
END_S: Final = 2.0
_Received = list[tuple[Timestamp, Envelope]]


class PythonCanMedia(Media):  # type: ignore[misc]  # the library is not looked at
    """One bus; made and used in one event loop.

    Args:
        bus: it stays open.
        failed: called in the event loop, once, when the bus has ended.
        standard: called in the event loop with a frame that may be a BEACON of MsBOT's own parts.
        fd: send frames of CAN FD, with up to 64 octets; both kinds are heard.
    """

    def __init__(
        self,
        bus: can.BusABC,
        failed: Callable[[Exception], None] = lambda _: None,
        standard: Callable[[int, bytes], None] = lambda _id, _data: None,
        *,
        fd: bool = False,
    ) -> None:
        self._fd = fd
        self._standard = standard
        self._bus, self._sender, self._failed = bus, FrameSender(bus), failed
        self._loop = asyncio.get_running_loop()
        self._handler: Callable[[_Received], None] = lambda _: None
        self._filters: Sequence[FilterConfiguration] = ()
        self._is_closed = False
        self._unheard = 0
        """Deliveries that wait for the loop."""
        self.lost = 0
        """Frames that the loop could not keep up with."""
        self._waiting: list[tuple[int, int, float, can.Message]] = []
        self._numbers = itertools.count()
        self._wake = threading.Condition()
        self._threads = [
            threading.Thread(target=self._guarded, args=(work,), name=f"Cyphal, {what}", daemon=True)
            for what, work in (("listens", self._listen), ("sends", self._send_all))
        ]

    @property
    def interface_name(self) -> str:
        """See `Media`."""
        return str(self._bus.channel_info)

    @property
    def mtu(self) -> int:
        """See `Media`: octets of a frame."""
        return 64 if self._fd else 8

    @property
    def number_of_acceptance_filters(self) -> int:
        """See `Media`: they are a program's, so there may be as many as are needed."""
        return 64

    def start(self, handler: Callable[[_Received], None], *_options: object, **_more: object) -> None:
        """See `Media`."""
        self._handler = handler
        for thread in self._threads:
            thread.start()

    def configure_acceptance_filters(self, configuration: Sequence[FilterConfiguration]) -> None:
        """See `Media`."""
        self._filters = tuple(configuration)

    async def send(self, frames: Iterable[Envelope], monotonic_deadline: float) -> int:
        """See `Media`."""
        if self._is_closed:
            raise ResourceClosedError(repr(self))
        sent, echoes = 0, _Received()
        with self._wake:
            for envelope in frames:
                if len(self._waiting) >= MOST_FRAMES:
                    break
                frame = envelope.frame
                extended = frame.format == FrameFormat.EXTENDED
                message = can.Message(
                    arbitration_id=frame.identifier,
                    is_extended_id=extended,
                    data=frame.data,
                    is_fd=self._fd,
                    bitrate_switch=self._fd,
                    check=False,
                )
                heapq.heappush(self._waiting, (frame.identifier, next(self._numbers), monotonic_deadline, message))
                sent += 1
                if envelope.loopback:
                    echoes.append((Timestamp.now(), envelope))
            self._wake.notify_all()
        if echoes:
            self._loop.call_soon(self._deliver, echoes)
        return sent

    def close(self) -> None:
        """See `Media`; what waits is still sent, see `closed`."""
        self._is_closed = True
        with self._wake:
            self._wake.notify_all()

    async def closed(self) -> None:
        """Wait until nothing uses the bus."""
        await asyncio.to_thread(self._leave)

    def _leave(self) -> None:
        for thread in self._threads:
            if thread.is_alive():
                thread.join(END_S)

    def _deliver(self, received: _Received) -> None:
        if not self._is_closed:
            self._handler(received)

    # In the threads

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except (can.CanError, OSError, ValueError) as error:  # a bus that is closed may raise any of these
            if not self._is_closed:
                self._call(self._failed, error)

    def _listen(self) -> None:
        while not self._is_closed:
            received, message = _Received(), self._bus.recv(LISTEN_S)
            while message is not None:
                is_data = not (message.is_error_frame or message.is_remote_frame)
                if is_data and not message.is_extended_id:
                    if message.arbitration_id == BEACON_ID:
                        self._call(self._standard, message.arbitration_id, bytes(message.data))
                elif is_data:
                    identifier = message.arbitration_id
                    if any(not (identifier ^ one.identifier) & one.mask for one in self._filters):
                        frame = DataFrame(FrameFormat.EXTENDED, identifier, bytearray(message.data))
                        received.append((Timestamp.now(), Envelope(frame, loopback=False)))
                message = self._bus.recv(0.0) if len(received) < MOST_HEARD else None
            if received:
                self._hand_over(received)

    def _hand_over(self, received: _Received) -> None:
        with self._wake:
            if self._unheard >= MOST_UNHEARD:
                self.lost += len(received)
                return
            self._unheard += 1
        self._call(self._take, received)

    def _take(self, received: _Received) -> None:
        with self._wake:
            self._unheard -= 1
        self._deliver(received)

    def _send_all(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._waiting or self._is_closed)
                if not self._waiting:
                    return
                _, _, deadline, message = heapq.heappop(self._waiting)
            if time.monotonic() <= deadline:
                self._sender.send(message)

    def _call(self, function: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function, *arguments)
