"""Serves a simulated bus to other programs on this computer: each connection is one controller on it.

Theory of operation. The bus runs on the event loop's clock (`SimBusDriver`), so frames of other programs take part in
arbitration at the moment they arrive here. A program may hand over as many frames as a controller holds; each is
answered when it has left the controller. A program that only listens is not a controller: it gets every transmitted
frame, and the bus does not notice it. A program that sends nonsense is dropped, counted and logged once. One that does
not read loses frames, like a controller with a full receive buffer, and is told how many; until it reads again, nothing
more is accepted from it.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import os
import secrets
import socket
from dataclasses import replace
from pathlib import Path
from typing import Final

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.bus_names import KEY_OCTETS, NamedBus, publish, withdraw
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES
from msbot_agent.link.can.sim.model.sim_bus_messages import (
    BusFrame,
    FrameRejected,
    FrameSent,
    FramesLost,
    Hello,
    Message,
    Refused,
    Restart,
    Splitter,
    StateTold,
    Welcome,
    encode,
)
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver, SimCanBus
from msbot_agent.link.contract import LinkCounters
from msbot_agent.pace import ProtocolServer
from msbot_xrce.errors import LinkDown, LinkFull, LocalProtocolError, RemoteProtocolError

MAX_PROGRAMS: Final = 256
"""Connections at a time; more are refused."""
HELLO_S: Final = 2.0
"""Time to send Hello."""
UNREAD_OCTETS: Final = 16 * 1024
"""Octets that may wait for one program here; beyond, it loses frames."""
SOCKET_OCTETS: Final = 16 * 1024
"""Octets that the system may hold for it in each of the two sockets. Left to itself, it holds half a minute of a busy
bus: a program that is too slow for the bus would be that far behind, and nobody would know."""

NO_HELLO: Final = "no Hello in time"
WRONG_KEY: Final = "wrong key"
TOO_MANY: Final = "too many programs"
UNEXPECTED: Final = "message that a program does not send, or not then"
OVERRUN: Final = "frames handed over faster than the controller takes them"
NOT_READ: Final = "frame lost to a program that does not read"

_log = logging.getLogger(__name__)


class SimBusServer:
    """Lets other programs of this user join a simulated bus by its name."""

    def __init__(self, driver: SimBusDriver, name: str, *, folder: Path | None = None) -> None:
        """Prepare; it serves once `run` is awaited.

        Args:
            driver: the bus. This process attaches its own controllers to it directly.
            name: see `check_name`.
            folder: where the file with its name goes; the user's folder for such files if absent.
        """
        self.driver = driver
        self.name = name
        self.ready = asyncio.Event()
        """Set once others can join."""
        self.counters = LinkCounters()
        """`dropped` counts programs' errors, by reason."""
        self.key = secrets.token_bytes(KEY_OCTETS)
        self.folder = folder
        self._programs: set[SimBusConnection] = set()
        self._attached = 0
        self._told: set[str] = set()
        self._encoded: tuple[Frame, float, bytes] | None = None

    @property
    def programs(self) -> int:
        """Programs that are connected."""
        return len(self._programs)

    async def run(self) -> None:
        """Serve until cancelled; then the bus is gone for all other programs.

        Raises:
            LinkDown: another process serves a bus of that name, or no port is available.
            ConfigError: the name or the user's folder cannot be used.
        """
        try:
            listening = socket.create_server(("127.0.0.1", 0))
        except OSError as error:
            raise LinkDown(f"cannot serve the simulated bus {self.name!r} on 127.0.0.1: {error.strerror}") from error
        bus = self.driver.bus
        word = NamedBus(
            self.name,
            int(listening.getsockname()[1]),
            self.key.hex(),
            os.getpid(),
            bus.bitrate,
            bus.data_bitrate,
            bus.fd,
        )
        with listening:
            try:
                publish(word, self.folder)
                self.ready.set()
                await ProtocolServer(listening, lambda: SimBusConnection(self), self.counters.dropped).run()
            finally:
                self.ready.clear()
                withdraw(word, self.folder)
                for program in list(self._programs):
                    program.close()

    # What programs call

    def joined(self, program: SimBusConnection) -> bool:
        """A program has connected; False when there are too many."""
        if len(self._programs) >= MAX_PROGRAMS:
            self.complain(TOO_MANY)
            return False
        self._programs.add(program)
        return True

    def disconnected(self, program: SimBusConnection) -> None:
        """A program has gone."""
        self._programs.discard(program)

    def attach(self, hello: Hello) -> SimCanBus:
        """A controller for a program, under a name of its own."""
        self._attached += 1
        fd = self.driver.bus.fd and not hello.classic
        return self.driver.attach(f"{hello.name or 'program'}#{self._attached}", fd=fd)

    def complain(self, reason: str) -> None:
        """Count an error of a program, and log its first occurrence."""
        self.counters.dropped.count(reason)
        if reason not in self._told and reason in self.counters.dropped:
            self._told.add(reason)
            _log.warning("simulated bus %s: dropped a program: %s (said once, counted from now on)", self.name, reason)

    def encode_received(self, frame: Frame, at: float) -> bytes:
        """A received frame, encoded for every program."""
        last = self._encoded
        if last is not None and last[0] is frame and last[1] == at:
            return last[2]
        octets = encode(BusFrame(frame, 0, at))
        self._encoded = (frame, at, octets)
        return octets


class SimBusConnection(asyncio.Protocol):
    """One connection."""

    def __init__(self, server: SimBusServer) -> None:
        self._server = server
        self._splitter = Splitter()
        self._transport: asyncio.Transport | None = None
        self._patience: asyncio.TimerHandle | None = None
        self._port: SimCanBus | None = None
        self._greeted = False
        self._outstanding: list[tuple[int, Frame]] = []
        self._is_full = False
        self._lost = 0
        self._state_now: StateTold | None = None
        """What has not been told yet."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See `asyncio.Protocol`."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.set_write_buffer_limits(UNREAD_OCTETS)
        keep_little(transport, socket.SO_SNDBUF)
        if not self._server.joined(self):
            self._refuse("too many programs are on this bus")
            return
        self._patience = asyncio.get_running_loop().call_later(HELLO_S, self._drop, NO_HELLO)

    def data_received(self, data: bytes) -> None:
        """See `asyncio.Protocol`."""
        try:
            for message in self._splitter.receive(data):
                if self._transport is not None:  # otherwise it was dropped for an earlier one
                    self._handle(message)
        except RemoteProtocolError as error:
            self._drop(str(error))

    def pause_writing(self) -> None:
        """The program does not read: it loses frames, and nothing more is taken from it."""
        self._is_full = True
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_writing(self) -> None:
        """The program has read what waited."""
        self._is_full = False
        lost, self._lost = self._lost, 0
        if lost:
            self._tell(FramesLost(lost))
        self._tell_state()
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - why does not matter
        """See `asyncio.Protocol`."""
        self.close()

    def close(self) -> None:
        """Leave the bus; the controller's unsent frames are forgotten."""
        if self._patience is not None:
            self._patience.cancel()
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()
        server, port = self._server, self._port
        server.disconnected(self)
        if port is not None:
            self._port = None
            server.driver.remove(port)
        server.driver.listeners = [tap for tap in server.driver.listeners if tap != self._overheard]

    def _handle(self, message: Message) -> None:
        match message:
            case Hello() if not self._greeted:
                self._greet(message)
            case BusFrame() if self._port is not None:
                self._take(self._port, message)
            case Restart() if self._port is not None:
                self._port.restart()
            case _:
                self._drop(UNEXPECTED)

    def _greet(self, hello: Hello) -> None:
        server = self._server
        if not hmac.compare_digest(hello.key, server.key):
            server.complain(WRONG_KEY)
            self._refuse("the key is not that of this bus: it has been restarted")
            return
        assert self._patience is not None
        self._patience.cancel()
        self._greeted = True
        bus = server.driver.bus
        self._tell(Welcome(bus.bitrate, bus.data_bitrate, bus.fd))
        if hello.listen_only:
            server.driver.listeners = [*server.driver.listeners, self._overheard]
            return
        self._port = server.attach(hello)
        self._port.attach(frame=self._heard, sent=self._sent, state=self._state)

    def _take(self, port: SimCanBus, message: BusFrame) -> None:
        if len(self._outstanding) >= MAILBOXES:
            self._drop(OVERRUN)
            return
        try:
            port.send(message.frame)
        except (LinkDown, LinkFull, LocalProtocolError) as error:
            self._tell(FrameRejected(message.tag, str(error)))
        else:
            self._outstanding.append((message.tag, message.frame))

    def _heard(self, frame: Frame, now: float) -> None:
        transport = self._transport
        if transport is None:
            return
        if self._is_full:
            self._lost += 1
            self._server.counters.dropped.count(NOT_READ)
        else:
            transport.write(self._server.encode_received(frame, now))

    def _overheard(self, at: float, _sender: str, frame: Frame) -> None:
        self._heard(frame, at)

    def _sent(self, frame: Frame, now: float) -> None:
        # Of equal frames the controller sends the oldest first; an error-passive one sets ESI by itself.
        for place, (tag, own) in enumerate(self._outstanding):
            if frame in (own, replace(own, esi=frame.esi)):
                del self._outstanding[place]
                self._tell(FrameSent(tag, now))
                return

    def _state(self, state: BusState, words: str, now: float) -> None:
        if state is BusState.OFF:
            self._outstanding.clear()
        assert self._port is not None
        self._state_now = StateTold(state, now, *self._port.error_counters(), words)
        self._tell_state()

    def _tell_state(self) -> None:
        """Send the latest state; states from while the program did not read are of no use to it."""
        if self._state_now is not None and not self._is_full:
            state, self._state_now = self._state_now, None
            self._tell(state)

    def _tell(self, message: Message) -> None:
        if self._transport is not None:
            self._transport.write(encode(message))

    def _refuse(self, words: str) -> None:
        self._tell(Refused(words))
        self.close()

    def _drop(self, reason: str) -> None:
        self._server.complain(reason)
        transport = self._transport
        self.close()
        if transport is not None:
            transport.abort()


def keep_little(transport: asyncio.Transport, side: int) -> None:
    """Let the system hold little in a socket: `SO_SNDBUF` or `SO_RCVBUF`."""
    connection = transport.get_extra_info("socket")
    if connection is not None:  # tests have transports without one
        connection.setsockopt(socket.SOL_SOCKET, side, SOCKET_OCTETS)
