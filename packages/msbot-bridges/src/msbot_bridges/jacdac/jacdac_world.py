"""Jacdac over WebSocket: a page with WebUSB that brings the modules of a browser, or Jacdac's own tools.

`page:8082` serves the page to browsers of this computer; `ws://127.0.0.1:8081` connects to `jacdac devtools`. One
message of the socket is one frame.
"""

from __future__ import annotations

import asyncio
import logging
import time
from http import HTTPStatus
from importlib import resources

from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.connection import broadcast
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.http11 import Request, Response

from msbot_bridges.bridge import World, WorldHost
from msbot_bridges.jacdac.frames import HEADER, MOST_SIZE
from msbot_bridges.jacdac.jacdac_bus import MOST_MODULES, JacdacBus, Module, ModuleFound, ModuleLost
from msbot_bridges.jacdac.module_device import ModuleDevice
from msbot_xrce.errors import LinkDown

MOST_PAGES = 8
"""Pages that are connected at a time."""
MOST_WAITING = 65_536
"""Bytes that may wait for one page."""
AGAIN_S = 1.0
"""Time after which a connection that has ended is tried again."""
_LONGEST_WAIT_S = 60.0
logging.getLogger("websockets").setLevel(logging.WARNING)
_FILES = {"": "text/html", "page.css": "text/css", "page.js": "text/javascript", "jacdac.js": "text/javascript"}
_Socket = ServerConnection | ClientConnection


class JacdacWorld(World):
    """The modules that are reached through one address.

    Args:
        url: `ws://HOST:PORT/` to connect to; empty: serve the page.
        host, port: where the page is served.
    """

    def __init__(self, url: str, host: str, port: int) -> None:
        self.port = port
        """Where the page is served; the number that was free when it was 0."""
        self.is_open = asyncio.Event()
        """The page is served."""
        self._url, self._host_name = url, host
        self._bus = JacdacBus()
        self._devices: dict[Module, ModuleDevice] = {}
        self._ignored = set[bytes]()
        self._sockets = set[_Socket]()
        self._wake = asyncio.Event()
        self._due = 0.0
        self._files: dict[str, bytes] = {}
        self._told = set[str]()
        """What was left out, as was said."""

    async def run(self, host: WorldHost) -> None:
        """See `World`."""
        self._host = host
        tasks = {
            asyncio.create_task(self._work()),
            asyncio.create_task(self._connect() if self._url else self._serve()),
        }
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)

    # The ways in

    async def _connect(self) -> None:
        """Be a client of Jacdac's tools for as long as the bridge runs."""
        is_said = False
        while True:
            try:
                async with connect(self._url, max_size=HEADER + MOST_SIZE) as socket:
                    self._host.say(f"connected to {self._url}")
                    is_said = False
                    await self._pump(socket)
            except (OSError, InvalidHandshake, TimeoutError) as error:
                if not is_said:
                    self._host.say(f"{self._url} cannot be reached ({error}); tried again every {AGAIN_S:g} s")
                is_said = True
            await asyncio.sleep(AGAIN_S)

    async def _serve(self) -> None:
        """Serve the page for as long as the bridge runs."""
        folder = resources.files(__package__ or "") / "static"
        for name in _FILES:
            self._files[name] = await asyncio.to_thread((folder / (name or "index.html")).read_bytes)
        try:
            server = await serve(
                self._pump,
                self._host_name,
                self.port,
                process_request=self._requested,
                max_size=HEADER + MOST_SIZE,
                open_timeout=5,
            )
        except OSError as error:
            raise LinkDown(f"page:{self.port}: {error.strerror or error}") from error
        async with server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            self._host.say(f"open http://{self._host_name}:{self.port}/ in Chrome or Edge, and connect modules there")
            self.is_open.set()
            await server.serve_forever()

    def _requested(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request for a file; None: it is for the socket, which only our own page and programs may open."""
        name = request.path.partition("?")[0].removeprefix("/")
        own = {f"{self._host_name}:{self.port}", f"localhost:{self.port}"}
        if request.headers.get("Host", "").lower() not in own:
            return connection.respond(
                HTTPStatus.MISDIRECTED_REQUEST, f"This is http://{self._host_name}:{self.port}/\n"
            )
        if name == "frames":
            origin = request.headers.get("Origin")
            if origin is not None and origin.removeprefix("http://") not in own:
                return connection.respond(HTTPStatus.FORBIDDEN, "Only the bridge's own page may connect.\n")
            if len(self._sockets) >= MOST_PAGES:
                return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_PAGES} pages are connected.\n")
            return None
        if name not in _FILES:
            return connection.respond(HTTPStatus.NOT_FOUND, "There is only the page at /\n")
        body = self._files[name]
        headers = Headers(
            {
                "Content-Type": f"{_FILES[name]}; charset=utf-8",
                "Content-Length": str(len(body)),
                "Content-Security-Policy": "default-src 'self'; connect-src 'self'; frame-ancestors 'none'",
                "Cache-Control": "no-cache",
            }
        )
        return Response(HTTPStatus.OK, "OK", headers, body)

    async def _pump(self, socket: _Socket) -> None:
        """Take the frames of one connection, until it ends."""
        self._sockets.add(socket)
        try:
            async for message in socket:
                if isinstance(message, bytes):
                    self._bus.receive(message, time.monotonic())
                    self._say_what_is_left_out()
                    self._take_events()
                    if self._bus.deadline < self._due:
                        self._wake.set()
        except ConnectionClosed:
            pass  # it has ended, as it may
        finally:
            self._sockets.discard(socket)

    # The bus

    async def _work(self) -> None:
        """Send what is due, until cancelled."""
        while True:
            self._wake.clear()
            now = time.monotonic()
            frames = self._bus.poll(now)
            if frames:
                self._drop_the_stuck()
            for frame in frames:
                broadcast(self._sockets, frame)
            self._take_events()
            self._due = min(self._bus.deadline, now + _LONGEST_WAIT_S)
            try:
                async with asyncio.timeout_at(asyncio.get_running_loop().time() + self._due - now):
                    await self._wake.wait()
            except TimeoutError:
                pass  # it is time

    def _say_what_is_left_out(self) -> None:
        """Once for each reason; the bus counts."""
        for count, words in (
            (self._bus.bad_frames, "what comes from a page or a tool is no frame of Jacdac, and is left out"),
            (self._bus.left_out, f"there are more than {MOST_MODULES} modules: further ones are left out"),
        ):
            if count and words not in self._told:
                self._told.add(words)
                self._host.say(words)

    def _drop_the_stuck(self) -> None:
        """A page that takes nothing is left, so that its frames do not pile up."""
        for socket in tuple(self._sockets):
            if socket.transport.get_write_buffer_size() > MOST_WAITING:
                self._sockets.discard(socket)
                socket.transport.abort()
                self._host.say("a page takes nothing: its connection is closed")

    def _take_events(self) -> None:
        """Hand over what the bus has heard."""
        events = self._bus.events
        while events:
            event = events.popleft()
            if isinstance(event, ModuleFound):
                self._found(event.module)
            elif isinstance(event, ModuleLost):
                if (device := self._devices.pop(event.module, None)) is not None:
                    device.is_reset = event.module.is_reset
                    self._host.lost(device, event.why)
            elif (device := self._devices.get(event.module)) is not None:
                device.heard(event.service, event.register, event.event, event.data)

    def _found(self, module: Module) -> None:
        if not any(module.services()):
            if module.device not in self._ignored and len(self._ignored) < 1000:
                self._ignored.add(module.device)
                self._host.say(f"{module.device[::-1].hex()} has no service that can be a port: it is left out")
            return
        device = self._devices[module] = ModuleDevice(module, self._wake.set, self._host.news)
        self._host.found(device)
