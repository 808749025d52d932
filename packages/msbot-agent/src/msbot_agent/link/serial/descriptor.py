"""An asyncio transport for a file descriptor that is read and written, such as a pseudo terminal (Unix only)."""

from __future__ import annotations

import asyncio
import os

READ_OCTETS = 16 * 1024
"""Octets read before others get their turn."""


class DescriptorTransport(asyncio.Transport):
    """Reads and writes a descriptor without blocking; the owner keeps the descriptor, and closes it afterwards."""

    def __init__(self, descriptor: int, protocol: asyncio.Protocol) -> None:
        """Serve from now on; must be made in a running loop. The owner calls `protocol.connection_made`."""
        super().__init__()
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._protocol = protocol
        self._loop = asyncio.get_running_loop()
        self._waiting = bytearray()
        self._high = 64 * 1024
        self._low = 0
        self._is_paused = False
        self._is_closing = False
        self._loop.add_reader(descriptor, self._read)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """How many octets may wait before the protocol is paused, and at how many it resumes."""
        self._high = 64 * 1024 if high is None else high
        self._low = self._high // 4 if low is None else low

    def get_write_buffer_size(self) -> int:
        """Octets that wait."""
        return len(self._waiting)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Write as much as possible at once, and the rest later."""
        if self._is_closing:
            return
        if not self._waiting:
            try:
                data = memoryview(data)[os.write(self._descriptor, data) :]
            except BlockingIOError:
                pass
            except OSError as error:
                self._end(error)
                return
            if not data:
                return
            self._loop.add_writer(self._descriptor, self._write_more)
        self._waiting += data
        if not self._is_paused and len(self._waiting) > self._high:
            self._is_paused = True
            self._protocol.pause_writing()

    def is_closing(self) -> bool:
        """Whether it has been closed."""
        return self._is_closing

    def close(self) -> None:
        """The same as `abort`: waiting octets are lost."""
        self._end(None)

    def abort(self) -> None:
        """Stop at once; waiting octets are lost."""
        self._end(None)

    def _read(self) -> None:
        try:
            data = os.read(self._descriptor, READ_OCTETS)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._end(error)
            return
        if data:
            self._protocol.data_received(data)
        else:
            self._end(None)

    def _write_more(self) -> None:
        try:
            del self._waiting[: os.write(self._descriptor, self._waiting)]
        except BlockingIOError:
            return
        except OSError as error:
            self._end(error)
            return
        if not self._waiting:
            self._loop.remove_writer(self._descriptor)
        if self._is_paused and len(self._waiting) <= self._low:
            self._is_paused = False
            self._protocol.resume_writing()

    def _end(self, error: OSError | None) -> None:
        if self._is_closing:
            return
        self._is_closing = True
        self._waiting.clear()
        self._loop.remove_reader(self._descriptor)
        self._loop.remove_writer(self._descriptor)
        self._loop.call_soon(self._protocol.connection_lost, error)
