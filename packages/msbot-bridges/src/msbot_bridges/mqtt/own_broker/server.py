"""The broker on a port of this computer, in the event loop.

Only programs of this computer reach it, and all of them: it is for simulated devices, and knows no passwords.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import cast

from msbot_bridges.mqtt.own_broker.broker_core import BrokerClient, BrokerCore
from msbot_bridges.mqtt.own_broker.packets import PacketSplitter, PacketType
from msbot_xrce.errors import LinkDown, RemoteProtocolError

HOST = "127.0.0.1"
MOST_UNREAD = 4 * 1024 * 1024
"""Octets that wait for a client; one that does not read them is disconnected."""

_log = logging.getLogger("msbot.part")


class _Connection(asyncio.Protocol):
    """One client."""

    def __init__(self, server: OwnBroker) -> None:
        self._server = server
        self._splitter = PacketSplitter(PacketType.CONNECT)
        self._is_known = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        now = asyncio.get_running_loop().time()
        self.client = BrokerClient(self._send, self._transport.close, now)
        self._is_known = self._server.core.joined(self.client)
        if not self._is_known:
            self._transport.close()
        self._server.joined.set()

    def data_received(self, data: bytes) -> None:
        if not self._is_known:
            return
        now, is_new = asyncio.get_running_loop().time(), self.client.said is None
        try:
            for packet in self._splitter.receive(data):
                self._server.core.hear(self.client, packet, now)
                if self._transport.is_closing():
                    break
        except RemoteProtocolError as error:
            _log.info("broker: a client is disconnected: %s", error)
            self._transport.close()
        if is_new:
            self._server.joined.set()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - why does not matter
        if self._is_known:
            self._server.core.left(self.client)

    def _send(self, octets: bytes) -> None:
        if self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > MOST_UNREAD:
            _log.warning("broker: a client that does not read is disconnected")
            self._transport.abort()
            return
        self._transport.write(octets)


class OwnBroker:
    """The broker while it runs.

    Args:
        port: where it is; 0: any that is free.
    """

    def __init__(self, port: int = 0) -> None:
        self.core = BrokerCore()
        self.port = port
        self.joined = asyncio.Event()
        """Somebody has come, whose silence is to be watched."""

    @asynccontextmanager
    async def running(self) -> AsyncIterator[OwnBroker]:
        """It runs as long as the block.

        Raises:
            LinkDown: the port cannot be had.
        """
        loop = asyncio.get_running_loop()
        try:
            server = await loop.create_server(lambda: _Connection(self), HOST, self.port)
        except OSError as error:
            raise LinkDown(f"no broker can be at port {self.port} of {HOST}: {error.strerror}") from error
        self.port = int(server.sockets[0].getsockname()[1])
        watching = asyncio.create_task(self._watch())
        try:
            yield self
        finally:
            watching.cancel()
            server.close()
            for client in self.core.clients:
                client.close()
            await asyncio.wait([watching])

    async def _watch(self) -> None:
        """Disconnect those who are silent for too long."""
        loop = asyncio.get_running_loop()
        while True:
            self.joined.clear()
            try:
                async with asyncio.timeout_at(self.core.next_silent()):
                    await self.joined.wait()
                    continue
            except TimeoutError:
                pass
            for client in self.core.silent(loop.time()):
                client.close()
                self.core.left(client)
