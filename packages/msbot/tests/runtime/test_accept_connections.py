"""A server without descriptors rests, and goes on when there are some again; one that ends leaves nobody waiting."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket

import pytest

from msbot_agent import pace as accept_connections
from msbot_agent.pace import EXHAUSTED, Acceptor, ProtocolServer
from msbot_xrce.counting import Tally


class Scarce(socket.socket):
    """A listening socket of a process that has no descriptors left for a while."""

    tries = 0
    refusals = 3

    def accept(self) -> tuple[socket.socket, object]:
        self.tries += 1
        if self.tries <= self.refusals:
            raise OSError(errno.EMFILE, "Too many open files")
        return super().accept()


async def test_without_descriptors_it_pauses_instead_of_spinning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accept_connections, "PAUSE_S", 0.01)
    taken: list[socket.socket] = []
    arrived = asyncio.Event()
    dropped = Tally()

    def take(connection: socket.socket) -> None:
        taken.append(connection)
        arrived.set()

    with Scarce(socket.AF_INET, socket.SOCK_STREAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        acceptor = Acceptor(listening, take, dropped)
        with socket.create_connection(listening.getsockname()):
            async with asyncio.timeout(30):
                await arrived.wait()
        acceptor.stop()
        assert dropped == {EXHAUSTED: 3}
        assert taken[0].getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY), "small answers do not wait for each other"
        assert listening.tries < 10, "one try for each pause"
    taken[0].close()


class Kept(asyncio.Protocol):
    """A protocol whose server closes it when it ends."""

    def __init__(self, kept: list[asyncio.Transport]) -> None:
        self.kept = kept

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.kept.append(transport)


@pytest.mark.parametrize("turns", range(5))
async def test_who_comes_while_it_ends_has_a_protocol_or_is_closed(turns: int) -> None:
    """However far the event loop has come with the connection."""
    kept: list[asyncio.Transport] = []
    with socket.create_server(("127.0.0.1", 0)) as listening:
        accepting = asyncio.create_task(ProtocolServer(listening, lambda: Kept(kept), Tally()).run())
        await asyncio.sleep(0)
        late = socket.create_connection(listening.getsockname())
        for _ in range(turns):
            await asyncio.sleep(0)
        accepting.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await accepting
    for transport in kept:
        transport.close()
    late.setblocking(False)
    with late, contextlib.suppress(ConnectionError):
        async with asyncio.timeout(30):
            assert await asyncio.get_running_loop().sock_recv(late, 1) == b""
