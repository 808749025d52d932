"""A serial port read and written by a thread that may block, with the library serialx."""

from __future__ import annotations

import errno
import time
from typing import TYPE_CHECKING

from msbot.hardware.hardware_fault import HardwareFault, missing_library
from msbot_xrce.errors import LinkDown

if TYPE_CHECKING:
    from serialx import Serial

MOST_OCTETS = 4096
LOOK_S = 0.02
"""Longest wait of a single read of the port."""


class SerialStream:
    """An open port; satisfies `ByteStream` of the USB module.

    Args:
        path: the port.
        baudrate: bits per second.
        what: what should be there, for messages.

    Raises:
        HardwareFault: it cannot be opened.
    """

    def __init__(self, path: str, baudrate: int, what: str) -> None:
        self.path = path
        self._what = what
        self._port = _open(path, baudrate, what)

    def write(self, data: bytes) -> None:
        """Send all of the octets; raises LinkDown when the port is gone."""
        try:
            self._port.write(data)
            self._port.flush()
        except OSError as error:
            raise self._gone(error) from None

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, at least one octet; empty when nothing comes in time. Raises LinkDown if the port is
        gone."""
        until = time.monotonic() + timeout_s
        try:
            while True:
                if self._port.in_waiting or timeout_s > 0:
                    received = bytes(self._port.read(MOST_OCTETS))
                    if received:
                        return received
                if time.monotonic() >= until:
                    return b""
        except OSError as error:
            raise self._gone(error) from None

    def close(self) -> None:
        """Release the port."""
        self._port.close()

    def _gone(self, error: OSError) -> LinkDown:
        return LinkDown(f"{self._what} at {self.path} was unplugged ({error.strerror or error}): plug it in again")


def _open(path: str, baudrate: int, what: str) -> Serial:
    try:
        from serialx import Serial
    except ImportError:
        raise missing_library("parts on a serial port", "serialx") from None
    # The class for this platform, which the library's types do not show.
    port = Serial(path, baudrate=baudrate, read_timeout=LOOK_S, write_timeout=1.0, close_timeout=1.0)  # type: ignore[abstract]
    try:
        port.open()
    except OSError as error:
        remedies = {
            errno.ENOENT: "is it plugged in? `ls /dev/serial/by-id` shows what is; name it with --device",
            errno.ENXIO: "is it plugged in? `ls /dev/serial/by-id` shows what is; name it with --device",
            errno.EACCES: "no permission: `sudo usermod -aG dialout $USER`, then log in again",
            errno.EBUSY: "another program uses it: end that one",
            errno.EAGAIN: "another program uses it: end that one",
        }
        remedy = remedies.get(error.errno or 0, error.strerror or str(error))
        raise HardwareFault(f"{what} cannot be opened at {path}: {remedy}") from None
    return port
