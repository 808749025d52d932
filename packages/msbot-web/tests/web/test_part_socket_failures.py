"""The system calls under a WebSocket fail in every way that systems know: the connection comes back."""

from __future__ import annotations

import asyncio
import errno
import logging
from collections.abc import AsyncIterator
from contextlib import suppress
from functools import partial
from typing import Any, cast

import pytest

from msbot_agent.link import Signal
from msbot_agent.link.net import WebSocketClientLink, websocket_client
from tests.link.test_system_calls import FATAL, PASSING, Faults, names
from tests.web.part_site import part_site


@pytest.mark.parametrize("call", ["recv", "send"])
async def test_whatever_fails_under_a_websocket_it_comes_back(
    call: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(websocket_client, "RECONNECT_S", 0.01)
    left = Faults(monkeypatch).of(call)
    async with part_site() as site:
        link = site.client(await site.token("bob"))
        signals: list[Signal] = []
        link.attach(signal=lambda signal, _peer, _words, _now: signals.append(signal))
        heard: list[bytes] = []
        site.link.tap = lambda _now, way, _peer, packet: heard.append(packet) if way == "in" else None
        running = asyncio.create_task(link.run())
        with caplog.at_level(logging.WARNING):
            for error in (*PASSING, errno.ECONNRESET, errno.EPIPE, errno.ETIMEDOUT, *FATAL):
                await site.until(lambda: link.has_room(link.remote))
                signals.clear()
                left.append(error)
                link.send(b"first", link.remote)
                await site.until(lambda: not left)
                if error == errno.EAGAIN:
                    await site.until(lambda: b"first" in heard)
                    assert not signals
                else:
                    await site.until(lambda: signals[-2:] == [Signal.LINK_DOWN, Signal.LINK_UP])
                heard.clear()
                last = [names(error).encode()]
                link.send(last[0], link.remote)
                await site.until(partial(heard.__eq__, last))  # and nothing of before comes late
                heard.clear()
                assert not running.done(), names(error)
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running
    assert [record.getMessage() for record in caplog.records] == []


class Broken:
    """A connection that has broken while something was written; who notices that, ends the program."""

    close_code, close_reason = 1006, ""

    def __init__(self) -> None:
        self.end: asyncio.Task[str] | None = None
        self._writing = asyncio.Event()

    async def send(self, _packet: bytes) -> None:
        self._writing.set()
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            assert self.end is not None
            self.end.cancel()

    async def __aiter__(self) -> AsyncIterator[bytes]:
        await self._writing.wait()
        return
        yield b""


async def test_the_end_of_the_program_is_not_overheard_while_a_connection_breaks() -> None:
    link = WebSocketClientLink("ws://127.0.0.1:1", "msbot_x")
    link.attach(signal=lambda signal, *_: link.send(b"x", link.remote) if signal is Signal.LINK_UP else None)
    connection = Broken()
    connection.end = asyncio.create_task(link._serve(cast("Any", connection)))
    with pytest.raises(asyncio.CancelledError):
        await connection.end
    assert not link.has_room(link.remote)
