"""A pseudo terminal: a serial line inside this computer, for clients that want a serial port (Unix only)."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path

from msbot_agent.link.contract import Signal
from msbot_agent.link.serial.serial_line import SerialLine, SerialLineServer
from msbot_xrce.errors import LinkDown

# An asyncio transport for a file descriptor that is read and written, such as a pseudo terminal (Unix only).


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


class PtyServerLink(SerialLineServer):
    """The agent's side of a new pseudo terminal; a client opens its other end, `path`, as a serial port.

    The terminal stays while clients come and go; the link cannot tell when a client has closed it. Satisfies `Link`.

    Args:
        path: a symbolic link with this name points to the terminal while the link is open; None = only the name that
            the system gives, see `path`.
    """

    def __init__(self, path: str | None = None) -> None:
        super().__init__(f"pty:{path or ''}")
        self._wanted = path
        self.path: str | None = None
        """The path for a client to open, while the link is open."""

    async def run(self) -> None:
        """Serve until cancelled; it may run again afterwards.

        Raises:
            LinkDown: this system has no pseudo terminals, or the name is taken.
        """
        if sys.platform == "win32":
            raise LinkDown("there are no pseudo terminals on Windows: use UDP or TCP instead")
        import tty

        ours, other_end = os.openpty()
        # This side keeps the other end open, too: otherwise the terminal would break whenever a client closes it.
        try:
            tty.setraw(other_end)
            name = os.ttyname(other_end)
            link = self._make_link(name)
            try:
                await self._serve(ours, self._wanted or name)
            finally:
                if link is not None:
                    link.unlink(missing_ok=True)
        finally:
            os.close(other_end)
            os.close(ours)

    async def _serve(self, descriptor: int, path: str) -> None:
        self.path = path
        line = SerialLine(self, path)
        transport = DescriptorTransport(descriptor, line)
        try:
            line.connection_made(transport)
            self._tell(Signal.LINK_UP, None, f"opened {path}")
            await asyncio.wait([line.closed])
            raise LinkDown(f"{self.info.name}: the pseudo terminal has {line.closed.result()}: start it again")
        finally:
            self.path = None
            await self._close_lines()
            self._tell(Signal.LINK_DOWN, None, "closed")

    def _make_link(self, name: str) -> Path | None:
        if self._wanted is None:
            return None
        link = Path(self._wanted)
        try:
            if link.is_symlink() and not link.exists():
                link.unlink()  # left over from a process that was killed
            link.symlink_to(name)
        except OSError as error:
            raise LinkDown(
                f"cannot make the pseudo terminal {link}: {error.strerror}: choose another name, "
                "or remove it if nobody uses it"
            ) from error
        return link
