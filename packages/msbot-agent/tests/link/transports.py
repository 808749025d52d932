"""A transport that keeps what is written, for the tests of streams."""

from __future__ import annotations

import asyncio


class FakeTransport(asyncio.Transport):
    """Takes everything; the test plays the other side."""

    def __init__(self, protocol: asyncio.Protocol) -> None:
        super().__init__()
        self.written = bytearray()
        self.limits: tuple[int | None, int | None] = (None, None)
        self._protocol = protocol
        self._is_closing = False
        protocol.connection_made(self)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        self.limits = (high, low)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.written += data

    def is_closing(self) -> bool:
        return self._is_closing

    def begin_to_close(self) -> None:
        """Carry nothing any more, and say so later."""
        self._is_closing = True

    def abort(self) -> None:
        self._is_closing = True
        asyncio.get_running_loop().call_soon(self._protocol.connection_lost, None)
