"""WebSockets of the page's server: packets take the short way, everything else uvicorn's, with the same result."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from random import Random
from typing import Any

import pytest
import uvicorn
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.uri import parse_uri

from msbot.process.virtual_time import run_virtual
from msbot_web.part_websocket import PACKETS
from msbot_web.websocket_connection import MOST_AT_ONCE, WebSocketConnection
from tests.effort import THOROUGH

MOST = 4000
"""Octets of a message here."""
QUEUE = 4


class Wire(asyncio.Transport):
    """The server's end of a connection without a network, and the client's library at the other."""

    def __init__(self, path: str = "/api/link") -> None:
        super().__init__()
        self.client = ClientProtocol(parse_uri(f"ws://robot{path}"), extensions=None)
        self.client.extensions = []
        self.client.available_extensions = [_deflate()]
        self.reads: list[bool] = []
        """Each change of whether the server reads."""
        self.is_closed = False
        self.written = bytearray()

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return ("127.0.0.1", 1) if name in ("peername", "sockname") else default

    def write(self, data: Any) -> None:
        self.written += data
        self.client.receive_data(bytes(data))

    def pause_reading(self) -> None:
        self.reads.append(False)

    def resume_reading(self) -> None:
        self.reads.append(True)

    def is_closing(self) -> bool:
        return self.is_closed

    def close(self) -> None:
        self.is_closed = True


def _deflate() -> Any:
    from websockets.extensions.permessage_deflate import ClientPerMessageDeflateFactory

    return ClientPerMessageDeflateFactory()


class Site:
    """A connection, with an application that does nothing by itself."""

    def __init__(self, kind: type[WebSocketsSansIOProtocol], path: str = "/api/link") -> None:
        config = uvicorn.Config(
            self._serve, log_level="critical", lifespan="off", interface="asgi3", ws_max_size=MOST, ws_max_queue=QUEUE
        )
        config.load()
        self.scope: dict[str, Any] = {}
        self.over = asyncio.Event()
        self.heard: list[object] = []
        """What came to the application."""
        self.wire = Wire(path)
        self.line = kind(config=config, server_state=ServerState(), app_state={})
        self.line.connection_made(self.wire)
        self.wire.client.send_request(self.wire.client.connect())
        self.line.data_received(b"".join(self.wire.client.data_to_send()))

    async def _serve(self, scope: Any, receive: Any, send: Any) -> None:
        self.scope, self.receive, self.send = scope, receive, send
        await receive()
        await send({"type": "websocket.accept"})
        await self.over.wait()

    async def hear(self) -> None:
        """Take the messages that have come."""
        while True:
            message = await self.receive()
            self.heard.append(message.get("bytes", message.get("text", message.get("code"))))
            if message["type"] == "websocket.disconnect":
                return


async def site_of(kind: type[WebSocketsSansIOProtocol] = WebSocketConnection, path: str = "/api/link") -> Site:
    site = Site(kind, path)
    for _ in range(3):
        await asyncio.sleep(0)
    return site


def _note(heard: list[Any], packet: bytes) -> float:
    heard.append(packet)
    return 0.0


def frame(opcode: Opcode, octets: bytes, *, fin: bool = True, mask: bool = True, rsv1: bool = False) -> bytes:
    try:
        return Frame(opcode, octets, fin, rsv1).serialize(mask=mask)
    except Exception:  # what is not allowed can be written all the same
        head = bytes(((0x80 if fin else 0) | (0x40 if rsv1 else 0) | opcode, (0x80 if mask else 0) | len(octets)))
        return head + (bytes(4) if mask else b"") + octets


def binary(octets: bytes) -> bytes:
    return frame(Opcode.BINARY, octets)


def some_frames(dice: Random) -> Iterator[bytes]:
    """What a client may say."""
    for _ in range(dice.randrange(1, 12)):
        kind = dice.randrange(34)
        octets = dice.randbytes(dice.choice((0, 1, 20, 125, 126, 127, 300, 3000)))
        if kind < 24:
            yield binary(octets)
        elif kind < 29:
            yield frame(Opcode.PING, octets[:125])
        elif kind < 31:
            yield frame(Opcode.TEXT, octets.hex().encode()[:MOST])
        else:
            yield frame(Opcode.BINARY, octets, fin=False)
            yield frame(Opcode.PONG, b"")
            yield frame(Opcode.CONT, octets[:900])


def last_frame(dice: Random) -> bytes:
    """What ends a connection: a mistake, or that it is closed."""
    octets = dice.randbytes(dice.choice((0, 1, 20, 125)))
    return dice.choice(
        (
            frame(Opcode.CLOSE, b"\x03\xe8bye"),
            frame(Opcode.CLOSE, b"\x03"),
            frame(Opcode.BINARY, octets, mask=False),
            frame(Opcode.BINARY, octets, rsv1=True),
            frame(Opcode.CONT, octets),
            frame(Opcode.PING, b"x", fin=False),
            frame(Opcode.TEXT, b"\xff\xfe"),
            bytes((0x83, 0x80, 0, 0, 0, 0)),
            binary(bytes(MOST + 1)),
            binary(bytes(70_000)),
        )
    )


def pieces(dice: Random, octets: bytes) -> Iterator[bytes]:
    most = dice.choice((1, 3, 50, 100_000)) if len(octets) < 2000 else dice.choice((700, 100_000))
    at = 0
    while at < len(octets):
        size = dice.randrange(1, most + 1)
        yield octets[at : at + size]
        at += size


class Alone(WebSocketsSansIOProtocol):
    """uvicorn's own, without compression."""

    def handle_connect(self, event: Request) -> None:
        self.conn.available_extensions = []
        super().handle_connect(event)


async def _heard_by(kind: type[WebSocketsSansIOProtocol], parts: Sequence[bytes]) -> tuple[list[object], bytes, bool]:
    site = await site_of(kind)
    site.wire.written.clear()
    if kind is WebSocketConnection:
        site.scope["state"][PACKETS].carry(lambda packet: _note(site.heard, packet))
    hearing = asyncio.create_task(site.hear())
    for part in parts:
        if not site.wire.is_closed:
            site.line.data_received(part)
        await asyncio.sleep(0.01)
    result = list(site.heard), bytes(site.wire.written), site.wire.is_closed
    hearing.cancel()
    site.over.set()
    await asyncio.gather(hearing, return_exceptions=True)
    return result


@pytest.mark.parametrize("seed", range(1000 if THOROUGH else 40))
def test_whatever_comes_is_taken_and_answered_as_by_uvicorn_alone(seed: int) -> None:
    dice = Random(seed)
    # The last frame comes by itself: uvicorn throws away what is right before a mistake in one piece.
    right, last = b"".join(some_frames(dice)), last_frame(dice)
    parts = [*pieces(dice, right), *pieces(dice, last)]
    alone, short = (run_virtual(_heard_by(kind, parts)) for kind in (Alone, WebSocketConnection))
    assert short == alone
    assert short[0]


def test_a_packet_goes_straight_to_who_takes_it_and_straight_out() -> None:
    async def scene() -> None:
        site = await site_of()
        carrier = site.scope["state"][PACKETS]
        taken: list[bytes] = []
        carrier.carry(lambda packet: _note(taken, packet))
        turns = asyncio.get_running_loop().call_soon(taken.append, b"later")
        for octets in (b"", b"x", bytes(125), bytes(126), bytes(3999)):
            site.line.data_received(binary(octets))
        assert [len(one) for one in taken] == [0, 1, 125, 126, 3999]
        turns.cancel()
        site.wire.client.events_received()
        for size in (0, 1, 125, 126, 0xFFFF):
            assert carrier.send_packet(bytes(size))
        assert [len(one.data) for one in site.wire.client.events_received()] == [0, 1, 125, 126, 0xFFFF]  # type: ignore[union-attr]
        assert carrier.send_packet("Grüße")
        (text,) = site.wire.client.events_received()
        assert (text.opcode, bytes(text.data)) == (Opcode.TEXT, "Grüße".encode())  # type: ignore[union-attr]
        assert not carrier.send_packet(bytes(0x10000))
        assert site.wire.reads == []  # reading went on all the time
        site.line.pause_writing()
        assert not carrier.send_packet(b"x")
        site.line.resume_writing()
        assert carrier.send_packet(b"x")
        await site.send({"type": "websocket.close", "code": 1000})
        assert not carrier.send_packet(b"x")
        site.over.set()

    run_virtual(scene())


def test_who_may_not_send_more_is_not_read_for_so_long() -> None:
    async def scene() -> None:
        site = await site_of()
        taken: list[tuple[float, bytes]] = []
        time = asyncio.get_running_loop().time

        def take(packet: bytes) -> float:
            taken.append((time(), packet))
            return 2.0 if packet == b"slow" else 0.0

        site.scope["state"][PACKETS].carry(take)
        began, last = time(), binary(b"3")
        site.line.data_received(binary(b"1") + binary(b"slow") + binary(b"2") + last[:4])
        assert site.wire.reads == [False]
        site.line.data_received(last[4:])  # it was on its way
        await asyncio.sleep(1.9)
        assert [packet for _, packet in taken] == [b"1", b"slow"]
        await asyncio.sleep(0.2)
        assert [(round(at - began, 2), packet) for at, packet in taken[2:]] == [(2.0, b"2"), (2.0, b"3")]
        assert site.wire.reads == [False, True]
        site.over.set()

    run_virtual(scene())


def test_so_many_packets_are_taken_at_once_and_then_everything_else_has_its_turn() -> None:
    async def scene() -> None:
        site = await site_of()
        taken: list[bytes] = []
        site.scope["state"][PACKETS].carry(lambda packet: _note(taken, packet))
        site.line.data_received(binary(b"x") * (2 * MOST_AT_ONCE + 1))
        assert len(taken) == MOST_AT_ONCE
        asyncio.get_running_loop().call_soon(taken.append, b"something else")
        await asyncio.sleep(0.01)
        assert len(taken) == 2 * MOST_AT_ONCE + 2
        assert taken.index(b"something else") == MOST_AT_ONCE
        assert site.wire.reads[-1]
        site.over.set()

    run_virtual(scene())


def test_reading_stops_only_when_messages_wait() -> None:
    async def scene() -> None:
        site = await site_of(path="/_nicegui_ws/socket.io/")
        hearing = asyncio.create_task(site.hear())
        for number in range(10):
            site.line.data_received(frame(Opcode.TEXT, str(number).encode()))
            await asyncio.sleep(0.01)
        assert site.wire.reads == []
        site.line.data_received(b"".join(frame(Opcode.TEXT, str(number).encode()) for number in range(10, 20)))
        assert site.wire.reads == [False]
        await asyncio.sleep(0.01)
        assert site.wire.reads == [False, True]
        assert site.heard == [str(number) for number in range(20)]
        hearing.cancel()
        site.over.set()
        await asyncio.gather(hearing, return_exceptions=True)

    run_virtual(scene())


@pytest.mark.parametrize(
    ("path", "is_compressed"), [("/live", False), ("/robot/api/link", False), ("/_nicegui_ws/socket.io/", True)]
)
def test_only_what_is_neither_packed_nor_short_is_compressed(path: str, is_compressed: bool) -> None:
    async def scene() -> None:
        site = await site_of(path=path)
        assert (b"permessage-deflate" in site.wire.written) is is_compressed
        assert (PACKETS in site.scope["state"]) is not is_compressed
        site.over.set()

    run_virtual(scene())
