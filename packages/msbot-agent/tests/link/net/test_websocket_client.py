"""The part's end of a WebSocket, with a connection that does what the test says."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest
from websockets.exceptions import ConnectionClosedOK

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Signal
from msbot_agent.link.net.websocket_client import REFUSED, WRITE_LIMIT, WebSocketClientLink, open_websocket
from msbot_xrce.errors import ConfigError, LinkDown, LinkFull
from tests.link.ends import End


class Connection:
    """A WebSocket: takes a packet when the test lets it, and ends with a code and a reason."""

    def __init__(self) -> None:
        self.inbox: asyncio.Queue[bytes | str | None] = asyncio.Queue()
        self.sent: list[bytes] = []
        self.may_send = asyncio.Semaphore(0)
        self.close_code: int | None = None
        self.close_reason = ""

    async def __aiter__(self) -> AsyncIterator[bytes | str]:
        while (message := await self.inbox.get()) is not None:
            yield message

    async def send(self, packet: bytes) -> None:
        await self.may_send.acquire()
        if self.close_code is not None:
            raise ConnectionClosedOK(None, None)
        self.sent.append(packet)

    def end(self, code: int | None = None, reason: str = "") -> None:
        self.close_code, self.close_reason = code, reason
        self.inbox.put_nowait(None)


def link_to_a_page() -> tuple[WebSocketClientLink, End]:
    link = WebSocketClientLink("ws://page:8080", "msbot_token")
    return link, End(link)


async def serve(link: WebSocketClientLink, connection: Connection) -> asyncio.Task[str]:
    serving = asyncio.create_task(link._serve(connection))  # type: ignore[arg-type]
    await asyncio.sleep(0)
    return serving


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (401, "the page does not let this part in"),
        (403, "the page does not let this part in"),
        (400, "there is no page of MsBOT"),
        (402, "there is no page of MsBOT"),
        (404, "there is no page of MsBOT"),
        (499, "there is no page of MsBOT"),
        (500, ""),
        (503, ""),
    ],
)
def test_what_the_page_answers_ends_the_link_or_is_tried_again(status: int, words: str) -> None:
    link, _ = link_to_a_page()
    if words:
        with pytest.raises(LinkDown, match=words):
            link._judge(status)
    else:
        link._judge(status)


@pytest.mark.parametrize(
    ("status", "words"), [(407, "wants a name and a password"), (403, "refuses the way, HTTP status 403"), (500, "")]
)
def test_what_a_proxy_answers_ends_the_link_or_is_tried_again(status: int, words: str) -> None:
    link, _ = link_to_a_page()
    if words:
        with pytest.raises(LinkDown, match=words):
            link._judge_proxy(status)
    else:
        link._judge_proxy(status)


def test_packets_go_both_ways_and_sentences_are_for_people(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        link, end = link_to_a_page()
        assert not link.has_room(link.remote)
        with pytest.raises(LinkDown, match="there is no connection with the page"):
            link.send(b"x", link.remote)
        connection = Connection()
        serving = await serve(link, connection)
        assert await end.told(Signal.LINK_UP) == ("page:8080", "connected")
        connection.inbox.put_nowait(b"down")
        connection.inbox.put_nowait("send\nless  often " + "x" * 400)
        for packet in (b"one", b"two"):
            link.send(packet, link.remote)
        connection.may_send.release()
        connection.may_send.release()
        await asyncio.sleep(0.1)
        assert await end.heard() == b"down"
        assert connection.sent == [b"one", b"two"]
        assert [record.message[:30] for record in caplog.records] == ["the page says: send less often"]
        assert len(caplog.records[0].message) < 400
        assert (link.counters.packets_in, link.counters.packets_out) == (1, 2)
        connection.end(1001)
        assert await serving == ""
        assert await end.told(Signal.LINK_DOWN) == ("page:8080", "connection closed: 1001")
        assert not link.has_room(link.remote)

    run_virtual(main())


def test_so_much_waits_and_room_is_told_when_all_of_it_has_gone() -> None:
    async def main() -> None:
        link, end = link_to_a_page()
        connection = Connection()
        serving = await serve(link, connection)
        link.send(bytes(WRITE_LIMIT - 1), link.remote)
        assert link.has_room(link.remote)
        link.send(b"x", link.remote)
        assert not link.has_room(link.remote)
        with pytest.raises(LinkFull, match="the page does not take its data"):
            link.send(b"y", link.remote)
        connection.may_send.release()
        await asyncio.sleep(0.1)
        assert link.has_room(link.remote)
        assert end.room.empty()  # something waits yet
        connection.may_send.release()
        await asyncio.sleep(0.1)
        assert end.room.get_nowait() == "page:8080"
        link.send(b"z", link.remote)
        connection.may_send.release()
        await asyncio.sleep(0.1)
        assert end.room.empty()  # it was not full
        assert connection.sent == [bytes(WRITE_LIMIT - 1), b"x", b"z"]
        connection.end()
        assert await serving == ""

    run_virtual(main())


def test_what_waited_when_the_connection_broke_is_not_sent_by_the_next() -> None:
    async def main() -> None:
        link, end = link_to_a_page()
        first, second = Connection(), Connection()
        serving = await serve(link, first)
        link.send(bytes(WRITE_LIMIT), link.remote)
        first.end()
        assert await serving == ""
        assert await end.told(Signal.LINK_DOWN) == ("page:8080", "connection closed: broken")
        serving = await serve(link, second)
        link.send(bytes(WRITE_LIMIT - 1), link.remote)
        assert link.has_room(link.remote)  # nothing of before counts
        second.may_send.release()
        await asyncio.sleep(0.1)
        assert second.sent == [bytes(WRITE_LIMIT - 1)]
        second.end()
        await serving

    run_virtual(main())


@pytest.mark.parametrize(
    ("code", "reason", "answer"),
    [
        (REFUSED - 1, "other", ""),
        (REFUSED, "you are signed out", "you are signed out"),
        (REFUSED + 99, "", "the page has ended the connection"),
        (REFUSED + 100, "other", ""),
    ],
)
def test_a_page_that_does_not_want_the_part_says_why(code: int, reason: str, answer: str) -> None:
    async def main() -> None:
        link, _ = link_to_a_page()
        connection = Connection()
        serving = await serve(link, connection)
        connection.end(code, reason)
        assert await serving == answer

    run_virtual(main())


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("ws:page:8080", "it needs // and the page's host and port"),
        ("ws://:8080", "it needs // and the page's host and port"),
        ("ws://page:0", "it needs // and the page's host and port"),
        ("ws://page:99999", "it needs // and the page's host and port"),
        ("ws://ann@page:1", "it has a host, a port and perhaps a path, and nothing else"),
        ("ws://page:1/?x=1", "it has a host, a port and perhaps a path, and nothing else"),
        ("ws://page:1/#x", "it has a host, a port and perhaps a path, and nothing else"),
    ],
)
def test_what_is_no_address_of_a_page(address: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MSBOT_TOKEN", "msbot_token")
    with pytest.raises(ConfigError, match=words):
        open_websocket(address)


@pytest.mark.parametrize("token", ["", "  ", "tökén", "a\x00b"])
def test_without_a_token_nobody_is_asked(token: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MSBOT_TOKEN", raising=False)
    if token and "\0" not in token:
        monkeypatch.setenv("MSBOT_TOKEN", token)
    with pytest.raises(ConfigError, match=r"\$MSBOT_TOKEN has to hold an API token"):
        open_websocket("ws://page:8080")


def test_an_address_with_a_path_is_taken_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MSBOT_TOKEN", " msbot_token\n")
    for address, url in (
        ("ws://page:8080", "ws://page:8080/api/link"),
        ("wss://page/", "wss://page/api/link"),
        ("ws://page:8080/robots/link", "ws://page:8080/robots/link"),
    ):
        link = open_websocket(address)
        assert (link._url, link._token) == (url, "msbot_token")
    assert link.info.name == "ws://page:8080"
    assert link.describe(None) == "page:8080"
