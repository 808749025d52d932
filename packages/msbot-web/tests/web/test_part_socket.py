"""Parts that come in by the page: who may, both steps and the gate like any part, and the end of it all."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from starlette.websockets import WebSocket

from msbot.operations.rights import Role
from msbot.process.virtual_time import run_virtual
from msbot_agent.link.net import WebSocketServerLink
from msbot_web.access.accounts import Accounts
from msbot_web.access.users import MemoryUsers
from msbot_web.part_websocket import AGAIN, CHECK_S, REFUSED, WRONG, PartWebSocket
from msbot_web.websocket_connection import WebSocketConnection
from msbot_xrce.errors import LinkDown
from tests.link.ends import End
from tests.web.access.test_accounts import PlainHasher, user
from tests.web.part_site import part_site


async def test_a_part_that_comes_by_the_page_is_a_part_like_any_other() -> None:
    async with part_site() as site:
        heard: list[bytes] = []
        token = await site.token("bob")
        async with site.part(0, token):
            await site.until(lambda: site.active() == {"S0"})
            (info,) = site.master.inventory.view(asyncio.get_running_loop().time())
            assert info.address.startswith("ws:test bob at 127.0.0.1") or "bob at 127.0.0.1" in info.address
            site.link.tap = lambda _now, way, _peer, packet: heard.append(packet) if way == "in" else None
            await site.until(lambda: len(heard) >= 3)
        await site.until(lambda: site.active() == set())


async def test_packets_of_a_part_pass_no_queue_of_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[object] = []
    receive, send = WebSocketConnection.receive, WebSocketConnection.send

    async def seen_receive(line: WebSocketConnection) -> Any:
        waited.append("receive")
        return await receive(line)

    async def seen_send(line: WebSocketConnection, message: Any) -> None:
        waited.append(message["type"])
        await send(line, message)

    monkeypatch.setattr(WebSocketConnection, "receive", seen_receive)
    monkeypatch.setattr(WebSocketConnection, "send", seen_send)
    async with part_site() as site, site.part(0, await site.token("bob")):
        await site.until(lambda: site.active() == {"S0"})
        await site.until(lambda: site.link.counters.packets_in > 10)
        assert site.link.counters.packets_out > 3
        assert waited == ["receive", "websocket.accept", "receive"]


async def test_who_may_not_run_parts_reads_why() -> None:
    async with part_site() as site:
        for token, words in (
            ("msbot_wrong", r"the page does not let this part in: \$MSBOT_TOKEN has to hold an API token"),
            (await site.token("vic"), r"a viewer may not run parts; a student may"),
        ):
            with pytest.raises(LinkDown, match=words):
                await asyncio.wait_for(site.client(token).run(), 30)
        assert site.guard.refused == {"sign in first": 1}


async def test_a_part_whose_token_is_taken_away_goes() -> None:
    async with part_site() as site:
        token = await site.token("bob")
        link = site.client(token)
        ended = asyncio.create_task(link.run())
        await site.until(lambda: link.has_room(link.remote))
        link.send(b"x", link.remote)
        await site.accounts.remove_token("bob", "test", who="ada")
        with pytest.raises(LinkDown, match="you are signed out"):
            await asyncio.wait_for(ended, 30)


async def test_a_connection_that_breaks_is_made_again() -> None:
    async with part_site() as site, site.part(0, await site.token("bob")):
        await site.until(lambda: site.active() == {"S0"})
        site.break_all()
        await site.until(lambda: not site.active())
        await site.until(lambda: site.active() == {"S0"})


@asynccontextmanager
async def proxy(status: bytes = b"200 OK") -> AsyncIterator[tuple[int, list[str]]]:
    """A proxy that knows CONNECT, as a school's: its port, and the places it was asked for."""
    asked: list[str] = []
    work: set[asyncio.Task[None]] = set()

    async def copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while octets := await reader.read(4096):
                writer.write(octets)
            writer.close()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        method, place, _ = (await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")[0].split(" ")
        asked.append(f"{method} {place}")
        writer.write(b"HTTP/1.1 " + status + b"\r\n\r\n")
        if not status.startswith(b"200"):
            writer.close()
            return
        theirs = await asyncio.open_connection(*place.split(":"))
        for ends in ((reader, theirs[1]), (theirs[0], writer)):
            work.add(asyncio.create_task(copy(*ends)))

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1], asked
    finally:
        server.close()
        for task in work:
            task.cancel()
        await asyncio.gather(*work, return_exceptions=True)


async def test_a_part_comes_through_the_proxy_that_the_environment_names(monkeypatch: pytest.MonkeyPatch) -> None:
    async with part_site() as site, proxy() as (port, asked):
        monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{port}")
        monkeypatch.setenv("no_proxy", "")
        async with site.part(0, await site.token("bob")):
            await site.until(lambda: site.active() == {"S0"})
        assert asked == [f"CONNECT 127.0.0.1:{site.port}"]


@pytest.mark.parametrize(
    ("status", "named", "words"),
    [
        (b"407 Proxy Authentication Required", "http", r"the proxy wants a name and a password .* HTTP status 407"),
        (b"403 Forbidden", "http", "the proxy refuses the way, HTTP status 403: check http_proxy"),
        (b"200 OK", "ftp", "check http_proxy and https_proxy"),
    ],
)
async def test_a_proxy_that_refuses_is_told_in_one_sentence(
    status: bytes, named: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with part_site() as site, proxy(status) as (port, _):
        monkeypatch.setenv("http_proxy", f"{named}://127.0.0.1:{port}")
        monkeypatch.setenv("no_proxy", "")
        with pytest.raises(LinkDown, match=words):
            await asyncio.wait_for(site.client(await site.token("bob")).run(), 30)


class Fake:
    """The server's end of a WebSocket without a server, in virtual time."""

    def __init__(self, accounts: Accounts, link: WebSocketServerLink, role: Role = Role.STUDENT) -> None:
        self.inbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.sent: list[dict[str, Any]] = []
        self.session = accounts.sessions.begin("bob", role)
        scope = {
            "type": "websocket",
            "path": "/api/link",
            "headers": [],
            "client": ("10.0.0.7", 4711),
            "state": {"session": self.session},
        }
        self.inbox.put_nowait({"type": "websocket.connect"})
        socket = WebSocket(scope, self.inbox.get, self._send)
        self.task = asyncio.get_running_loop().create_task(PartWebSocket(link, accounts).serve(socket))

    async def _send(self, message: Any) -> None:
        self.sent.append(dict(message))

    def bring(self, octets: bytes) -> None:
        self.inbox.put_nowait({"type": "websocket.receive", "bytes": octets})

    @property
    def closed(self) -> tuple[int, str]:
        last = self.sent[-1]
        assert last["type"] == "websocket.close"
        return last["code"], last["reason"]


def play(scene: Callable[[Accounts, WebSocketServerLink], Any]) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        accounts = Accounts(MemoryUsers(user("bob", Role.STUDENT)), clock=loop.time, hasher=PlainHasher())
        link = WebSocketServerLink("ws:test")
        task = loop.create_task(link.run())
        await asyncio.sleep(0)
        await scene(accounts, link)
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    run_virtual(main())


def test_a_connection_that_brings_nothing_is_closed() -> None:
    async def scene(accounts: Accounts, link: WebSocketServerLink) -> None:
        one = Fake(accounts, link)
        await one.task
        assert one.closed == (WRONG, "no packet came")
        assert asyncio.get_running_loop().time() == pytest.approx(12, abs=3)

    play(scene)


def test_text_empty_and_huge_messages_are_refused_in_words() -> None:
    async def scene(accounts: Accounts, link: WebSocketServerLink) -> None:
        for message, words in (
            ({"text": "hello"}, "a part sends packets of DDS-XRCE in binary messages, and no text"),
            ({"bytes": b""}, "a packet has 1 to 65535 bytes, not 0"),
            ({"bytes": bytes(65536)}, "a packet has 1 to 65535 bytes, not 65536"),
        ):
            one = Fake(accounts, link)
            one.inbox.put_nowait({"type": "websocket.receive", **message})
            await one.task
            assert one.closed == (WRONG, words)
        assert sum(link.counters.dropped.values()) == 3

    play(scene)


def test_who_is_signed_out_loses_the_part() -> None:
    async def scene(accounts: Accounts, link: WebSocketServerLink) -> None:
        one = Fake(accounts, link)
        one.bring(b"x")
        await asyncio.sleep(60)
        assert not one.task.done()
        accounts.sign_out(one.session)
        await asyncio.sleep(CHECK_S + 0.1)
        assert one.closed == (REFUSED, "you are signed out, or may not run parts any more")

    play(scene)


def test_a_robot_that_does_not_serve_says_try_again() -> None:
    async def scene(accounts: Accounts, _: WebSocketServerLink) -> None:
        one = Fake(accounts, WebSocketServerLink("ws:other"))
        await one.task
        assert one.closed == (AGAIN, "the robot starts or ends just now: try again in a moment")

    play(scene)


def test_who_is_too_fast_is_read_slower_and_told_once() -> None:
    async def scene(accounts: Accounts, link: WebSocketServerLink) -> None:
        one = Fake(accounts, link)
        for _ in range(10_000):
            one.bring(b"0123456789")
        await asyncio.sleep(10)
        assert 5000 <= link.counters.packets_in <= 6000
        told = [message["text"] for message in one.sent if "text" in message]
        assert told == ["this part sends more than the robot takes from one part: send less often"]
        one.inbox.put_nowait({"type": "websocket.disconnect", "code": 1001})
        await one.task

    play(scene)


def test_packets_wait_for_a_slow_part_until_there_are_too_many() -> None:
    async def scene(accounts: Accounts, link: WebSocketServerLink) -> None:
        room: list[object] = []
        end = End(link)
        link.attach(room=room.append)
        one = Fake(accounts, link)
        one.bring(b"x")
        await asyncio.sleep(0.1)
        _, peer = await end.packets.get()
        sent = 0
        while link.has_room(peer):
            link.send(bytes(1000), peer)
            sent += 1
        assert sent == 66
        await asyncio.sleep(1)
        assert room == [peer]
        assert sum("bytes" in message for message in one.sent) == sent
        one.inbox.put_nowait({"type": "websocket.disconnect", "code": 1000})
        await one.task
        assert not link.has_room(peer)
        with pytest.raises(LinkDown):
            link.send(b"x", peer)

    play(scene)
