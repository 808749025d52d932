"""The way of the library `dronecan` to a bus of python-can.

Its own driver takes frames with 11-bit identifiers for its own, and waits for a frame before it sends what is due.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from dronecan.driver.common import AbstractDriver, CANFrame, DriverError

import can
from msbot_bridges.canbus import FrameSender


class PythonCanDriver(AbstractDriver):  # type: ignore[misc]  # the library has no types
    """One bus; used in one thread.

    Args:
        bus: it is closed with this.
        standard: called with each data frame that has an 11-bit identifier, and so is none of DroneCAN.
    """

    def __init__(self, bus: can.BusABC, standard: Callable[[int, bytes], None] = lambda _id, _data: None) -> None:
        super().__init__()
        self._standard = standard
        self._bus, self._sender = bus, FrameSender(bus)
        self._waiting: CANFrame | None = None
        self._left = math.inf
        """Frames that may still be taken in this turn."""

    def begin_turn(self, most_frames: int) -> None:
        """From now on so many frames are given by `receive`, then none: on a bus that is full they never end."""
        self._left = most_frames

    def wait(self, timeout: float) -> bool:
        """Wait for a frame, which `receive` gives then; False: none has come in `timeout` seconds."""
        if self._waiting is None:
            self._waiting = self._received(timeout)
        return self._waiting is not None

    def receive(self, timeout: float | None = None) -> CANFrame | None:
        """The next frame with a 29-bit identifier, or None after `timeout` seconds."""
        if self._left <= 0:
            return None
        self._left -= 1
        if (waiting := self._waiting) is not None:
            self._waiting = None
            return waiting
        return self._received(timeout)

    def _received(self, timeout: float | None) -> CANFrame | None:
        until = None if timeout is None else time.monotonic() + timeout
        while True:
            left = None if until is None else max(0.0, until - time.monotonic())
            message = self._bus.recv(left)
            if message is None:
                return None
            is_data = not (message.is_error_frame or message.is_remote_frame)
            if is_data and not message.is_extended_id:
                self._standard(message.arbitration_id, bytes(message.data))
            elif is_data:
                now = time.monotonic()
                frame = CANFrame(
                    message.arbitration_id, bytes(message.data), True, ts_monotonic=now, ts_real=message.timestamp
                )
                self._rx_hook(frame)
                return frame
            if left == 0.0:
                return None

    def send_frame(self, frame: CANFrame) -> None:
        """Hand a frame to the controller; without room it is counted and lost: a node may be alone on its bus.

        Raises:
            DriverError: the bus cannot send.
        """
        message = can.Message(arbitration_id=frame.id, is_extended_id=frame.extended, data=frame.data)
        try:
            if not self._sender.send(message):
                return
        except can.CanError as error:
            raise DriverError(str(error)) from error
        frame.ts_monotonic, frame.ts_real = time.monotonic(), time.time()
        self._tx_hook(frame)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()
