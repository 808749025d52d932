"""Serial ports, with the library serialx (`pip install 'msbot-agent[serial]'`): several, plugged in at any time.

A port that is not there yet, or has vanished, is looked for twice a second and opened once it is there.
"""

from __future__ import annotations

import asyncio
import errno
import importlib.util
import logging
from collections.abc import Callable, Sequence
from functools import partial

from msbot_agent.link.contract import Signal
from msbot_agent.link.serial.serial_line import (
    AGENT_ADDRESS,
    CLIENT_ADDRESS,
    SerialLine,
    SerialLineLink,
    SerialLineServer,
)
from msbot_agent.link.stream_link import Stream
from msbot_xrce.errors import ConfigError, LinkDown

logger = logging.getLogger(__name__)

DEFAULT_BAUDRATE = 115_200
RESCAN_S = 0.5
"""Pause between two searches for ports that are not open."""

AUTO = "auto"
"""In place of port names: every USB serial port."""

OTHER_SOURCE = "from another address"

_ABSENT = (errno.ENOENT, errno.ENXIO, errno.ENODEV)


def check_baudrate(baudrate: int) -> int:
    """Check a baud rate and return it.

    Raises:
        ConfigError: it is not from 50 to 20,000,000.
    """
    if not 50 <= baudrate <= 20_000_000:
        raise ConfigError(f"baud rate {baudrate} is not from 50 to 20000000: {DEFAULT_BAUDRATE} is usual")
    return baudrate


class Opener:
    """Opens ports, and says in words why one cannot be opened."""

    def __init__(self, baudrate: int, *, flow_control: bool) -> None:
        """Open ports with 8 data bits, no parity, one stop bit; `flow_control` uses the wires RTS and CTS.

        Raises:
            ConfigError: there is no such baud rate.
        """
        self._baudrate = check_baudrate(baudrate)
        self._flow_control = flow_control
        self._said: dict[str, str] = {}

    async def open(self, port: str, make: Callable[[], SerialLine], *, must: bool) -> bool:
        """Try to open a port; returns whether it is open.

        Args:
            port: its name.
            make: makes the line for it.
            must: raise a problem that only the user can solve; otherwise it is tried again later.

        Raises:
            LinkDown: `must`, and the port is there but cannot be used.
        """
        from serialx import create_serial_connection

        loop = asyncio.get_running_loop()
        try:
            await create_serial_connection(loop, make, port, baudrate=self._baudrate, rtscts=self._flow_control)
        except OSError as error:
            words = why_not(port, error)
            if must and error.errno not in _ABSENT:
                raise LinkDown(words) from error
            self._say_once(port, words)
            return False
        self._said.pop(port, None)
        return True

    def _say_once(self, port: str, words: str) -> None:
        if self._said.get(port) != words:
            self._said[port] = words
            logger.warning("%s", words)


def why_not(port: str, error: OSError) -> str:
    """Why a port cannot be opened, and what to do."""
    if error.errno in _ABSENT:
        return f"serial port {port} is not there: it will be used as soon as it is plugged in"
    remedies = {
        errno.EACCES: "no permission: join the group that owns it (`sudo usermod -aG dialout $USER`, "
        "then log in again)",
        errno.EBUSY: "another program uses it: end that one",
        errno.ENOTTY: "it is not a serial port: `ls /dev/serial/by-id` shows what is plugged in",
        errno.EISDIR: "it is not a serial port: `ls /dev/serial/by-id` shows what is plugged in",
        errno.EINVAL: "it does not take the baud rate: try 115200",
    }
    return f"cannot use serial port {port}: {remedies.get(error.errno or 0) or error.strerror or error}"


def need_library(name: str) -> None:
    """Make sure that serial ports can be used.

    Raises:
        LinkDown: the library is not installed.
    """
    if importlib.util.find_spec("serialx") is None:
        raise LinkDown(f"{name}: serial ports need the library serialx: `pip install 'msbot-agent[serial]'` brings it")


async def usb_ports() -> list[str]:
    """The names of all USB serial ports that are plugged in, the persistent names where the system has them."""
    from serialx import async_list_serial_ports

    return sorted(port.device for port in await async_list_serial_ports() if port.vid is not None)


class SerialServerLink(SerialLineServer):
    """The agent's side of one or more serial ports. Satisfies `Link`.

    Args:
        ports: their names, for example `/dev/ttyUSB0`; none = every USB serial port, whenever it is plugged in.
        baudrate: bits per second.
        flow_control: use the wires RTS and CTS.
        rescan_s: seconds between two searches for ports that are not open.

    Raises:
        ConfigError: there is no such baud rate.
    """

    def __init__(
        self,
        ports: Sequence[str] = (),
        *,
        baudrate: int = DEFAULT_BAUDRATE,
        flow_control: bool = False,
        rescan_s: float = RESCAN_S,
    ) -> None:
        super().__init__(f"serial:{','.join(ports) or AUTO}", bits_per_second=baudrate)
        self._ports = tuple(dict.fromkeys(ports))
        self._opener = Opener(baudrate, flow_control=flow_control)
        self._rescan_s = rescan_s

    @property
    def open_ports(self) -> list[str]:
        """The ports that are open now."""
        return sorted(self._lines)

    async def run(self) -> None:
        """Serve until cancelled; it may run again afterwards.

        Raises:
            LinkDown: the library is missing, or a named port is there but cannot be used.
        """
        need_library(self.info.name)
        try:
            await self._look(must=bool(self._ports))
            self._tell(Signal.LINK_UP, None, f"open: {', '.join(self.open_ports) or 'no port yet'}")
            while True:
                await asyncio.sleep(self._rescan_s)
                await self._look(must=False)
        finally:
            await self._close_lines()
            self._tell(Signal.LINK_DOWN, None, "closed")

    async def _look(self, *, must: bool) -> None:
        for port in self._ports or await usb_ports():
            if port not in self._lines:
                await self._opener.open(port, partial(SerialLine, self, port), must=must)


class SerialClientLink(SerialLineLink):
    """A client's side of one serial port; its `remote` is the agent. Satisfies `Link`.

    LINK_UP and LINK_DOWN say when the port opens and vanishes; it is reopened automatically.

    Args:
        port: its name, for example `/dev/ttyUSB0` or `COM3`.
        baudrate: bits per second.
        address: own address octet; clients that share a line need different ones.
        remote: the agent's address octet.
        flow_control: use the wires RTS and CTS.
        rescan_s: seconds between two searches for the port while it is not open.

    Raises:
        ConfigError: there is no such baud rate or address.
    """

    def __init__(
        self,
        port: str,
        *,
        baudrate: int = DEFAULT_BAUDRATE,
        address: int = CLIENT_ADDRESS,
        remote: int = AGENT_ADDRESS,
        flow_control: bool = False,
        rescan_s: float = RESCAN_S,
    ) -> None:
        for octet in (address, remote):
            if not 0 <= octet <= 255:
                raise ConfigError(f"serial address {octet} is not from 0 to 255")
        super().__init__(f"serial:{port}", address=address, bits_per_second=baudrate)
        self.remote = (port, remote)
        self._port = port
        self._opener = Opener(baudrate, flow_control=flow_control)
        self._rescan_s = rescan_s

    async def run(self) -> None:
        """Serve until cancelled; it may run again afterwards.

        Raises:
            LinkDown: the library is missing, or the port is there but cannot be used.
        """
        need_library(self.info.name)
        must = True
        try:
            while True:
                if not self._lines:
                    await self._opener.open(self._port, partial(SerialLine, self, self._port), must=must)
                    must = False
                await asyncio.sleep(self._rescan_s)
        finally:
            was_open = bool(self._lines)
            await self._close_lines()
            if was_open:
                self._tell(Signal.LINK_DOWN, self.remote, "closed")

    def line_opened(self, line: SerialLine) -> None:
        """See `SerialLineLink`."""
        super().line_opened(line)
        line.known.add(self.remote)
        self._streams[self.remote] = line
        self._tell(Signal.LINK_UP, self.remote, "opened")

    def accepts_newcomer(self, line: SerialLine, source: int) -> bool:  # noqa: ARG002 - a client hears its agent only
        """See `SerialLineLink`."""
        self.counters.dropped.count(OTHER_SOURCE)
        return False

    def stream_closed(self, stream: Stream, words: str) -> None:
        """See `StreamLink`."""
        if self._lines.pop(self._port, None) is stream:
            self._streams.clear()
            self._tell(Signal.LINK_DOWN, self.remote, f"port {words}")
