"""How long a class's pages take to come back after the master was started again.

    python -m bench.reload [--pupils 30] [--tabs 2] [--browsers 2] [--write]

A real `msbot master` with three parts over UDP. Each pupil is signed in and has some tabs: of the first pupils real
tabs of Chromium, of all others what a page does in a tab, with a genuine client of socket.io: it asks `/beat`, waits by
the rules of `static/reconnect.js`, asks for its turn, loads the page (not its files, which a browser keeps), and
connects. The master is ended and started again; counted is, from the moment at which the page can be opened again,
until each tab is connected to a page that the new master has made. `--write` keeps the table in bench/results. To be
run on a quiet machine; Linux.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import re
import tempfile
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from urllib.parse import urlencode

import httpx
import socketio
from playwright.async_api import BrowserContext, Page, async_playwright

from bench.machine import describe_machine
from bench.result import write_result
from msbot.registry import open_registry
from msbot.registry.edits import users
from msbot_web.access.passwords import Argon2Hasher
from tests.e2e.processes import Process, running
from tests.hostile.robot import Robot
from tests.web.browser.conftest import ARGUMENTS, chromium, free_port

PASSWORD = "correct horse"
LIVE = "!window.isOfTheFirstMaster && window.did_handshake && window.socket.connected"
ASK_S, SPREAD_S, FIRST_S, GROWS, LONGEST_S = 0.6, 0.8, 0.5, 1.7, 8.0
"""As `page.js` and `reconnect.js` have them."""
PATIENCE_S = 120.0
SHARES = (0.5, 0.9, 1.0)


class Tab:
    """What a page does in a tab, without drawing anything."""

    def __init__(self, site: str, cookies: dict[str, str], turn_of_browser: asyncio.Lock) -> None:
        self._site, self._turn_of_browser = site, turn_of_browser
        self._http = httpx.AsyncClient(base_url=site, cookies=cookies, timeout=10)
        self._cookie = "; ".join(f"{name}={value}" for name, value in cookies.items())
        self._socket: socketio.AsyncClient | None = None
        self.loads = self.refusals = 0
        self.back_at = 0.0

    async def load(self) -> bool:
        """Load the page and connect to it; whether it is there."""
        self.loads += 1
        answer = await self._http.get("/", headers={"accept": "text/html"})
        found = re.search(r"""["']client_id["']: ?["']([^"']+)["']""", answer.text)
        if answer.status_code != httpx.codes.OK or found is None:
            self.refusals += 1
            return False
        number = re.search(r"""["']next_message_id["']: ?(\d+)""", answer.text)
        query = urlencode(
            {
                "client_id": found[1],
                "next_message_id": number[1] if number else 0,
                "implicit_handshake": "true",
                "document_id": f"{random.random()}",
                "tab_id": f"{random.random()}",
                "old_tab_id": "",
            }
        )
        if self._socket is not None:
            await self._socket.disconnect()
        self._socket = socketio.AsyncClient(reconnection=False)
        await self._socket.connect(
            f"{self._site}?{query}",
            headers={"Cookie": self._cookie, "Origin": self._site},
            socketio_path="/_nicegui_ws/socket.io",
            transports=["websocket"],
            wait_timeout=10,
        )
        return True

    async def come_back(self) -> None:
        """Wait until the robot answers again, and then come back as a page does."""
        while True:
            if await self._answers():
                break
            await asyncio.sleep(ASK_S)
        await asyncio.sleep(random.random() * SPREAD_S)
        failures = 0
        while True:
            async with self._turn_of_browser:
                if await self._take_turn():
                    break
            await asyncio.sleep(min(FIRST_S * GROWS**failures, LONGEST_S) * (0.5 + random.random()))
            failures += 1
        self.back_at = time.monotonic()

    async def _take_turn(self) -> bool:
        try:
            turn = await self._http.get("/turn")
            if turn.status_code != httpx.codes.OK:
                self.refusals += 1
                return False
            await asyncio.sleep(turn.json()["wait_ms"] / 1000)
            return await self.load()
        except (httpx.HTTPError, socketio.exceptions.ConnectionError):
            self.refusals += 1
            return False

    async def _answers(self) -> bool:
        try:
            return (await self._http.get("/beat")).status_code == httpx.codes.OK
        except httpx.HTTPError:
            return False

    async def close(self) -> None:
        """Leave."""
        if self._socket is not None:
            await self._socket.disconnect()
        await self._http.aclose()


def start(robot: Robot, port: int) -> Process:
    """The master, always at the same place."""
    words = ("master", "--link", robot.link, "--port", str(port))
    return robot.stack.enter_context(running(*words, cwd=robot.folder, env=robot.env))


async def sign_in(site: str, name: str) -> dict[str, str]:
    """The cookies of somebody's browser."""
    async with httpx.AsyncClient(base_url=site, timeout=PATIENCE_S) as browser:
        answer = await browser.post("/login", data={"name": name, "password": PASSWORD})
        if answer.status_code != httpx.codes.SEE_OTHER:
            raise SystemExit(f"{name} cannot sign in: {answer.status_code} {answer.text[:200]}")
        return dict(browser.cookies)


async def real_tabs(context: BrowserContext, site: str, cookies: dict[str, str], tabs: int) -> list[Page]:
    """Tabs of a real browser, connected."""
    await context.add_cookies([{"name": name, "value": value, "url": site} for name, value in cookies.items()])
    pages = [await context.new_page() for _ in range(tabs)]
    for page in pages:
        page.set_default_timeout(1000 * PATIENCE_S)
        await page.goto(site)
        await page.wait_for_function(LIVE)
        await page.evaluate("window.isOfTheFirstMaster = true")
    return pages


async def when_back(page: Page) -> float:
    """When a real tab lives again."""
    await page.wait_for_function(LIVE)
    return time.monotonic()


async def measure(pupils: int, tabs: int, browsers: int) -> list[str]:
    """Let a class lose its robot, and count until it is back."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        robot, port = Robot(Path(folder), stack), free_port()
        names = [f"pupil{number:02}" for number in range(pupils)]
        people = [users.Person(name, "student", await Argon2Hasher().hash(PASSWORD, asker="")) for name in names]
        with open_registry(str(robot.folder / "robot.db")) as registry:
            registry.edits.make(None, "bench", partial(users.keep, people=people))
        master, site = start(robot, port), f"http://127.0.0.1:{port}"
        master.wait_for("The page is at")
        robot.parts("AA", "BB", "CC")
        async with async_playwright() as playwright:
            browser = await playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
            pages: list[Page] = []
            imitated: list[Tab] = []
            for number, name in enumerate(names):
                cookies, lock = await sign_in(site, name), asyncio.Lock()
                if number < browsers:
                    pages += await real_tabs(await browser.new_context(), site, cookies, tabs)
                    continue
                own = [Tab(site, cookies, lock) for _ in range(tabs)]
                for one in own:
                    if not await one.load():
                        raise SystemExit(f"{name} gets no page")
                    one.loads = one.refusals = 0
                imitated += own
            await asyncio.to_thread(master.end)
            away = [asyncio.create_task(when_back(page)) for page in pages]
            away_too = [asyncio.create_task(one.come_back()) for one in imitated]
            again = start(robot, port)
            await asyncio.to_thread(again.wait_for, "The page is at")
            began = time.monotonic()
            real = [moment - began for moment in await asyncio.gather(*away)]
            await asyncio.gather(*away_too)
            rest = [one.back_at - began for one in imitated]
            for one in imitated:
                await one.close()
            await browser.close()
        loads, refusals = sum(one.loads for one in imitated), sum(one.refusals for one in imitated)
        rows = [
            (f"{len(real)} tabs of Chromium", real),
            (f"{len(rest)} clients of socket.io", rest),
            ("all", real + rest),
        ]
        return [
            "| tabs | half are back after | 90 % | all |",
            "|---|---|---|---|",
            *(
                f"| {title} | {' | '.join(f'{share(times, part):.1f} s' for part in SHARES)} |"
                for title, times in rows
                if times
            ),
            "",
            f"{pupils} pupils with {tabs} tabs each. The clients loaded {loads} pages, {refusals} times in vain.",
        ]


def share(times: list[float], part: float) -> float:
    """When so many of them were back, seconds; whoever was back before the page was said to be counts as 0."""
    return max(0.0, sorted(times)[max(0, round(part * len(times)) - 1)])


def main() -> None:
    """See the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pupils", type=int, default=30)
    parser.add_argument("--tabs", type=int, default=2)
    parser.add_argument("--browsers", type=int, default=2, help="pupils with real tabs")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    lines = asyncio.run(measure(options.pupils, options.tabs, options.browsers))
    lines += ["", describe_machine()]
    print("\n".join(lines))
    if options.write:
        write_result(
            "reload", "Pages come back after a restart of the master", lines, made_by="python -m bench.reload --write"
        )


if __name__ == "__main__":
    main()
