"""Pages come back: after a restart of the master, and where they were refused. In a browser."""

from __future__ import annotations

import re
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Request, expect

from msbot_web.nicegui_internals.page_admission import MOST_WAITING
from tests.e2e.processes import Process, run, running
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import free_port, go, link_in, new_page

PASSWORD = "correct horse"
LIVE = "window.did_handshake && window.socket.connected"
DEAD = "document.documentElement.classList.contains('ms-dead')"
TABS = ("/", "/bus", "/journal", "/settings")


class Robot:
    """A robot that can be started again at the same place, and its owner."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        self.port = free_port()
        self.base = f"http://127.0.0.1:{self.port}"
        assert run("init", cwd=folder).returncode == 0
        self.master = self.start()

    def start(self) -> Process:
        link = f"udp:127.0.0.1:{self.port}"
        self.master = self._stack.enter_context(
            running("master", "--link", link, "--port", str(self.port), cwd=self._folder)
        )
        return self.master


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield Robot(tmp_path_factory.mktemp("robot"), stack)


@pytest.fixture(scope="module")
def owner(browser: Browser, robot: Robot) -> BrowserContext:
    page = new_page(browser, waits=False)
    page.goto(link_in(robot.master))
    for name, text in {"name": "ada", "password": PASSWORD, "again": PASSWORD}.items():
        page.locator(f"[name={name}]").fill(text)
    page.locator("button").click()
    page.wait_for_function(LIVE)
    return page.context


@pytest.fixture
def tab(owner: BrowserContext) -> Page:
    for other in owner.pages[1:]:
        other.close()
    return owner.pages[0]


def test_all_tabs_of_a_browser_come_back_after_a_restart_and_none_asks_again_and_again(tab: Page, robot: Robot) -> None:
    tabs = [tab, *(tab.context.new_page() for _ in TABS[1:])]
    for one, path in zip(tabs, TABS, strict=True):
        go(one, robot.base + path)
        one.evaluate("window.isOfTheFirstMaster = true")
    asked: Counter[str] = Counter()

    def note(request: Request) -> None:
        asked[request.url.removeprefix(robot.base)] += request.is_navigation_request()

    tab.context.on("request", note)
    assert robot.master.end() == 0
    for one in tabs:
        one.wait_for_function(DEAD)
        expect(one.locator("#ms-lost")).to_contain_text("The robot does not answer")
        assert one.evaluate("window.isOfTheFirstMaster"), "the shell stays"
    link_in(robot.start())
    for one, path in zip(tabs, TABS, strict=True):
        one.wait_for_function(f"!window.isOfTheFirstMaster && {LIVE}")
        assert one.url == robot.base + path
        one.wait_for_function(f"!{DEAD}")
    tab.context.remove_listener("request", note)
    assert +asked == Counter(dict.fromkeys(TABS, 1)), "each was loaded once"


@pytest.mark.promise("Where no robot answers, a browser that was there says so, and comes back by itself")
def test_where_no_robot_answers_the_page_says_so_and_comes_back(
    browser: Browser, owner: BrowserContext, robot: Robot
) -> None:
    page = new_page(browser, waits=False, keeps_shell=True)
    page.context.add_cookies(
        [{"name": one["name"], "value": one["value"], "url": robot.base} for one in owner.cookies()]
    )
    go(page, f"{robot.base}/journal")
    page.evaluate("navigator.serviceWorker.ready.then(() => true)")
    installing = page.context.new_cdp_session(page).send("Page.getInstallabilityErrors")
    assert [one["errorId"] for one in installing["installabilityErrors"]] in ([], ["in-incognito"])
    assert robot.master.end() == 0
    page.goto(f"{robot.base}/plots")
    expect(page.get_by_role("alert")).to_have_text("No robot answers here.")
    assert hurdles(page, dark=False) == []
    link_in(robot.start())
    page.wait_for_function(LIVE)
    assert page.url.partition("?")[0] == f"{robot.base}/plots"  # what it shows may stand behind
    expect(page.locator("h1").first).to_have_text("Plots")
    kept = page.evaluate(
        "caches.keys().then((names) => caches.open(names[0])).then((one) => one.keys())"
        ".then((found) => found.map((one) => new URL(one.url).pathname).sort())"
    )
    assert kept == ["/no-robot", "/web/form.css", "/web/icon.svg", "/web/no_robot.js"], "and nothing of the robot's"
    page.context.close()


@contextmanager
def asking_too_much(page: Page, robot: Robot) -> Iterator[None]:
    """A program of the same person asks for more pages at once than one may wait for."""
    cookies = {one["name"]: one["value"] for one in page.context.cookies()}
    is_over, begun = threading.Event(), threading.Event()

    def ask() -> None:
        with httpx.Client(base_url=robot.base, cookies=cookies, timeout=60) as program:
            while not is_over.is_set():
                if program.get("/journal").status_code == 429:
                    begun.set()
                    is_over.wait(0.2)

    with ThreadPoolExecutor(MOST_WAITING + 4) as pool:
        for _ in range(MOST_WAITING + 4):
            pool.submit(ask)
        try:
            assert begun.wait(60)
            yield
        finally:
            is_over.set()


def test_a_page_that_is_refused_has_stop_and_comes_back_by_itself(tab: Page, robot: Robot) -> None:
    context = tab.context
    with asking_too_much(tab, robot):
        context.route("**/turn", lambda route: route.abort())  # it comes back when STOP has been seen, not before
        for number in range(20):  # now and then there is room just then
            tab.close()  # what was let in may load itself anew, and end the loading of the next
            tab = context.new_page()
            tab.goto(f"{robot.base}/journal?x={number}")
            if tab.get_by_text(re.compile("^So many of your pages are")).count():
                break
        tab.locator("#ms-stop").click()
        expect(tab.locator("#ms-stop-says")).to_have_text(re.compile(r"STOP was sent to all parts\. \(\d+ ms\)"))
        context.unroute("**/turn")
    address = tab.url
    tab.wait_for_function(LIVE)
    assert tab.url == address
    tab.get_by_role("button", name="Go on").click()
    expect(tab.get_by_text("STOP by")).to_have_count(0)


def test_an_address_that_there_is_not_has_stop_and_a_way_to_the_robot(tab: Page, robot: Robot) -> None:
    tab.goto(f"{robot.base}/nowhere")
    expect(tab.get_by_text("There is no such page.")).to_be_visible()
    expect(tab.locator("#ms-stop")).to_be_visible()
    tab.get_by_role("link", name="To the robot").click()
    tab.wait_for_function(LIVE)
