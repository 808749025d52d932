"""Where parts come in through the page: `/api/link`, one WebSocket for each part (docs/reference/links.md).

The guard has checked host, origin and session; this file checks, repeatedly, that the person may have parts. Only the
agent interprets the packets: a part that comes in here meets the same gate as any other.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any, Final, Protocol

from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from msbot.operations.rights import Right
from msbot_agent.link import ConnectionUser
from msbot_agent.link.net import PART_PATH, SocketPeer, WebSocketServerLink
from msbot_agent.text.sentence import said
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.language import language_of
from msbot_xrce.errors import LinkDown, LinkFull

CHECK_S = 3.0
"""Longest time that a part stays after its person was signed out, or lost the right to run parts."""
REFUSED = 4403
WRONG = 4400
AGAIN = 4503
"""Closing code of a temporary refusal: the client may try again."""
PACKETS: Final = "packets"
"""Where a request's state has the `PacketCarrier` of its connection."""
_Ending = tuple[int, str]
"""With which code it is closed, 0: it was by itself; and why."""


class PacketCarrier(Protocol):
    """A connection's short way for packets, past queues and tasks (`websocket_connection.py`)."""

    def carry(self, take: Callable[[bytes], float]) -> None:
        """Give packets to `take`, which says for how many seconds nothing more may be read.

        What cannot go that way comes as messages, as before.
        """

    def send_packet(self, packet: bytes | str) -> bool:
        """Send a packet, or a text; False: it cannot be sent at once."""


class PartWebSocket:
    """Serves the connections of a `WebSocketServerLink`.

    Args:
        link: where packets go.
        accounts: who may have parts.
    """

    def __init__(self, link: WebSocketServerLink, accounts: Accounts) -> None:
        self._link = link
        self._accounts = accounts

    def route(self) -> WebSocketRoute:
        """The place in the server."""
        return WebSocketRoute(PART_PATH, self.serve)

    async def serve(self, socket: WebSocket) -> None:
        """One connection, from its first octet to its last."""
        session: Session = socket.scope["state"]["session"]
        pupil = self._accounts.guests.pupil_behind(session)
        may_stay = self._condition(session, socket, pupil)
        tell = language_of(socket).translate
        await socket.accept()
        if not may_stay():
            why = said(
                "{role} may not run parts; {least} may",
                role=said(session.role.with_article),
                least=said(Right.JOIN.least.with_article),
            )
            await socket.close(REFUSED, _short(tell(why)))
            return
        try:
            address = socket.client.host if socket.client else ""
            peer = self._link.join(ConnectionUser(session.name, address, pupil))
        except LinkFull as error:
            await socket.close(REFUSED, _short(tell(str(error))))
            return
        except LinkDown as error:
            await socket.close(AGAIN, _short(tell(str(error))))
            return
        words = "connection closed"
        try:
            words = await self._carry(socket, peer, may_stay)
        finally:
            peer.connection_ended(words)

    async def _carry(self, socket: WebSocket, peer: SocketPeer, may_stay: Callable[[], bool]) -> str:
        """Carry packets until the connection ends; returns why it did."""
        reader = _Reader(socket, peer)
        carrier: PacketCarrier | None = socket.scope["state"].get(PACKETS)
        if carrier is not None:
            carrier.carry(reader.take)
            peer.send_by(carrier.send_packet)
        work: list[asyncio.Future[_Ending]] = [
            reader.ending,
            *map(asyncio.ensure_future, (reader.read(), _write(socket, peer), _watch(peer, may_stay))),
        ]
        try:
            done, _ = await asyncio.wait(work, return_when=asyncio.FIRST_COMPLETED)
        finally:
            every: list[asyncio.Future[Any]] = [*work, *reader.telling]
            for one in every:
                one.cancel()
            await asyncio.gather(*every, return_exceptions=True)
        code, words = done.pop().result()
        if code:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it went by itself meanwhile
                await socket.close(code, _short(language_of(socket).translate(words)))
        return f"connection closed: {words}"

    def _condition(self, session: Session, socket: WebSocket, pupil: str) -> Callable[[], bool]:
        """Whether the person behind a connection may still have parts, as the same pupil or none, at any later moment:
        what a teacher has begun who is a pupil now would else not be held with the others."""
        accounts = self._accounts

        def may_have(one: Session) -> bool:
            return one.may(Right.JOIN) and accounts.guests.pupil_behind(one) == pupil

        if not session.is_program:
            return lambda: accounts.holds(session) and may_have(session)
        token = socket.headers.get("authorization", "").partition(" ")[2].strip()

        def holds() -> bool:
            now = accounts.by_word_of_parts(token)
            return now is not None and may_have(now)

        return holds


async def _watch(peer: SocketPeer, may_stay: Callable[[], bool]) -> _Ending:
    while may_stay():
        if peer.is_silent(asyncio.get_running_loop().time()):
            return WRONG, said("no packet came")
        await asyncio.sleep(CHECK_S)
    return REFUSED, said("you are signed out, or may not run parts any more")


_CLOSINGS = {
    1000: "the program has ended",
    1001: "the page was left, or reloaded",
    1005: "the program has ended",
    1006: "the network broke off",
}
"""Why a browser closes a connection (RFC 6455, 7.4.1), in words."""


class _Reader:
    """Takes what comes on a connection."""

    def __init__(self, socket: WebSocket, peer: SocketPeer) -> None:
        self._socket = socket
        self._peer = peer
        self._loop = asyncio.get_running_loop()
        self.ending: asyncio.Future[_Ending] = self._loop.create_future()
        """What was no packet ends the connection."""
        self.telling: set[asyncio.Task[None]] = set()
        """Sentences on their way to the person."""

    def take(self, packet: bytes) -> float:
        """Take a packet; returns for how many seconds nothing more may be read."""
        if self.ending.done():
            return CHECK_S
        try:
            pause_s, sentence = self._peer.receive(packet, self._loop.time())
        except ValueError as error:
            self.ending.set_result((WRONG, str(error)))
            return CHECK_S
        if sentence:
            words = language_of(self._socket).translate(sentence)
            task = self._loop.create_task(self._tell(words))
            self.telling.add(task)
            task.add_done_callback(self.telling.discard)
        return pause_s

    async def _tell(self, words: str) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it went by itself meanwhile
            await self._socket.send_text(words)

    async def read(self) -> _Ending:
        """Take what comes as messages, until the connection ends."""
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                code = message.get("code", 1005)
                return 0, message.get("reason") or _CLOSINGS.get(code, f"code {code}")
            packet = message.get("bytes")
            if packet is None:
                return WRONG, self._peer.took_text()
            pause_s = self.take(packet)
            if pause_s:
                await asyncio.sleep(pause_s)


async def _write(socket: WebSocket, peer: SocketPeer) -> _Ending:
    try:
        while True:
            await socket.send_bytes(await peer.next_packet())
    except (WebSocketDisconnect, RuntimeError):  # it went by itself meanwhile; Starlette says so in two ways
        return 0, "broken"


def _short(words: str) -> str:
    """A reason as a closing frame has room for: 123 octets (RFC 6455, 5.5)."""
    return words if len(words.encode()) <= 123 else words.encode()[:120].decode("utf-8", "ignore") + "…"
