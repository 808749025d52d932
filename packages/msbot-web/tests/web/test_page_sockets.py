"""The websockets of the pages: how fast they are read, how much waits for who reads slowly, and what nonsense becomes.

Random nonsense, in front of socket.io and NiceGUI: `python -m fuzz sockets`.
"""

from __future__ import annotations

import asyncio
import logging

import pytest
from engineio.async_socket import AsyncSocket
from engineio.packet import MESSAGE, Packet
from nicegui import core
from starlette.types import Message, Receive, Scope, Send

from msbot.operations.rights import Role
from msbot.process.virtual_time import run_virtual
from msbot_agent.pace import SteadyRate
from msbot_web.access.sessions import Session
from msbot_web.nicegui_internals.page_sockets import (
    BURST,
    DEEPEST,
    MESSAGES_PER_S,
    MOST_OF_SESSION,
    MOST_WAITING,
    MOST_WAITING_OCTETS,
    NONSENSE,
    OCTETS,
    SAY_S,
    SEND_S,
    TOO_SLOW,
    BrowserComplaints,
    Outgoing,
    PageSocket,
    PageSockets,
    is_well_formed,
)


def socket_of(wire: Wire, pace: SteadyRate | None = None) -> PageSocket:
    return PageSocket(wire.receive, wire.send, pace or SteadyRate(MESSAGES_PER_S, BURST), "ann")


def said(text: str) -> Message:
    return {"type": "websocket.receive", "text": text}


class Wire:
    """What the server has of a browser: what it has said, and whether it takes anything."""

    def __init__(self, *messages: str) -> None:
        self.inbox = [said(one) for one in messages]
        self.reads = asyncio.Event()
        self.sent: list[Message] = []

    async def receive(self) -> Message:
        if not self.inbox:
            await asyncio.get_running_loop().create_future()
        return self.inbox.pop(0)

    async def send(self, message: Message) -> None:
        await self.reads.wait()
        self.sent.append(message)


def test_who_says_too_much_is_read_more_slowly_and_loses_nothing() -> None:
    async def scene() -> None:
        count = int(BURST) + 1000
        wire = Wire(*(f"4{number}" for number in range(count)))
        socket = socket_of(wire)
        started = asyncio.get_running_loop().time()
        heard = [(await socket.receive())["text"] for _ in range(count)]
        assert heard == [f"4{number}" for number in range(count)]
        assert asyncio.get_running_loop().time() - started == pytest.approx(1000 / MESSAGES_PER_S, rel=0.02)

    run_virtual(scene())


def test_all_websockets_of_a_browser_are_read_as_fast_as_one_and_each_has_its_turn() -> None:
    async def scene() -> None:
        pace, heard = SteadyRate(MESSAGES_PER_S, BURST), [0] * 10

        async def listen(number: int) -> None:
            wire = Wire(*["4x"] * 1000)
            socket = socket_of(wire, pace)
            while True:
                await socket.receive()
                heard[number] += 1

        tasks = [asyncio.create_task(listen(number)) for number in range(10)]
        await asyncio.sleep(10.0)
        assert sum(heard) == pytest.approx(BURST + 10 * MESSAGES_PER_S, abs=10)
        assert max(heard) - min(heard[1:]) <= BURST, "the burst is whose comes first; after that they take turns"
        before = heard[:]
        await asyncio.sleep(5.0)
        assert [now - then for now, then in zip(heard, before, strict=True)] == [pytest.approx(100, abs=2)] * 10
        other = PageSocket(*_ends(Wire("4x")), pace, "ben")
        began = asyncio.get_running_loop().time()
        assert (await other.receive())["text"] == "4x"
        assert asyncio.get_running_loop().time() == began, "another browser does not wait"
        for one in tasks:
            one.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(scene())


def _ends(wire: Wire) -> tuple[Receive, Send]:
    return wire.receive, wire.send


def test_a_websocket_that_waits_for_its_turn_can_be_ended() -> None:
    async def scene() -> None:
        pace = SteadyRate(MESSAGES_PER_S, BURST)
        pace.note("ann", asyncio.get_running_loop().time(), 100_000)
        socket = socket_of(Wire("4x"), pace)
        listening = asyncio.create_task(socket.receive())
        await asyncio.sleep(1.0)
        assert not listening.done()
        socket.end()
        began = asyncio.get_running_loop().time()
        assert (await listening)["type"] == "websocket.disconnect"
        assert asyncio.get_running_loop().time() == began

    run_virtual(scene())


def test_a_long_message_counts_as_many() -> None:
    async def scene() -> None:
        count = 20
        wire = Wire(*["4" + "x" * (100 * OCTETS)] * count)
        socket = socket_of(wire)
        started = asyncio.get_running_loop().time()
        for _ in range(count):
            assert len((await socket.receive())["text"]) == 100 * OCTETS + 1
        # The first six are within the burst; then each waits until the one before is made up for.
        owed = (count - 1) * 101 + 1
        assert asyncio.get_running_loop().time() - started == pytest.approx((owed - BURST) / MESSAGES_PER_S, rel=0.02)

    run_virtual(scene())


def test_who_does_not_take_what_is_sent_loses_the_connection() -> None:
    async def scene() -> None:
        wire = Wire()
        socket = socket_of(wire)
        listening = asyncio.create_task(socket.receive())
        started = asyncio.get_running_loop().time()
        with pytest.raises(OSError, match="closed"):
            await socket.send({"type": "websocket.send", "text": "x"})
        assert asyncio.get_running_loop().time() - started == pytest.approx(SEND_S)
        assert (await listening)["type"] == "websocket.disconnect"
        assert (await socket.receive())["type"] == "websocket.disconnect"
        with pytest.raises(OSError, match="closed"):
            await socket.send({"type": "websocket.send", "text": "x"})
        await socket.send({"type": "websocket.close"})  # given up soon, without an error

    run_virtual(scene())


def test_what_waits_for_a_browser_is_bounded_and_its_end_frees_all_of_it() -> None:
    async def scene(octets: int, most: int) -> None:
        wire = Wire()
        socket = socket_of(wire)
        waiting = Outgoing(socket.end)
        sending = asyncio.create_task(socket.send({"type": "websocket.send", "text": "x"}))
        listening = asyncio.create_task(socket.receive())
        for _ in range(most):
            await waiting.put(Packet(MESSAGE, "x" * octets))
        assert waiting.qsize() == most
        assert waiting.octets == most * octets
        await asyncio.sleep(0)
        await waiting.put(Packet(MESSAGE, "x" * octets))
        assert (waiting.qsize(), waiting.octets) == (0, 0)
        assert (await listening)["type"] == "websocket.disconnect"
        with pytest.raises(OSError, match="closed"):
            await sending
        await waiting.put(None)  # how engine.io ends its writer
        assert await waiting.get() is None
        waiting.task_done()
        await asyncio.wait_for(waiting.join(), 1.0)

    run_virtual(scene(10, MOST_WAITING))
    run_virtual(scene(MOST_WAITING_OCTETS // 4, 4))


def test_one_large_packet_passes() -> None:
    async def scene() -> None:
        waiting = Outgoing(lambda: pytest.fail("nothing else waits"))
        await waiting.put(Packet(MESSAGE, "x" * (2 * MOST_WAITING_OCTETS)))
        assert (await waiting.get()).data
        assert waiting.octets == 0

    run_virtual(scene())


def test_what_is_no_packet_ends_the_connection() -> None:
    async def scene() -> None:
        for text in ("", "x", "b", "9", "é"):
            wire = Wire(text)
            assert (await socket_of(wire).receive())["type"] == "websocket.disconnect"

    run_virtual(scene())


def test_nonsense_is_counted_and_said_once_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    now = 0.0
    complaints = BrowserComplaints(lambda: now)
    with caplog.at_level(logging.WARNING):
        for _ in range(100):
            complaints.count(NONSENSE, "event")
        complaints.count(TOO_SLOW, "too much waits for it")
        now = SAY_S
        complaints.count(NONSENSE, "event")
    assert [record.message for record in caplog.records] == [
        f"a browser of the page {NONSENSE} (event): 1 time so far",
        f"a browser of the page {TOO_SLOW} (too much waits for it): 1 time so far",
        f"a browser of the page {NONSENSE} (event): 101 times so far",
    ]


HANDSHAKE: dict[str, object] = {"tab_id": "t", "document_id": "d", "next_message_id": "12", "old_tab_id": None}
EVENT: dict[str, object] = {"id": 4, "listener_id": "l", "args": ["1", None]}


@pytest.mark.parametrize(
    ("name", "message", "fits"),
    [
        ("handshake", HANDSHAKE, True),
        ("handshake", {**HANDSHAKE, "next_message_id": 0, "old_tab_id": "x"}, True),
        ("handshake", {**HANDSHAKE, "next_message_id": "9" * 5000}, False),
        ("handshake", {**HANDSHAKE, "next_message_id": "x"}, False),
        ("handshake", {**HANDSHAKE, "document_id": {}}, False),
        ("handshake", {**HANDSHAKE, "tab_id": "x" * 101}, False),
        ("handshake", {}, False),
        ("event", EVENT, True),
        ("event", {"id": 4, "listener_id": "l"}, True),
        ("event", {**EVENT, "id": []}, False),
        ("event", {**EVENT, "listener_id": None}, False),
        ("event", {**EVENT, "args": "x"}, False),
        ("event", {**EVENT, "args": [1]}, False),
        ("event", {**EVENT, "args": ["[" * DEEPEST + "]" * DEEPEST]}, True),
        ("event", {**EVENT, "args": ["[" * (DEEPEST + 1) + "]" * (DEEPEST + 1)]}, False),
        ("event", {**EVENT, "args": ["[]," * 1000]}, True),
        ("event", {**EVENT, "args": ['{"a": "' + "[" * 1000 + '"}']}, True),
        ("event", {**EVENT, "args": ['{"a": "\\"' + "[" * 1000 + '"}']}, True),
        ("event", {**EVENT, "args": ['["\\\\", ' + "[" * 1000]}, False),
        ("javascript_response", {"request_id": "r"}, True),
        ("javascript_response", {"request_id": []}, False),
        ("ack", {"next_message_id": 3}, True),
        ("ack", {"next_message_id": "3"}, False),
        ("ack", {"next_message_id": 1 << 60}, False),
        ("left", {}, True),
    ],
)
def test_a_message_has_what_nicegui_takes_for_granted(name: str, message: dict[str, object], *, fits: bool) -> None:
    assert is_well_formed(name, message) is fits


async def test_a_connection_by_long_polling_is_of_the_session_that_began_it(monkeypatch: pytest.MonkeyPatch) -> None:
    handlers = dict(core.sio.eio.handlers)
    asked: list[str] = []

    async def app(scope: Scope, receive: Receive, _send: Send) -> None:
        await receive()
        asked.append(scope["query_string"].decode())

    async def connect(_sid: str, _environ: object) -> None: ...

    monkeypatch.setitem(core.sio.eio.handlers, "connect", connect)
    sockets = PageSockets(app)
    ada, eve = (Session(name, Role.STUDENT, 0.0, 0.0, key=name) for name in ("ada", "eve"))

    async def ask(session: Session, query: str) -> int:
        answers: list[Message] = []

        async def receive() -> Message:
            return {"type": "http.request", "body": b"2"}

        async def send(message: Message) -> None:
            answers.append(message)

        scope = {
            "type": "http",
            "path": "/_nicegui_ws/socket.io/",
            "query_string": query.encode(),
            "headers": [],
            "state": {"session": session},
        }
        await sockets(scope, receive, send)
        return answers[0]["status"] if answers else 200

    try:
        assert await ask(ada, "transport=polling") == 200
        monkeypatch.setitem(core.sio.eio.sockets, "s1", AsyncSocket(core.sio.eio, "s1"))
        await core.sio.eio.handlers["connect"]("s1", {"asgi.scope": {"state": {"session": ada}}})
        assert await ask(ada, "transport=polling&sid=s1") == 200
        assert await ask(eve, "transport=polling&sid=s1") == 403, "whoever knows its number is not its owner"
        assert await ask(eve, "transport=polling&sid=s2") == 403
        assert await ask(ada, "transport=polling&j=0") == 403, "JSONP, which another site could read"
        assert isinstance(core.sio.eio.sockets["s1"].queue, Outgoing), "what waits for it is bounded"
        for number in range(2 * MOST_OF_SESSION):
            sockets._owners[f"e{number}"] = eve
            monkeypatch.setitem(core.sio.eio.sockets, f"e{number}", object())
        assert await ask(eve, "transport=polling") == 403
        assert await ask(ada, "transport=polling") == 200
        for number in range(2 * MOST_OF_SESSION):
            monkeypatch.delitem(core.sio.eio.sockets, f"e{number}")
        assert await ask(eve, "transport=polling") == 200, "those that are gone do not count"
    finally:
        core.sio.eio.handlers.clear()
        core.sio.eio.handlers.update(handlers)
