"""A real browser in front of a real robot: Debian's Chromium, driven by Playwright, and `msbot` in its own process."""

from __future__ import annotations

import os
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Locator, Page, expect, sync_playwright
from playwright.sync_api import TimeoutError as BrowserTimeout

from tests.e2e.processes import Process, running

ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
    "--process-per-site",  # a person's tabs are one process, with one compiled program
    "--disable-audio-output",  # it is muted, and would be mixed all the same
    "--js-flags=--no-opt --no-maglev",  # pages are left before compiling them twice pays
]  # fmt: skip
PATIENCE_MS = 120_000
"""How long a test waits for the page; the machine may be busy. Nothing in the product is this slow."""
NEEDED = "MSBOT_NEED_BROWSER"
"""Set where no browser test may be skipped, as in CI."""
NOTE_TOLD = """window.told = [];
(() => {
  const noted = new WeakMap();
  new MutationObserver(() => {
    for (const one of document.querySelectorAll(".q-notification")) {
      if (noted.get(one) !== one.textContent) told.push(one.textContent);
      noted.set(one, one.textContent);
    }
  }).observe(document, { childList: true, subtree: true, characterData: true });
})()"""
"""Notes what notifications say: most go by themselves after 5 s, in which a busy test may not come to look."""
FORGOTTEN = "window.isOld = true, socket.io.opts.query.client_id = 'of-an-earlier-run', socket.disconnect()"
"""Evaluated in a page: its connection breaks, and the robot knows the page no more when it is back."""
CLICK = "(one) => !document.documentElement.classList.contains('ms-dead') && (one.click(), true)"
"""In one turn: a page that has become grey since one has looked takes no click."""
POLICY = "Content Security Policy"
violations: list[str] = []
"""What the browser refused because of our pages' policy, in its own words."""
expect.set_options(timeout=PATIENCE_MS)


def chromium() -> str | None:
    """Where the browser is; best the one without windows: a visitor costs it half the processor time."""
    names = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
    return next(filter(None, map(shutil.which, names)), None)


@pytest.fixture(scope="package")
def started_browser() -> Iterator[Browser]:
    """The browser's processes.

    For this folder, not for the whole session: while it is there an event loop runs, and tests that are coroutines
    could not.
    """
    path = chromium()
    if path is None:
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)(
            "no Chromium on this machine: apt-get install chromium-headless-shell (or chromium)"
        )
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=path, args=ARGUMENTS, timeout=PATIENCE_MS)
        yield found
        found.close()


@pytest.fixture(scope="module")
def browser(started_browser: Browser) -> Iterator[Browser]:
    """The browser; every file gets a context of its own from it, or several, which end with the file: a page that is
    left open goes on looking for its robot."""
    yield started_browser
    for context in started_browser.contexts:
        context.close()


@pytest.fixture(autouse=True)
def _keeps_its_own_policy() -> Iterator[None]:
    """Ordinary use of a page runs, shows and asks for nothing that the page's own policy forbids."""
    violations.clear()
    yield
    assert violations == []


def free_port() -> int:
    """A port, for TCP and UDP, below those that the system gives to clients: it stays free during a restart."""
    for port in Random().sample(range(20_000, 32_000), 100):
        with socket.socket() as tcp, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp, suppress(OSError):
            tcp.bind(("127.0.0.1", port))
            udp.bind(("127.0.0.1", port))
            return port
    raise AssertionError("no free port")


def new_page(
    browser: Browser,
    *,
    width: int = 1280,
    height: int = 900,
    locale: str = "en-GB",
    by_finger: bool = False,
    waits: bool = True,
    keeps_shell: bool = False,
) -> Page:
    """A fresh visitor, without cookies.

    Args:
        browser: where.
        width: of the window.
        height: of the window.
        locale: the language of the browser.
        by_finger: whether it is a phone or a tablet.
        waits: in none of their tabs a click is made while the page is grey, because the robot has said nothing for a
            moment, as on a busy machine: it takes no clicks then.
        keeps_shell: whether the browser keeps the page for when no robot answers; it costs each visitor a worker.
    """
    context = browser.new_context(
        viewport={"width": width, "height": height},
        locale=locale,
        has_touch=by_finger,
        is_mobile=by_finger,
        reduced_motion="reduce",  # drawing animations in software costs more than all the rest of a page
        service_workers="allow" if keeps_shell else "block",
    )
    context.set_default_timeout(PATIENCE_MS)
    context.add_init_script(NOTE_TOLD)
    context.on("console", _note_violation)
    if waits:
        context.on("page", lambda page: page.add_locator_handler(page.locator("html.ms-dead"), lambda: None))
    return context.new_page()


def _note_violation(message: ConsoleMessage) -> None:
    if POLICY in message.text:
        violations.append(message.text)


def go(page: Page, address: str) -> None:
    """Open a page and wait until it is connected: what is done before would be lost. Its language is known at once."""
    page.goto(address)
    assert page.evaluate("document.documentElement.lang")
    page.wait_for_function("window.did_handshake && window.socket.connected")


def told(page: Page, words: str) -> None:
    """Wait until a notification has said that, since the page was loaded; each is found once."""
    page.wait_for_function(
        "words => { const at = told.findIndex((one) => one.includes(words));"
        " return at >= 0 && told.splice(at, 1).length > 0; }",
        arg=words,
    )


def click_by_script(button: Locator) -> None:
    """Click without a pointer, as soon as the page takes it."""
    button.page.wait_for_function(CLICK, arg=button.element_handle())


def again_until(act: Callable[[], object], seen: Callable[[float], object]) -> None:
    """Do something, and again if nothing comes of it, as people do: a grey page takes no press, and what was typed just
    before a page had lost its robot for long, and was made anew, is gone.

    Args:
        act: what is done.
        seen: waits for what comes of it, at most so many milliseconds.
    """
    for patience_ms in (15_000, 30_000):
        act()
        with suppress(AssertionError, BrowserTimeout):
            seen(patience_ms)
            return
    act()
    seen(PATIENCE_MS)


def call(page: Page, method: str, path: str, body: object = None) -> int:
    """What the API answers to a script on the person's own page, which knows everything that the page knows."""
    status: int = page.evaluate(
        """async ([method, path, body]) => {
            const me = await (await fetch("/api/me")).json();
            const headers = {"content-type": "application/json", "x-csrf-token": me.csrf};
            const answer = await fetch(path, {method, headers, body: body && JSON.stringify(body)});
            return answer.status;
        }""",
        [method, path, body],
    )
    return status


def undo_newest(page: Page) -> None:
    """Take the newest change back; pages follow by themselves. The button for it is tested in `test_demo_pages`."""
    assert call(page, "POST", "/api/undo", {}) == 200


def link_in(process: Process) -> str:
    """The address that the robot has printed."""
    line = process.wait_for("The page is at")
    found = re.search(r"https?://\S+", line)
    assert found is not None
    return found[0]


class Site:
    """A robot with its page."""

    def __init__(self, process: Process) -> None:
        self.process = process
        self.link = link_in(process)
        self.base = re.sub(r"/(enter|setup)\?.*", "", self.link)
        self.owner: BrowserContext | None = None
        """The browser of whoever has set it up, signed in."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The rover of ordinary parts, everything simulated."""
    folder: Path = tmp_path_factory.mktemp("demo")
    with running("demo", "--robot", "rover", "--spare", "--port", "0", cwd=folder) as process:
        yield Site(process)


@pytest.fixture(scope="module")
def signed_in(browser: Browser, demo: Site) -> Iterator[BrowserContext]:
    """Somebody who has followed the demo's link; their browser keeps what it has loaded."""
    visitor = new_page(browser)
    visitor.goto(demo.link)
    yield visitor.context
    visitor.context.close()


@pytest.fixture(scope="module")
def tab(signed_in: BrowserContext) -> Page:
    """The tab they use: a new one for each test would cost a process of the browser each, and one left open as well."""
    return signed_in.pages[0]


@pytest.fixture
def blank(tab: Page) -> Page:
    """It, wherever it was: what a test opens takes its place. An empty page in between would be a process more."""
    tab.set_viewport_size({"width": 1280, "height": 900})
    return tab


@pytest.fixture
def page(blank: Page, demo: Site) -> Page:
    """The robot page in a tab of theirs."""
    go(blank, demo.base)
    return blank
