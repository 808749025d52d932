"""A pseudo terminal: a serial line inside this computer, for clients that want a serial port (Unix only)."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path

from msbot_agent.link.contract import Signal
from msbot_agent.link.serial.descriptor import DescriptorTransport
from msbot_agent.link.serial.lines import Line, LineServer
from msbot_xrce.errors import LinkDown


class PtyServerLink(LineServer):
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
        line = Line(self, path)
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
