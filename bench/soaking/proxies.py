"""The way of one part to its master, which can be cut: a UDP or TCP proxy in the script's own loop."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from random import Random
from typing import Protocol

MOST_SOURCES = 4
"""A part that starts again comes from another port; those before are forgotten."""


class Way(Protocol):
    """What can be done to a way."""

    @property
    def address(self) -> str:
        """Where the part connects."""

    def cut(self) -> None:
        """Nothing gets through from now on."""

    def heal(self) -> None:
        """All does."""

    def spoil(self, loss: float, double: float) -> None:
        """From now on packets are lost and doubled with these probabilities, where the protocol stands that."""

    def close(self) -> None:
        """End it."""


class _Onward(asyncio.DatagramProtocol):
    """The socket by which the master knows one source."""

    def __init__(self, way: UdpWay, source: tuple[str, int]) -> None:
        self.way, self.source = way, source

    def datagram_received(self, data: bytes, _addr: tuple[str, int]) -> None:
        self.way.back(data, self.source)

    def error_received(self, _exc: Exception) -> None:
        """The master is not there: so it is for the part."""


class UdpWay(asyncio.DatagramProtocol):
    """A UDP way."""

    def __init__(self, master: tuple[str, int], dice: Random) -> None:
        self._master, self._dice = master, dice
        self._sources: OrderedDict[tuple[str, int], asyncio.DatagramTransport] = OrderedDict()
        self._opening: set[asyncio.Task[None]] = set()
        self._is_cut, self._loss, self._double = False, 0.0, 0.0

    async def open(self) -> None:
        """Listen."""
        self._transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: self, local_addr=("127.0.0.1", 0)
        )

    @property
    def address(self) -> str:
        return f"udp:127.0.0.1:{self._transport.get_extra_info('sockname')[1]}"

    def _copies(self) -> int:
        if self._is_cut or self._dice.random() < self._loss:
            return 0
        return 2 if self._dice.random() < self._double else 1

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if addr not in self._sources:
            task = asyncio.create_task(self._open_onward(addr, data))
            self._opening.add(task)
            task.add_done_callback(self._opening.discard)
            return
        self._sources.move_to_end(addr)
        for _ in range(self._copies()):
            self._sources[addr].sendto(data)

    async def _open_onward(self, source: tuple[str, int], data: bytes) -> None:
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: _Onward(self, source), remote_addr=self._master
        )
        if source in self._sources:
            transport.close()
        else:
            self._sources[source] = transport
        for _ in range(self._copies()):
            self._sources[source].sendto(data)
        while len(self._sources) > MOST_SOURCES:
            self._sources.popitem(last=False)[1].close()

    def back(self, data: bytes, source: tuple[str, int]) -> None:
        """From the master to the part."""
        for _ in range(self._copies()):
            self._transport.sendto(data, source)

    def error_received(self, _exc: Exception) -> None:
        """The part is not there."""

    def cut(self) -> None:
        self._is_cut = True

    def heal(self) -> None:
        self._is_cut, self._loss, self._double = False, 0.0, 0.0

    def spoil(self, loss: float, double: float) -> None:
        self._loss, self._double = loss, double

    def close(self) -> None:
        self._transport.close()
        for one in self._sources.values():
            one.close()


class TcpWay:
    """A TCP way: a cut breaks its connections, or lets them stand and carry nothing."""

    def __init__(self, master: tuple[str, int], dice: Random) -> None:
        self._master, self._dice = master, dice
        self._open = asyncio.Event()
        self._open.set()
        self._refuses = False
        self._writers: set[asyncio.StreamWriter] = set()

    async def open(self) -> None:
        """Listen."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._server.sockets[0].getsockname()[1])

    @property
    def address(self) -> str:
        return f"tcp:127.0.0.1:{self.port}"

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._refuses:
            writer.transport.abort()
            return
        try:
            onward_reader, onward_writer = await asyncio.open_connection(*self._master)
        except OSError:  # the master is not there: so it is for the part
            writer.transport.abort()
            return
        both = {writer, onward_writer}
        self._writers |= both
        await asyncio.gather(self._carry(reader, onward_writer), self._carry(onward_reader, writer))
        self._writers -= both

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while octets := await reader.read(65536):
                await self._open.wait()
                writer.write(octets)
                await writer.drain()
        except OSError:
            writer.transport.abort()
            return
        writer.close()

    def cut(self) -> None:
        if self._dice.random() < 0.5:
            self._open.clear()
            return
        self._refuses = True
        for writer in self._writers:
            writer.transport.abort()

    def heal(self) -> None:
        self._refuses = False
        self._open.set()

    def spoil(self, loss: float, double: float) -> None:
        """TCP repairs that itself."""

    def close(self) -> None:
        self._server.close()
        for writer in self._writers:
            writer.transport.abort()


async def open_way(kind: str, port: int, dice: Random) -> Way:
    """A way of that kind (`udp`, `tcp`) to that port of this computer."""
    way = (UdpWay if kind == "udp" else TcpWay)(("127.0.0.1", port), dice)
    await way.open()
    return way
