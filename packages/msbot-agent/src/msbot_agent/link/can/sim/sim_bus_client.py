"""A controller on a simulated bus that another program serves, or, if none does yet, this one.

Theory of operation. `SimAdapter` is an `Adapter`, so `CanDriver` looks after it: when the program that serves the bus
ends, the bus is gone, and the driver looks for it again. If no program serves the bus, a master serves it itself, a
part waits for it, and a tool gets an error. Frames carry the times of the bus, which all programs on this computer read
from the same monotonic clock.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from enum import Enum
from pathlib import Path
from typing import Final

from msbot_agent.link.can.adapters.can_driver import ChannelOwner
from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.bus_names import NamedBus, check_name, existing_bus, find_bus, rates_words, withdraw
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES, SimBus
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
from msbot_agent.link.can.sim.sim_bus_server import SimBusServer, keep_little
from msbot_xrce.errors import ConfigError, LinkDown, RemoteProtocolError
from msbot_xrce.lazy import dataclass

BITRATE: Final = 500_000
DATA_BITRATE: Final = 2_000_000
"""Bit rates of a bus if none are requested."""
CONNECT_S: Final = 2.0
"""Time to connect and be welcomed."""
LOOK_S: Final = 0.25
"""How often a part checks whether its bus is there."""
LOST_WORDS: Final = "the computer was too slow for the simulated bus: frames were lost"
_HAS_ENDED: Final = "the simulated bus {!r} has ended"

_log = logging.getLogger(__name__)


class WhenAbsent(Enum):
    """What to do when nobody serves the bus."""

    SERVE = "serve"
    WAIT = "wait"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class SimBusRequest:
    """The bus that is requested."""

    name: str
    bitrate: int | None = None
    """Nominal bit rate; None = any; `BITRATE` if the bus is served here."""
    data_bitrate: int | None = None
    """Bit rate of the data phase; None = any; `DATA_BITRATE` if an FD bus is served here."""
    fd: bool | None = None
    """Whether it is a CAN FD bus; None = either; classic if it is served here."""

    def make(self) -> SimBus:
        """Make the bus, to serve it here.

        Raises:
            LocalProtocolError: the bit rates are impossible.
        """
        data_bitrate = (self.data_bitrate or max(DATA_BITRATE, self.bitrate or 0)) if self.fd else None
        return SimBus(self.bitrate or BITRATE, data_bitrate, fd=bool(self.fd))

    def check(self, bus: NamedBus) -> None:
        """Make sure that a bus is as requested.

        Raises:
            LinkDown: it is not.
        """
        bitrate = self.bitrate or bus.bitrate
        data_bitrate = self.data_bitrate or bus.data_bitrate
        if bitrate != bus.bitrate or (self.fd and not bus.fd) or (bus.fd and data_bitrate != bus.data_bitrate):
            wanted = rates_words(bitrate, data_bitrate if self.fd else None, fd=bool(self.fd))
            raise LinkDown(
                f"the simulated bus {bus.name!r} is {bus.rates()}, not {wanted}: leave the bit rates out of the "
                f"address, or stop process {bus.pid}, which serves it"
            )


class _EndedEarly(LinkDown):
    """Who serves the bus has gone before the controller was on it."""


class SimAdapter:
    """A controller on a simulated bus, found by its name. Satisfies `Adapter`."""

    def __init__(
        self,
        wish: SimBusRequest,
        *,
        node: str = "",
        absent: WhenAbsent = WhenAbsent.FAIL,
        listen_only: bool = False,
        folder: Path | None = None,
    ) -> None:
        """Name the bus; it is joined by the driver.

        Args:
            wish: the bus.
            node: what the controller is called, for people who watch the bus.
            absent: what to do when no program serves it.
            listen_only: neither send nor acknowledge.
            folder: where the names of buses are; the user's folder for such files if absent.

        Raises:
            ConfigError: the name is not valid.
        """
        check_name(wish.name)
        self._wish = wish
        self._node = node
        self._absent = absent
        self._listen_only = listen_only
        self._folder = folder
        self.info = self._look()

    async def open(self, owner: ChannelOwner) -> SimBusChannel | LocalBusChannel:
        """See `Adapter`."""
        waiting, told = False, 0
        while True:
            bus = find_bus(self._wish.name, self._folder)
            if bus is not None:
                self._wish.check(bus)
                try:
                    client = await self._connect(owner, bus)
                except TimeoutError as error:
                    words = _cannot_join(bus, "it does not answer")
                    if self._absent is not WhenAbsent.WAIT:
                        raise LinkDown(words) from error
                    if told != bus.pid:  # it may only be slow: who waits for a bus waits for this one, too
                        told = bus.pid
                        _log.warning("%s; trying again", words)
                    continue
                except _EndedEarly as error:
                    if self._absent is not WhenAbsent.WAIT:
                        raise
                    if told != bus.pid:
                        told = bus.pid
                        _log.warning("%s; trying again", error)
                else:
                    if client is not None:
                        return client
            elif self._absent is WhenAbsent.FAIL:
                existing_bus(self._wish.name, self._folder)
            elif self._absent is WhenAbsent.SERVE:
                host = await self._serve(owner)
                if host is not None:
                    return host
            elif not waiting:
                waiting = True
                _log.warning("waiting for the simulated bus %r: nobody serves it yet", self._wish.name)
            await asyncio.sleep(LOOK_S)

    async def _connect(self, owner: ChannelOwner, bus: NamedBus) -> SimBusChannel | None:
        """Join a bus; None if its file was left behind by a program that has gone.

        Raises:
            TimeoutError: the program that serves it does not answer.
            LinkDown: it cannot be joined.
        """
        hello = Hello(bytes.fromhex(bus.key), self._node, listen_only=self._listen_only)
        client = SimBusChannel(owner, hello, bus.name)
        has_joined = False
        try:
            async with asyncio.timeout(CONNECT_S):
                await asyncio.get_running_loop().create_connection(lambda: client, "127.0.0.1", bus.port)
                await client.welcomed
            has_joined = True
        except ConnectionRefusedError:
            withdraw(bus, self._folder)  # its process number belongs to another process by now
            return None
        except (LinkDown, TimeoutError):  # the server has given the reason, or did not answer
            raise
        except ConnectionError as error:  # it closed its port before it had accepted the connection
            raise _EndedEarly(_HAS_ENDED.format(bus.name)) from error
        except OSError as error:
            raise LinkDown(_cannot_join(bus, error.strerror or str(error))) from error
        finally:
            if not has_joined:
                client.leave()
        if client.ended:
            raise LinkDown(client.ended)
        return client

    async def _serve(self, owner: ChannelOwner) -> LocalBusChannel | None:
        """Serve the bus here; None if another program was faster."""
        host = LocalBusChannel(owner, self._wish, self._node, self._folder)
        if await host.start():
            return host
        return None

    def _look(self) -> CanBusInfo:
        """What is known of the bus before it is joined: its properties now, or those it will have."""
        wish = self._wish
        try:
            bus = find_bus(wish.name, self._folder)
        except ConfigError:
            bus = None  # reported when it is opened
        fd = bus.fd if bus is not None else bool(wish.fd)
        bitrate = bus.bitrate if bus is not None else wish.bitrate or BITRATE
        data_bitrate = bus.data_bitrate if bus is not None else wish.data_bitrate or DATA_BITRATE
        return CanBusInfo(f"sim:{wish.name}", bitrate, data_bitrate if fd else None, fd)


class SimBusChannel(asyncio.Protocol):
    """A connection with the program that serves the bus. Satisfies `Channel`."""

    def __init__(self, owner: ChannelOwner, hello: Hello, name: str) -> None:
        """Prepare; `welcomed` is done when the controller is on the bus."""
        self.welcomed: asyncio.Future[Welcome] = asyncio.get_running_loop().create_future()
        """Fails with LinkDown when the server refuses."""
        self.ended = ""
        """Why the connection ended, in words, unless its owner closed it."""
        self._owner = owner
        self._hello = hello
        self._name = name
        self._splitter = Splitter()
        self._transport: asyncio.Transport | None = None
        self._outstanding: set[int] = set()
        self._tag = 0

    def send(self, frame: Frame) -> bool:
        """See `Channel`."""
        if self._transport is None or self._hello.listen_only or len(self._outstanding) >= MAILBOXES:
            return False
        self._tag = self._tag + 1 & 0xFFFFFFFF
        self._outstanding.add(self._tag)
        self._transport.write(encode(BusFrame(frame, self._tag)))
        return True

    def pending(self) -> int:
        """See `Channel`."""
        return len(self._outstanding)

    def restart(self) -> None:
        """See `Channel`."""
        if self._transport is not None:
            self._transport.write(encode(Restart()))

    async def close(self) -> None:
        """See `Channel`."""
        self.leave()

    def leave(self) -> None:
        """Close the connection at once."""
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()
        if not self.welcomed.done():
            self.welcomed.cancel()
        elif not self.welcomed.cancelled():
            self.welcomed.exception()  # the caller that closes it knows

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See `asyncio.Protocol`."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        keep_little(transport, socket.SO_RCVBUF)
        transport.write(encode(self._hello))

    def data_received(self, data: bytes) -> None:
        """See `asyncio.Protocol`."""
        try:
            for message in self._splitter.receive(data):
                if self._transport is None:
                    return
                self._handle(message)
        except RemoteProtocolError as error:
            self._end(f"the program that serves the simulated bus {self._name!r} talks nonsense: {error}")

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - the bus has gone either way
        """See `asyncio.Protocol`."""
        self._end(_HAS_ENDED.format(self._name), _EndedEarly)

    def _handle(self, message: Message) -> None:
        now = asyncio.get_running_loop().time()
        match message:
            case BusFrame():
                self._owner.take([message.frame], message.at)
            case FrameSent():
                self._outstanding.discard(message.tag)
                self._owner.room_available(self, message.at)
            case FrameRejected():
                self._outstanding.discard(message.tag)
                self._owner.events((message.words,), now)
                self._owner.room_available(self, now)
            case StateTold():
                if message.state is BusState.OFF:
                    self._outstanding.clear()
                self._owner.state(self, message.state, message.words, message.at)
            case FramesLost():
                self._owner.events((LOST_WORDS,), now)
            case Welcome() if not self.welcomed.done():
                self.welcomed.set_result(message)
            case Refused():
                self._end(f"the simulated bus {self._name!r} refuses this program: {message.words}")
            case _:
                raise RemoteProtocolError("message that a server does not send, or not then")

    def _end(self, words: str, kind: type[LinkDown] = LinkDown) -> None:
        transport, self._transport = self._transport, None
        if transport is None:
            return  # closed by its owner
        transport.abort()
        self.ended = words
        if self.welcomed.done():
            self._owner.lost(self, words)
        else:
            self.welcomed.set_exception(kind(words))


def _cannot_join(bus: NamedBus, reason: str) -> str:
    return f"cannot join the simulated bus {bus.name!r} of process {bus.pid}: {reason}"


class LocalBusChannel:
    """A controller on a bus that is served here. Satisfies `Channel`."""

    def __init__(self, owner: ChannelOwner, wish: SimBusRequest, node: str, folder: Path | None) -> None:
        """Prepare; `start` serves the bus."""
        self.driver = SimBusDriver(wish.make())
        self._owner = owner
        self._server = SimBusServer(self.driver, wish.name, folder=folder)
        self._port: SimCanBus = self.driver.attach(node or "host")
        self._port.attach(
            frame=lambda frame, now: owner.take([frame], now),
            room=lambda now: owner.room_available(self, now),
            state=lambda state, words, now: owner.state(self, state, words, now),
        )
        self._serving: asyncio.Task[None] | None = None

    async def start(self) -> bool:
        """Serve from now on; False if another program was faster.

        Raises:
            LinkDown: it cannot be served.
            ConfigError: the user's folder cannot be used.
        """
        loop = asyncio.get_running_loop()
        serving = self._serving = loop.create_task(self._server.run())
        ready = loop.create_task(self._server.ready.wait())
        try:
            await asyncio.wait((serving, ready), return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError:
            serving.cancel()
            raise
        finally:
            ready.cancel()
        if not serving.done():
            return True
        error = serving.exception()
        if isinstance(error, LinkDown) and find_bus(self._server.name, self._server.folder) is not None:
            return False
        assert error is not None
        raise error

    def send(self, frame: Frame) -> bool:
        """See `Channel`."""
        if not self._port.has_room():
            return False
        self._port.send(frame)
        return True

    def pending(self) -> int:
        """See `Channel`."""
        return self._port.pending()

    def restart(self) -> None:
        """See `Channel`."""
        self._port.restart()

    async def close(self) -> None:
        """See `Channel`; the bus ends for all programs."""
        self.driver.remove(self._port)
        if self._serving is not None:
            self._serving.cancel()
            await asyncio.wait((self._serving,))
