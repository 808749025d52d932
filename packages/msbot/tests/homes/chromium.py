"""The home in a browser: the page's own VM, host and `home.js` in a worker of a real Chromium, in virtual time.

Playwright runs in a thread of its own: it cannot be called where an event loop runs.
"""

from __future__ import annotations

import asyncio
import functools
import json
import os
import queue
import shutil
import threading
from collections.abc import Callable
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from msbot_web.programs.browser_files import home_files
from tests import ROOT
from tests.homes.runners import said
from tests.homes.world import UID, PagePeer, World

WEB = ROOT / "packages/msbot-web/src/msbot_web/static"
NEEDED = "MSBOT_NEED_BROWSER"
"""Set where no test in a browser may be skipped."""
CHROMIUM = (
    shutil.which("chromium-headless-shell")
    or shutil.which("chromium")
    or shutil.which("chromium-browser")
    or shutil.which("google-chrome")
)
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--js-flags=--liftoff-only"]
"""Each program has a VM of its own: to compile it twice does not pay."""
_WORKER = """
import { openHome } from "/web/program/home.js";
let home = null, said = [];
onmessage = async ({ data: [number, request, files] }) => {
  let reply;
  try {
    if (files) home = await openHome(location.origin, files, (kind, text) => { said.push([kind, text]); });
    reply = { ...home(request), said };
  } catch (error) {
    reply = { broken: `${error.stack || error.message}` };
  }
  said = [];
  postMessage([number, reply]);
};
"""
_PAGE = """<script>
let worker = null, number = 0, waiting = new Map();
window.begin = () => {
  if (worker) worker.terminate();
  worker = new Worker("/worker.js", { type: "module" });
  worker.onmessage = ({ data: [number, reply] }) => waiting.get(number)(reply);
};
window.ask = (request, files) => new Promise((done) => {
  waiting.set(++number, (reply) => { waiting.delete(number); done(reply); });
  worker.postMessage([number, request, files]);
});
</script>"""


class _Files(SimpleHTTPRequestHandler):
    """The page's static files, and two of ours."""

    def translate_path(self, path: str) -> str:
        return str(WEB / path.removeprefix("/web/"))

    def do_GET(self) -> None:
        ours = {"/": (_PAGE, "text/html"), "/worker.js": (_WORKER, "text/javascript")}.get(self.path)
        if ours is None:
            super().do_GET()
            return
        body = ours[0].encode()
        self.send_response(200)
        self.send_header("content-type", ours[1])
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Nothing."""


class Chromium:
    """One browser for many programs; each gets a worker, and with it a VM, of its own."""

    def __init__(self) -> None:
        self._asked: queue.SimpleQueue[tuple[Callable[[Any], Any], queue.SimpleQueue[Any]] | None] = queue.SimpleQueue()
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _Files)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self._thread = threading.Thread(target=self._drive, daemon=True)
        self._thread.start()

    def begin(self) -> None:
        """A new worker."""
        self._do(lambda page: page.evaluate("begin()"))

    def ask(self, request: dict[str, Any], *, files: dict[str, str] | None = None) -> dict[str, Any]:
        """One request of host.py, one answer; with the files when it is the first."""
        answer: dict[str, Any] = self._do(
            lambda page: page.evaluate("([request, files]) => ask(request, files)", [request, files])
        )
        assert "broken" not in answer, answer["broken"]
        return answer

    def close(self) -> None:
        """It is over."""
        self._asked.put(None)
        self._thread.join(60)
        self._server.shutdown()
        self._server.server_close()

    def _do(self, work: Callable[[Any], Any]) -> Any:
        answer: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._asked.put((work, answer))
        result = answer.get(timeout=100)
        if isinstance(result, BaseException):
            raise result
        return result

    def _drive(self) -> None:
        from playwright.sync_api import sync_playwright

        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
            page = browser.new_page()
            page.goto(f"http://127.0.0.1:{self._server.server_port}/")
            while (asked := self._asked.get()) is not None:
                work, answer = asked
                try:
                    answer.put(work(page))
                except Exception as error:  # told to whoever asked
                    answer.put(error)
            browser.close()


@functools.cache
def files() -> dict[str, str]:
    found: dict[str, str] = json.loads(home_files())
    return found


class BrowserHome:
    """A program in a browser, joined to the master as by the page's WebSocket."""

    def __init__(self, chromium: Chromium) -> None:
        self._chromium = chromium
        self._world: World | None = None
        self._state = ("never", "it has not run a part")
        self._peer: PagePeer | None = None
        self._came: list[str] = []
        self._timer: asyncio.TimerHandle | None = None
        self._soon: asyncio.Handle | None = None
        self._over = False

    def start(self, world: World, program: str, name: str) -> None:
        """See `Home`."""
        self._world = world
        self._chromium.begin()
        self._peer = world.page_peer(self._packet_came)
        request = {"do": "start", "program": program, "name": name, "uid": UID.hex(), "now": self._now(), "live": False}
        self._take(self._chromium.ask(request, files=files()))

    def state(self) -> str:
        """See `Home`."""
        return ": ".join(self._state)

    def pull(self) -> None:
        """See `Home`."""
        assert self._peer is not None
        self._peer.pull()
        self._over = True

    def close(self) -> None:
        """See `Home`."""
        for handle in (self._timer, self._soon):
            if handle is not None:
                handle.cancel()
        self._over = True
        if self._peer is not None:
            self._peer.close()

    def _packet_came(self, packet: bytes) -> None:
        self._came.append(packet.hex())
        self._step_soon()

    def _step_soon(self) -> None:
        if self._soon is None and not self._over:
            self._soon = asyncio.get_running_loop().call_soon(self._step)

    def _step(self) -> None:
        self._soon = None
        if not self._over:
            came, self._came = self._came, []
            self._take(self._chromium.ask({"do": "step", "now": self._now(), "in": came, "room": 65536}))

    def _take(self, answer: dict[str, Any]) -> None:
        assert self._world is not None
        assert self._peer is not None
        for kind, text in answer["said"]:
            said(self._world, kind, text)
        self._state = tuple(answer["state"])
        for packet in answer["out"]:
            self._peer.bring(bytes.fromhex(packet))
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if answer["due"] is None:
            self._over = True
        else:
            self._timer = asyncio.get_running_loop().call_at(answer["due"] / 1000, self._step_soon)

    @staticmethod
    def _now() -> int:
        return int(asyncio.get_running_loop().time() * 1000 + 1e-6)


def is_needed() -> bool:
    """Whether a test without a browser is a failure."""
    return bool(os.environ.get(NEEDED))
