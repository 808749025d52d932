"""Pages that are open in browsers, without a browser: they ask and hear what the page's scripts ask and hear.

    python -m bench.open_pages LINK [--pages 30] [--path /] [--seconds 60]

LINK is the address that `msbot demo` prints, with its token. A page costs this process little, so that thirty of them
fit beside a robot on a small computer; nothing is drawn.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import re
from http.cookies import SimpleCookie
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Origin

from msbot_xrce.lazy import dataclass

BEAT_S = 0.6
"""As often a page of the browser asks whether the robot is there, where nothing tells it."""
_CLIENT = re.compile(r"client_id': '([^']+)'")


@dataclass(slots=True)
class Site:
    """A robot's page and the cookies of somebody who is signed in."""

    host: str
    port: int
    cookies: str

    @property
    def address(self) -> str:
        """Where it is."""
        return f"{self.host}:{self.port}"


@dataclass(slots=True)
class Heard:
    """What came to all pages."""

    messages: int = 0
    octets: int = 0
    live_messages: int = 0
    live_octets: int = 0
    beats: int = 0
    broken: int = 0


async def ask(site: Site, path: str) -> tuple[int, dict[str, list[str]], bytes]:
    """One request with a connection of its own: status, headers, body."""
    reader, writer = await asyncio.open_connection(site.host, site.port)
    try:
        writer.write(_request(site, path, "close"))
        head = await reader.readuntil(b"\r\n\r\n")
        status, headers = _head_of(head)
        return status, headers, await _body(reader, headers)
    finally:
        writer.close()


async def enter(link: str) -> Site:
    """Sign in by a demo's link."""
    place = urlsplit(link)
    site = Site(place.hostname or "127.0.0.1", place.port or 80, "")
    path = place.path + (f"?{place.query}" if place.query else "")
    for _ in range(5):
        status, headers, _ = await ask(site, path or "/")
        jar = SimpleCookie()
        for line in headers.get("set-cookie", []):
            jar.load(line)
        if jar:
            site.cookies = "; ".join(f"{name}={morsel.value}" for name, morsel in jar.items())
        if status not in (302, 303, 307):
            break
        path = headers["location"][0]
    return site


class OpenPage:
    """One page of a browser."""

    def __init__(self, site: Site, path: str, heard: Heard) -> None:
        self._site = site
        self._path = path
        self._heard = heard
        self._is_live = False

    async def run(self) -> None:
        """Load it and stay on it until cancelled; load it again when the connection breaks."""
        while True:
            try:
                await self._stay()
            except* (OSError, ConnectionClosed, asyncio.IncompleteReadError, LookupError):
                self._heard.broken += 1
            await asyncio.sleep(1.0)

    async def _stay(self) -> None:
        status, _, body = await ask(self._site, self._path)
        text = body.decode(errors="replace")
        found = _CLIENT.search(text)
        if status != 200 or found is None:
            raise LookupError(f"{self._path} answers {status}")
        client = found[1]
        query = (
            f"EIO=4&transport=websocket&client_id={client}&implicit_handshake=true&next_message_id=0"
            f"&tab_id={client}&document_id={client}&old_tab_id="
        )
        async with self._connect(f"/_nicegui_ws/socket.io/?{query}") as line, asyncio.TaskGroup() as tasks:
            tasks.create_task(self._beat())
            if "/web/live.js" in text:
                tasks.create_task(self._live(client))
            await line.recv()
            await line.send("40")
            async for message in line:
                self._heard.messages += 1
                self._heard.octets += len(message)
                if message == "2":
                    await line.send("3")
            raise OSError("closed")

    async def _live(self, client: str) -> None:
        async with self._connect(f"/live?page={client}&packed=1") as line:
            self._is_live = True
            try:
                async for message in line:
                    self._heard.live_messages += 1
                    self._heard.live_octets += len(message)
            finally:
                self._is_live = False

    async def _beat(self) -> None:
        reader, writer = await asyncio.open_connection(self._site.host, self._site.port)
        try:
            while True:
                if not self._is_live:
                    writer.write(_request(self._site, "/beat", "keep-alive"))
                    _, headers = _head_of(await reader.readuntil(b"\r\n\r\n"))
                    await _body(reader, headers)
                    self._heard.beats += 1
                await asyncio.sleep(BEAT_S)
        finally:
            writer.close()

    def _connect(self, path: str) -> connect:
        site = self._site
        return connect(
            f"ws://{site.address}{path}",
            origin=Origin(f"http://{site.address}"),
            additional_headers={"Cookie": site.cookies},
            compression=None,
            max_size=None,
            create_connection=ClientConnection,
        )


async def look_on(site: Site, path: str, pages: int, heard: Heard) -> None:
    """Have so many pages open until cancelled."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    async with asyncio.TaskGroup() as tasks:
        for _ in range(pages):
            tasks.create_task(OpenPage(site, path, heard).run())
            await asyncio.sleep(0.2)  # one after the other, as people come


def _request(site: Site, path: str, connection: str) -> bytes:
    lines = [f"GET {path} HTTP/1.1", f"Host: {site.address}", f"Connection: {connection}", "Accept: text/html"]
    if site.cookies:
        lines.append(f"Cookie: {site.cookies}")
    return "\r\n".join((*lines, "", "")).encode()


def _head_of(head: bytes) -> tuple[int, dict[str, list[str]]]:
    first, *lines = head.decode("latin-1").split("\r\n")
    headers: dict[str, list[str]] = {}
    for line in lines:
        name, colon, value = line.partition(":")
        if colon:
            headers.setdefault(name.strip().casefold(), []).append(value.strip())
    return int(first.split()[1]), headers


async def _body(reader: asyncio.StreamReader, headers: dict[str, list[str]]) -> bytes:
    if "content-length" in headers:
        return await reader.readexactly(int(headers["content-length"][0]))
    if headers.get("transfer-encoding") != ["chunked"]:
        return await reader.read() if headers.get("connection") == ["close"] else b""
    body = b""
    while size := int(await reader.readline(), 16):
        body += (await reader.readexactly(size + 2))[:size]
    await reader.readexactly(2)
    return body


def main() -> None:
    """Have pages open and print what came."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("link")
    parser.add_argument("--pages", type=int, default=30)
    parser.add_argument("--path", default="/")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    heard = Heard()

    async def run() -> None:
        site = await enter(options.link)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(look_on(site, options.path, options.pages, heard), options.seconds)

    asyncio.run(run())
    print(json.dumps({name: getattr(heard, name) for name in Heard.__slots__}))


if __name__ == "__main__":
    main()
