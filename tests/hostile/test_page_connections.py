"""Connections of the page under attack: half-open ones are closed, and never keep people out; on the loopback."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from msbot_agent import pace as accept_connections
from msbot_agent.pace import ProtocolServer
from msbot_web import connection_limits
from msbot_web.connection_limits import MOST_HEAD, ConnectionLimits, LimitedConnection
from msbot_xrce.counting import Tally
from tests.certificate import Certificate

SIGNED_IN = "/signed-in"
"""Where a request has a session, as the page's guard gives it one."""


async def answer(scope: Scope, receive: Receive, send: Send) -> None:
    """The application: reads the whole body, says how long it was."""
    if scope["path"] == SIGNED_IN:
        scope["state"]["session"] = object()
    octets, more = 0, True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        octets += len(message.get("body", b""))
        more = message.get("more_body", False)
    body = str(octets).encode()
    await send(
        {"type": "http.response.start", "status": 200, "headers": [(b"content-length", str(len(body)).encode())]}
    )
    await send({"type": "http.response.body", "body": body})


class Site:
    def __init__(self, port: int, open_ones: ConnectionLimits, failed: Tally) -> None:
        self.port = port
        self.open = open_ones
        self.failed = failed

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection("127.0.0.1", self.port)

    async def ask(self) -> bytes:
        reader, writer = await self.connect()
        writer.write(b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
        octets = await reader.read()
        writer.close()
        return octets


@asynccontextmanager
async def site(
    most: int = 100, make_socket: type[socket.socket] = socket.socket, tls: ssl.SSLContext | None = None
) -> AsyncIterator[Site]:
    """A server with our connections and nothing else."""
    config = uvicorn.Config(answer, log_level="error", lifespan="off")
    config.load()
    state, open_ones = ServerState(), ConnectionLimits(most)
    with make_socket(socket.AF_INET, socket.SOCK_STREAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        failed = Tally()
        acceptor = ProtocolServer(
            listening,
            lambda: LimitedConnection(open_ones, config, state, {}),
            failed,
            tls=tls,
            make_room=open_ones.make_room,
        )
        task = asyncio.create_task(acceptor.run())
        try:
            yield Site(listening.getsockname()[1], open_ones, failed)
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


async def closed(reader: asyncio.StreamReader) -> bool:
    """Waits until the server has closed a connection."""
    with contextlib.suppress(ConnectionResetError):
        assert await reader.read() == b""
    return True


@pytest.mark.promise("Idle connections keep nobody out")
async def test_who_says_nothing_or_dawdles_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection_limits, "HEAD_S", 0.05)
    monkeypatch.setattr(connection_limits, "BODY_S", 0.05)
    async with site() as server:
        silent, first = await server.connect()
        half, writer = await server.connect()
        writer.write(b"GET / HTTP/1.1\r\nHost: x\r\n")
        body, other = await server.connect()
        other.write(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\nsome")
        for reader in (silent, half, body):
            assert await closed(reader)
        for end in (first, writer, other):
            end.close()
        assert b"200 OK" in await server.ask()
        assert server.open.dropped == 3


async def test_a_connection_waits_for_its_next_request_longer_than_clients_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert httpx.Limits().keepalive_expiry == 5.0 < connection_limits.IDLE_S
    monkeypatch.setattr(connection_limits, "IDLE_S", 0.05)
    async with site() as server:
        reader, writer = await server.connect()
        writer.write(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        assert (await reader.read()).startswith(b"HTTP/1.1 200 OK"), "answered, and closed by and by"
        writer.close()
        assert server.open.dropped == 0


async def test_a_head_without_end_is_refused_and_bodies_and_many_requests_are_not() -> None:
    long = b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"a" * MOST_HEAD
    many = b"GET / HTTP/1.1\r\nHost: x\r\n" + b"X: a\r\n" * (MOST_HEAD // 4)
    body = b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 300000\r\n\r\n" + b"a" * 300_000
    async with site() as server:
        for head in (long, many, b"GET /" + b"a" * MOST_HEAD):
            reader, writer = await server.connect()
            for at in range(0, len(head), 1000):
                writer.write(head[at : at + 1000])
            assert (await reader.read()).startswith(b"HTTP/1.1 431 ")
            writer.close()
        assert server.open.dropped == 3
        reader, writer = await server.connect()
        writer.write(3 * body + 500 * b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        writer.write(b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
        answers = await reader.read()
        assert answers.count(b"HTTP/1.1 200 OK") == 504
        assert answers.count(b"\r\n300000") == 3
        writer.close()


async def until(condition: Callable[[], bool]) -> None:
    while not condition():  # noqa: ASYNC110 - what it waits for is another task's, and has no event
        await asyncio.sleep(0.01)


async def send_until_closed(writer: asyncio.StreamWriter) -> None:
    """Much more than is read of a refused request."""
    for _ in range(100):
        writer.write(b"a" * connection_limits.MOST_LINGER)
        await writer.drain()


async def test_whoever_sends_on_after_a_refusal_reads_it_and_is_closed_after_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connection_limits, "LINGER_S", 300.0)  # it sends for longer, on a busy computer
    async with site() as server:
        reader, writer = await server.connect()
        writer.write(b"GET /" + b"a" * MOST_HEAD)
        await until(lambda: server.open.dropped == 1)
        for _ in range(10):
            writer.write(b"a" * 1000)
            await asyncio.sleep(0.01)  # one by one: the first one after a close would bring the reset
        assert await reader.read() == connection_limits.TOO_LONG
        writer.close()
        monkeypatch.setattr(connection_limits, "LINGER_S", 0.05)
        silent, writer = await server.connect()
        writer.write(b"GET /" + b"a" * MOST_HEAD)
        assert await silent.read() == connection_limits.TOO_LONG
        await until(lambda: not len(server.open))
        writer.close()
        monkeypatch.setattr(connection_limits, "LINGER_S", 300.0)
        _, writer = await server.connect()
        with pytest.raises(ConnectionError):
            await send_until_closed(writer)
        assert server.open.dropped == 3


@pytest.mark.promise("Idle connections keep nobody out")
async def test_many_idle_connections_keep_nobody_out() -> None:
    async with site(most=20) as server:
        idle = [await server.connect() for _ in range(60)]
        for _ in range(5):
            assert b"200 OK" in await server.ask()
        assert len(server.open) <= 20
        assert server.open.dropped >= 40
        for _, writer in idle:
            writer.close()


@pytest.mark.promise("Idle connections keep nobody out")
async def test_one_address_makes_room_among_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection_limits, "MOST_PER_ADDRESS", 5)
    async with site(most=50) as server:
        idle = [await server.connect() for _ in range(20)]
        assert b"200 OK" in await server.ask()
        assert len(server.open) <= 5
        for _, writer in idle:
            writer.close()


async def kept_open(server: Site, path: str = "/") -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """A connection on which one request was answered, and which stays open for the next one."""
    reader, writer = await server.connect()
    await ask_again(reader, writer, path)
    return reader, writer


async def ask_again(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, path: str = "/") -> None:
    writer.write(f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    head = await reader.readuntil(b"\r\n\r\n")
    assert b"200 OK" in head
    await reader.readexactly(1)


@pytest.mark.promise("Idle connections keep nobody out")
async def test_the_open_connection_of_somebody_signed_in_makes_room_last() -> None:
    """Over it comes STOP: neither silent connections nor strangers who ask put it out, however long it was idle."""
    async with site(most=10) as server:
        person = await kept_open(server, SIGNED_IN)
        strangers = [await kept_open(server) for _ in range(6)]
        silent = [await server.connect() for _ in range(40)]
        await ask_again(*person, SIGNED_IN)
        strangers += [await kept_open(server) for _ in range(40)]
        await ask_again(*person, SIGNED_IN)
        while server.open.make_room():  # the process has no descriptor left, again and again
            pass
        assert len(server.open) == 1
        await ask_again(*person, SIGNED_IN)
        for _, writer in (person, *strangers, *silent):
            writer.close()


class Scarce(socket.socket):
    """A listening socket of a process that has no descriptor left, three times."""

    left = 3

    def accept(self) -> tuple[socket.socket, Any]:
        if self.left:
            self.left -= 1
            raise OSError(errno.EMFILE, "Too many open files")
        return super().accept()


@pytest.mark.promise("Idle connections keep nobody out")
async def test_without_descriptors_accepting_pauses_instead_of_spinning(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(accept_connections, "PAUSE_S", 0.01)
    async with site(make_socket=Scarce) as server:
        assert b"200 OK" in await server.ask()
        assert server.failed == {accept_connections.EXHAUSTED: 3}
    assert [record.message for record in caplog.records if record.name == accept_connections.__name__] == [
        "no more connections can be accepted for now: Too many open files"
    ]


class Starved(socket.socket):
    """A listening socket of a process that has descriptors for eight connections."""

    def __init__(self, *how: Any) -> None:
        super().__init__(*how)
        self._accepted: list[socket.socket] = []

    def accept(self) -> tuple[socket.socket, Any]:
        self._accepted = [one for one in self._accepted if one.fileno() != -1]
        if len(self._accepted) == 8:
            raise OSError(errno.EMFILE, "Too many open files")
        found = super().accept()
        self._accepted.append(found[0])
        return found


@pytest.mark.promise("Idle connections keep nobody out")
async def test_without_descriptors_silent_and_dead_connections_make_room_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """However many wait in front of somebody: each takes one turn of the loop, not a pause."""
    monkeypatch.setattr(accept_connections, "PAUSE_S", 3600.0)
    async with site(make_socket=Starved) as server:
        person = await kept_open(server, SIGNED_IN)
        silent = [await server.connect() for _ in range(40)]
        for number in range(40):
            _, writer = await server.connect()
            writer.close()
            if number % 8 == 0:
                assert b"200 OK" in await server.ask()
        await ask_again(*person, SIGNED_IN)
        for _, writer in (person, *silent):
            writer.close()


@pytest.mark.promise("Idle connections keep nobody out")
@pytest.mark.parametrize("make_socket", [socket.socket, Starved])
async def test_connections_that_only_begin_tls_make_room(make_socket: type[socket.socket], tmp_path: Path) -> None:
    """As many as may come at the pace of strangers, each silent from its first octet on."""
    certificate = Certificate(tmp_path)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(certificate.certificate, certificate.key)
    trust = ssl.create_default_context(cafile=certificate.certificate)
    async with site(make_socket=make_socket, tls=tls) as server:
        silent = [await server.connect() for _ in range(2 * accept_connections.MOST_BEGINNING)]
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port, ssl=trust, server_hostname="localhost")
        await ask_again(reader, writer)
        assert await closed(silent[0][0])
        for _, one in (*silent, (reader, writer)):
            one.close()


@pytest.mark.promise("Every request of who may say STOP is a STOP, and a GO ends none that its sayer did not know of")
@pytest.mark.parametrize("rest", [b"zz\r\n", b"2\r\n{}X", b"-1\r\n", b"5\r\nabcde\r\n\xff\xff\r\n"])
@pytest.mark.parametrize("in_pieces", [False, True])
async def test_who_says_stop_in_a_body_that_breaks_off_is_answered(rest: bytes, *, in_pieces: bool) -> None:
    async with site() as server:
        for path, status in ((b"/api/stop", b"200 OK"), (b"/api/go", b"400 Bad Request")):
            reader, writer = await server.connect()
            head = b"POST " + path + b" HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n"
            for piece in (head, rest) if in_pieces else (head + rest,):
                writer.write(piece)
                await writer.drain()
                await asyncio.sleep(0)
            said = await reader.read()
            assert said.startswith(b"HTTP/1.1 " + status), said
            assert said.count(b"HTTP/1.1") == 1
            assert b"connection: close" in said.lower()
            writer.close()
        assert b"200 OK" in await server.ask()
