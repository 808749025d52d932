"""Every system call of the drivers fails in every way that systems know: what is passing passes, the rest is one error.

Not EINTR: after it, Python itself makes the call again (PEP 475).

SocketCAN, whose errors mean something else, has its own table in `can/adapters/test_socketcan.py`, the serial port's
opening in `serial/test_port.py`.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from msbot_agent.agent.discovery import DiscoveryResponder
from msbot_agent.link import Peer
from msbot_agent.link.net.tcp import TcpClientLink, TcpServerLink
from msbot_agent.link.net.udp import UdpClientLink, UdpServerLink
from msbot_agent.link.serial.pty import DescriptorTransport
from msbot_xrce.errors import LinkDown
from tests.agent.test_discovery import QUESTION as REQUEST

WAIT_S = 5.0
PASSING = (
    errno.EAGAIN, errno.ENOBUFS, errno.ENOMEM, errno.ENETDOWN, errno.ENETUNREACH, errno.ENETRESET,
    errno.EHOSTUNREACH, errno.EHOSTDOWN, errno.ECONNREFUSED, errno.EMSGSIZE, errno.EPERM, errno.EACCES, errno.EINVAL,
    errno.EADDRNOTAVAIL, errno.ENODEV, errno.ENXIO,
)  # fmt: skip
"""What may be wrong with one datagram, one peer, or an interface that comes back."""
FATAL = (errno.EIO, errno.EBADF, errno.ENOTSOCK)


def names(error: int) -> str:
    return errno.errorcode[error]


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(WAIT_S):
        while not condition():  # noqa: ASYNC110 - one turn of the loop is enough
            await asyncio.sleep(0)


class Faults:
    """What the next calls of a kind raise, on sockets of the Internet only: event loops have others of their own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch

    def of(self, call: str) -> list[int]:
        """The errors that the next of these calls raise: none yet. Links keep methods, so it comes before them."""
        left: list[int] = []
        real: Callable[..., Any] = getattr(socket.socket, call)

        def faulty(sock: socket.socket, *arguments: Any) -> Any:
            if left and sock.family == socket.AF_INET:
                raise OSError(error := left.pop(0), os.strerror(error))
            return real(sock, *arguments)

        self._monkeypatch.setattr(socket.socket, call, faulty)
        return left


@pytest.fixture
def faults(monkeypatch: pytest.MonkeyPatch) -> Faults:
    return Faults(monkeypatch)


class Ear:
    """A link that runs, and what it hears."""

    def __init__(self, link: Any) -> None:
        self.link = link
        self.heard: asyncio.Queue[tuple[bytes, Peer]] = asyncio.Queue()
        link.attach(packet=lambda packet, peer, _now: self.heard.put_nowait((packet, peer)))
        self.task = asyncio.create_task(link.run())

    async def next(self) -> tuple[bytes, Peer]:
        return await asyncio.wait_for(self.heard.get(), WAIT_S)

    async def until_up(self) -> None:
        await until(lambda: getattr(self.link, "port", 1))

    async def close(self) -> None:
        self.task.cancel()
        with suppress(asyncio.CancelledError, LinkDown):
            await self.task


async def udp_pair() -> tuple[Ear, Ear]:
    server = Ear(UdpServerLink("127.0.0.1", 0))
    await server.until_up()
    client = Ear(UdpClientLink("127.0.0.1", server.link.port))
    await asyncio.sleep(0)
    await until(lambda: client.link._socket is not None)
    return server, client


@pytest.mark.parametrize("error", PASSING, ids=names)
@pytest.mark.parametrize("call", ["recvfrom", "sendto", "send"])
async def test_what_passes_does_not_end_a_udp_link(call: str, error: int, faults: Faults) -> None:
    left = faults.of(call)
    server, client = await udp_pair()
    try:
        client.link.send(b"first", client.link.remote)
        _, peer = await server.next()
        left.append(error)
        client.link.send(b"up", client.link.remote)
        server.link.send(b"down", peer)
        # The failing call may have cost a packet; the next ones arrive at both ends.
        async with asyncio.timeout(WAIT_S):
            while left:
                client.link.send(b"up", client.link.remote)
                await asyncio.sleep(0)
        client.link.send(b"last", client.link.remote)
        server.link.send(b"last", peer)
        for ear in (server, client):
            async with asyncio.timeout(WAIT_S):
                while (await ear.next())[0] != b"last":
                    pass
        dropped = sum(sum(one.link.counters.dropped.values()) for one in (server, client))
        assert dropped == (error != errno.EAGAIN)
        assert not server.task.done()
        assert not client.task.done()
    finally:
        await client.close()
        await server.close()


@pytest.mark.parametrize("error", FATAL, ids=names)
@pytest.mark.parametrize("call", ["recvfrom", "sendto"])
async def test_what_does_not_pass_ends_a_udp_link_with_a_sentence(call: str, error: int, faults: Faults) -> None:
    left = faults.of(call)
    server, client = await udp_pair()
    try:
        client.link.send(b"first", client.link.remote)
        _, peer = await server.next()
        left.append(error)
        client.link.send(b"up", client.link.remote)
        server.link.send(b"down", peer)
        with pytest.raises(LinkDown, match=rf"{os.strerror(error)}.*start it again"):
            await asyncio.wait_for(asyncio.shield(next(one.task for one in (server, client))), WAIT_S)
    finally:
        await client.close()
        await server.close()


async def test_a_datagram_from_port_0_ends_nothing() -> None:
    server, client = await udp_pair()
    try:
        server.link.send(b"answer", ("127.0.0.1", 0))  # Linux: EINVAL
        client.link.send(b"last", client.link.remote)
        assert (await server.next())[0] == b"last"
        assert sum(server.link.counters.dropped.values()) == 1
    finally:
        await client.close()
        await server.close()


@pytest.mark.parametrize("error", [*PASSING[1:], *FATAL, errno.EPIPE, errno.ECONNRESET, errno.ETIMEDOUT], ids=names)
@pytest.mark.parametrize("call", ["recv_into", "send"])
async def test_a_tcp_connection_that_fails_is_opened_again(
    call: str, error: int, faults: Faults, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("msbot_agent.link.net.tcp.RECONNECT_S", 0.01)
    left = faults.of(call)
    server = Ear(TcpServerLink("127.0.0.1", 0))
    await server.until_up()
    client = Ear(TcpClientLink("127.0.0.1", server.link.port))
    try:
        await _says(client, server, b"first")
        left.append(error)
        async with asyncio.timeout(WAIT_S):
            while left:
                with suppress(LinkDown):
                    client.link.send(b"lost", client.link.remote)
                await asyncio.sleep(0.001)
        await _says(client, server, b"last")
        assert not server.task.done()
        assert not client.task.done()
    finally:
        await client.close()
        await server.close()


async def _says(client: Ear, server: Ear, words: bytes) -> None:
    """Send until it has come: a connection that breaks loses what was on its way."""
    async with asyncio.timeout(WAIT_S):
        while True:
            with suppress(LinkDown):
                client.link.send(words, client.link.remote)
            with suppress(TimeoutError):
                while (await asyncio.wait_for(server.heard.get(), 0.02))[0] != words:
                    pass
                return


@pytest.mark.parametrize("error", [*PASSING, *FATAL], ids=names)
@pytest.mark.parametrize("call", ["recvmsg", "sendto"])
async def test_a_request_that_cannot_be_read_or_answered_does_not_end_discovery(
    call: str, error: int, faults: Faults
) -> None:
    problems: list[dict[str, Any]] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _loop, context: problems.append(context))
    left = faults.of(call)
    responder = DiscoveryResponder(8888, port=0, interface="127.0.0.1")
    task = asyncio.create_task(responder.run())
    try:
        await until(lambda: responder.address is not None)
        assert responder.address is not None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.setblocking(False)
            client.connect(("127.0.0.1", responder.address[1]))
            left.append(error)
            client.send(REQUEST)
            await until(lambda: not left)
            client.send(REQUEST)
            assert await asyncio.wait_for(loop.sock_recv(client, 2000), WAIT_S)
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    assert not problems


class Protocol(asyncio.Protocol):
    """Keeps what comes."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.lost: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()

    def data_received(self, data: bytes) -> None:
        self.data += data

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost.set_result(exc)


@pytest.mark.parametrize("error", [errno.EAGAIN, errno.EIO, errno.ENODEV, errno.ENXIO, errno.EBADF], ids=names)
@pytest.mark.parametrize("call", ["read", "write"])
async def test_a_serial_line_reads_and_writes_piece_by_piece_and_ends_when_its_adapter_has_gone(
    call: str, error: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, other = socket.socketpair()
    with ours, other:
        left = [error]
        real_read, real_write = os.read, os.write

        def fail(name: str) -> None:
            if name == call and left:
                raise OSError(number := left.pop(), os.strerror(number))

        def read(descriptor: int, _size: int) -> bytes:
            fail("read")
            return real_read(descriptor, 1)  # as short as it may be

        def write(descriptor: int, data: Any) -> int:
            fail("write")
            return real_write(descriptor, bytes(data[:1]))

        monkeypatch.setattr("msbot_agent.link.serial.pty.os.read", read)
        monkeypatch.setattr("msbot_agent.link.serial.pty.os.write", write)
        protocol = Protocol()
        transport = DescriptorTransport(ours.fileno(), protocol)
        other.setblocking(False)
        loop = asyncio.get_running_loop()
        await loop.sock_sendall(other, b"to us")
        transport.write(b"to them")
        if error == errno.EAGAIN:
            got = b""
            async with asyncio.timeout(WAIT_S):
                while len(got) < len(b"to them"):
                    got += await loop.sock_recv(other, 100)
            await until(lambda: len(protocol.data) == len(b"to us"))
            assert (got, bytes(protocol.data)) == (b"to them", b"to us")
            transport.close()
            assert await protocol.lost is None
        else:
            found = await asyncio.wait_for(protocol.lost, WAIT_S)
            assert isinstance(found, OSError)
            assert found.errno == error
