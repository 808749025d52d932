"""`ws:` of the MicroPython home: at the real page server, in the VM, and against what a server may send."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.homes import micro
from tests.homes.runners import NODE, Engine, NodeEngine, as_micropython
from tests.web.part_site import PartSite, part_site
from tests.web.refusing import refusing_port

TALKER = """\
from msbot import HelloWorld, Part

part = Part("T0")


@part.every(0.1)
def speak():
    part.publish("out", HelloWorld(index=1, message="x"))


part.run()
"""


@pytest.fixture(autouse=True)
def afresh() -> Iterator[None]:
    micro.forget()
    micro.load()
    with as_micropython():
        yield
    micro.forget()


@pytest.fixture
def said() -> list[str]:
    """What the home says to a person."""
    found: list[str] = []
    micro.load("errors").listen(lambda kind, words: found.append(words) if kind == "error" else None)
    return found


# At the real server.


@contextlib.asynccontextmanager
async def a_part(address: str, token: str) -> AsyncIterator[Any]:
    """The home's part, with its link as `msbot.json` names it, stepped as `running.run` does."""
    part = micro.load().Part("T0", uid=bytes(8))
    part.every(0.1)(lambda: part.publish("out", micro.load().HelloWorld(index=1, message="x")))
    loop = asyncio.get_running_loop()
    began_at = loop.time()
    part.begin(micro.load("board").open_link(address, None, token), 0)

    async def run() -> None:
        while part.step(int((loop.time() - began_at) * 1000)) is not None:  # noqa: ASYNC110 - as a board does
            await asyncio.sleep(0.002)

    task = loop.create_task(run())
    try:
        yield part
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        part._client.link.close()


async def test_a_board_joins_by_the_page_publishes_and_comes_back_after_a_break(
    said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(micro.load("websocket"), "_AGAIN", 100)
    async with part_site() as site, a_part(site.address, await site.token("bob")):
        await site.until(lambda: site.active() == {"S0"})
        heard: list[bytes] = []
        site.link.tap = lambda _now, way, _peer, packet: heard.append(packet) if way == "in" else None
        await site.until(lambda: len(heard) >= 3)
        site.break_all()
        await site.until(lambda: not site.active())
        await site.until(lambda: site.active() == {"S0"})
    assert said == []


@pytest.mark.parametrize("who", ["a wrong token", "vic", "nobody at all"])
async def test_who_is_not_let_in_reads_why(said: list[str], who: str) -> None:
    with refusing_port() as port:
        await is_told_why(said, who, port)


async def is_told_why(said: list[str], who: str, refusing: int) -> None:
    async with part_site() as site:
        token = await site.token("vic") if who == "vic" else "msbot_wrong"
        address = f"ws://127.0.0.1:{refusing}" if who == "nobody at all" else site.address
        async with a_part(address, token):
            await site.until(lambda: bool(said))
        host = address.partition("//")[2]
        assert said == [
            {
                "a wrong token": f"the page at {host} does not let this part in: its token is wrong or void",
                "vic": f"the page at {host} says: a viewer may not run parts; a student may",
                "nobody at all": f"the page at {host} cannot be reached: [Errno 111] Connection refused",
            }[who]
        ]


async def carry(engine: Engine, site: PartSite, *, and_s: float = 0.0) -> dict[str, Any]:
    """Run a part in a VM until it is active, and for some seconds more.

    The VM has no sockets: its octets go from here to the server, unchanged but for token and port.
    """
    token = (await site.token("bob")).encode()
    reader, writer = await asyncio.open_connection("127.0.0.1", site.port)
    loop = asyncio.get_running_loop()
    began_at, active_at, came = loop.time(), None, asyncio.create_task(reader.read(1024))
    answer = engine.ask({"do": "start", "program": TALKER, "name": "t.py", "link": "ws", "uid": "00" * 8, "now": 0})
    try:
        async with asyncio.timeout(60):
            # A part that stood still for long may be out for a moment.
            while (
                active_at is None
                or loop.time() < active_at + and_s
                or answer["state"][0] != "active"
                or site.active() != {"S0"}
            ):
                arrived = [came.result().hex()] if came.done() else []
                if arrived:
                    came = asyncio.create_task(reader.read(1024))
                now = int((loop.time() - began_at) * 1000)
                answer = engine.ask({"do": "step", "now": now, "in": arrived, "room": 0, "pending": 0})
                for octets in answer["out"]:
                    plain = bytes.fromhex(octets).replace(b"Bearer a token", b"Bearer " + token)
                    writer.write(plain.replace(b"Host: 127.0.0.1:8080", b"Host: 127.0.0.1:%d" % site.port))
                if active_at is None and answer["state"][0] == "active":
                    active_at = loop.time()
                await asyncio.sleep(0.005)
    finally:
        came.cancel()
        writer.close()
        engine.close()
    return answer


@pytest.mark.skipif(NODE is None, reason="needs node")
async def test_the_vm_joins_by_the_page() -> None:
    async with part_site() as site:
        answer = await carry(NodeEngine(), site)
        assert answer["state"][0] == "active"


# Against whatever a server sends.


class Server:
    """The other end: a stream whose octets the test gives."""

    def __init__(self) -> None:
        self.came: list[bytes] = []
        self.sent = b""
        self.room = 100_000
        self.is_closed = False

    def read(self) -> bytes | None:
        return self.came.pop(0) if self.came else None

    def write(self, octets: bytes) -> int:
        count = min(self.room, len(octets))
        self.sent += octets[:count]
        self.room -= count
        return count

    def close(self) -> None:
        self.is_closed = True


class Link:
    """A link of the home at such a server, with what its client was told."""

    def __init__(self) -> None:
        self.servers: list[Server] = []
        self.told: list[Any] = []
        self.link = micro.load("websocket").WebSocketLink(self._connect, "ws://host:8080", "tok")
        client = SimpleNamespace(
            packet=lambda packet, _now: self.told.append(bytes(packet)),
            link_up=lambda _now: self.told.append("up"),
            link_down=lambda reason, _now: self.told.append(reason),
        )
        self.link.begin(None, client, 0)
        self.link.poll(0)

    def _connect(self) -> Server:
        self.servers.append(Server())
        return self.servers[-1]

    def bring(self, *octets: bytes, now: int = 1) -> None:
        for piece in octets:
            self.servers[-1].came.append(piece)
            self.link.poll(now)

    def join(self) -> None:
        self.bring(b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\n\r\n")
        self.servers[-1].sent = b""


def unmasked(frame: bytes) -> bytes:
    size, at = (frame[1] & 0x7F, 2) if frame[1] & 0x7F < 126 else (int.from_bytes(frame[2:4], "big"), 4)
    mask, content = frame[at : at + 4], frame[at + 4 :]
    assert len(content) == size
    return bytes(octet ^ mask[place % 4] for place, octet in enumerate(content))


def test_the_first_request_and_frames_are_those_of_rfc_6455() -> None:
    one = Link()
    lines = one.servers[0].sent.decode().split("\r\n")
    assert lines[0] == "GET /api/link HTTP/1.1"
    assert {"Host: host:8080", "Upgrade: websocket", "Sec-WebSocket-Version: 13", "Authorization: Bearer tok"} < {
        *lines
    }
    one.link.send(b"dropped: nobody has answered yet", 1)
    one.bring(*(bytes((octet,)) for octet in b"HTTP/1.1 101 x\r\nA: b\r\n\r\n\x82\x03abc\x89\x02hi"))
    assert one.told == ["up", b"abc"]
    pong = one.servers[0].sent[-8:]
    assert (pong[:2], unmasked(pong)) == (b"\x8a\x82", b"hi")
    for size in (0, 125, 126, 512):
        one.servers[0].sent = b""
        packet = (bytes(range(256)) * 2)[:size]
        one.link.send(packet, 1)
        assert unmasked(one.servers[0].sent) == packet


def test_what_the_connection_does_not_accept_waits_and_pieces_become_one_message() -> None:
    one = Link()
    one.join()
    one.servers[0].room = 5
    one.link.send(b"0123456789", 1)
    assert (one.link.has_room(), one.link.due()) == (False, 0)
    one.servers[0].room = 100
    one.link.step(2)
    assert (one.link.has_room(), one.link.due(), unmasked(one.servers[0].sent)) == (True, None, b"0123456789")
    one.bring(b"\x02\x02ab", b"\x89\x00", b"\x00\x01c", b"\x80\x01d", b"\x81\x00")
    assert one.told == ["up", b"abcd"]


@pytest.mark.parametrize(
    ("octets", "reason"),
    [
        (b"\x82\x81mask1", "the page sends what makes no sense"),  # masked, as no server does
        (b"\xc2\x01a", "the page sends what makes no sense"),  # an extension nobody asked for
        (b"\x82\x7f" + bytes(8), "the page sends what makes no sense"),  # longer than any packet
        (b"\x82\x7e\xff\xff", "the page sends what makes no sense"),
        (b"\x02\x7e\x03\xff" + bytes(1023) + b"\x80\x02ab", "the page sends what makes no sense"),
        (b"\x88\x02\x03\xe8", "the connection with the page has ended"),
        (b"\x88\x00", "the connection with the page has ended"),
        (b"", "the connection with the page has ended"),
    ],
)
def test_a_connection_that_ends_or_makes_no_sense_is_made_again(octets: bytes, reason: str) -> None:
    one = Link()
    one.join()
    one.bring(octets)
    assert (one.told, one.servers[0].is_closed) == (["up", reason], True)
    one.link.poll(2000)
    assert len(one.servers) == 1
    one.link.poll(2001)
    assert len(one.servers) == 2


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"HTTP/1.1 401 Unauthorized\r\n\r\n", "does not let this part in: its token is wrong or void"),
        (b"HTTP/1.1 404 Not Found\r\n\r\n", "what answers at host:8080 is no page of MsBOT"),
        (b"SSH-2.0-OpenSSH_9\r\n\r\n", "what answers at host:8080 is no page of MsBOT"),
        (b"x" * 1025, "what answers at host:8080 is no page of MsBOT"),
    ],
)
def test_a_server_that_is_no_page_is_said_once_and_asked_seldom(answer: bytes, words: str, said: list[str]) -> None:
    one = Link()
    one.bring(answer)
    one.link.poll(15_000)
    assert len(one.servers) == 1
    one.link.poll(15_001)
    one.bring(answer, now=15_002)
    assert len(said) == 1
    assert words in said[0]
    assert one.told == []


def test_a_server_that_is_silent_is_left() -> None:
    one = Link()
    one.link.poll(4999)
    assert not one.servers[0].is_closed
    one.link.poll(5000)
    assert one.servers[0].is_closed
    one.link.poll(7000)
    one.join()
    one.link.poll(45_000)
    assert one.told == ["up"]
    one.link.poll(45_001)
    assert one.told == ["up", "the page does not answer"]


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_no_octets_of_a_server_raise_an_exception(pieces: list[bytes]) -> None:
    micro.load("errors").listen(lambda _kind, _words: None)
    one = Link()
    one.join()
    one.bring(*pieces)
    assert len(one.link._came) <= 1024 + 300
