"""A lesson: a master and parts in processes of their own, a teacher and a student in real browsers."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, expect

from msbot_web.access.sign_in_throttle import FREE_TRIES
from tests.e2e.processes import Process, run, running
from tests.web.browser.conftest import call, free_port, link_in, new_page

PASSWORD = "correct horse"
FREE_SLOT = """
[[slot]]
name = "DD"
part = "SG90"
"""
STRANGER = """
number = "STRANGER"
name = "Home-made"
[[port]]
name = "out"
direction = "publish"
type = "HelloWorld"
"""
"""A part type that the master's library does not have."""


class ClassRoom:
    """A robot of three parts and one free slot, its page, and the people who may sign in."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder = folder
        self._stack = stack
        self._port = free_port()
        self.base = f"http://127.0.0.1:{self._port}"
        self.signed_in: dict[str, BrowserContext] = {}
        """The browsers of people who have signed in, with what they have loaded."""
        assert run("init", cwd=folder).returncode == 0
        blueprint = folder / "robot.toml"
        blueprint.write_text(blueprint.read_text() + FREE_SLOT)
        (folder / "home").mkdir()
        (folder / "home" / "STRANGER.toml").write_text(STRANGER)
        self.master = self.start_master()
        self.parts = {name: self.part(name) for name in ("AA", "BB", "CC")}

    def start_master(self) -> Process:
        """The master, always at the same place."""
        link = f"udp:127.0.0.1:{self._port}"
        self.master = self._stack.enter_context(
            running("master", "--link", link, "--port", str(self._port), cwd=self._folder)
        )
        return self.master

    def part(self, *arguments: str) -> Process:
        """A part in a process of its own."""
        state = {"XDG_STATE_HOME": str(self._folder / "state")}
        link = f"udp:127.0.0.1:{self._port}"
        return self._stack.enter_context(running("part", *arguments, "--link", link, cwd=self._folder, env=state))

    @contextmanager
    def extra_part(self, *arguments: str) -> Iterator[Process]:
        """A part that is pulled out at the end."""
        process = self.part(*arguments)
        try:
            yield process
        finally:
            process.end(signal.SIGKILL)

    def add_people(self, **roles: str) -> None:
        """Let people sign in."""
        with httpx.Client(base_url=self.base, timeout=30) as ada:
            assert ada.post("/login", data={"name": "ada", "password": PASSWORD}).status_code == 303
            ada.headers["x-csrf-token"] = ada.get("/api/me").json()["csrf"]
            for name, role in roles.items():
                answer = ada.post("/api/users", json={"name": name, "role": role, "password": PASSWORD})
                assert answer.status_code == 200, answer.text


def fill_in(page: Page, **fields: str) -> None:
    """Fill a form in and send it."""
    for name, text in fields.items():
        page.locator(f"[name={name}]").fill(text)
    page.locator("button").click()


@contextmanager
def visit(browser: Browser, room: ClassRoom, name: str, path: str = "/") -> Iterator[Page]:
    """Somebody on the page they wanted; the first time they are asked to sign in before."""
    is_new = name not in room.signed_in
    page = new_page(browser) if is_new else room.signed_in[name].new_page()
    page.goto(room.base + path)
    if is_new:
        fill_in(page, name=name, password=PASSWORD)
    room.signed_in[name] = page.context
    expect(page.get_by_role("button", name=re.compile("STOP"))).to_be_visible()
    yield page
    page.close()


@pytest.fixture(scope="module")
def room(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ClassRoom]:
    """A class room that ada has set up by the link that the master has printed."""
    with ExitStack() as stack:
        room = ClassRoom(tmp_path_factory.mktemp("room"), stack)
        link = link_in(room.master)
        page = new_page(browser)
        page.goto(link)
        fill_in(page, name="ada", password=PASSWORD, again=PASSWORD)
        expect(page.get_by_role("heading", level=1)).to_have_text("Robot")
        page.goto(link)
        fill_in(page, name="eve", password=PASSWORD, again=PASSWORD)
        expect(page.get_by_role("alert")).to_contain_text("this set-up link is not valid")
        page.context.close()
        room.add_people(tina="teacher", stu="student", ludwig="student")
        for part in room.parts.values():
            part.wait_for("active")
        yield room


def card_of(page: Page, slot: str) -> Locator:
    """The card of a slot on the robot page."""
    return page.get_by_role("button", name=f"Open slot {slot}")


def test_wrong_passwords_lock_out_and_nobody_else(browser: Browser, room: ClassRoom) -> None:
    page = new_page(browser)
    page.goto(f"{room.base}/login")
    for _ in range(FREE_TRIES):
        fill_in(page, name="ludwig", password="a wrong one")
        expect(page.get_by_role("alert")).to_have_text("wrong name or password")
    fill_in(page, name="ludwig", password=PASSWORD)
    expect(page.get_by_role("alert")).to_contain_text("too many wrong passwords: try again in")
    page.context.close()
    with visit(browser, room, "stu") as other:
        expect(other.get_by_role("heading", level=1)).to_have_text("Robot")


def test_an_unknown_part_is_adopted_while_the_window_is_open(browser: Browser, room: ClassRoom) -> None:
    with visit(browser, room, "tina", "/arrivals") as page, room.extra_part("STRANGER", "--library", "home"):
        card = page.locator(".slot").filter(has_text="STRANGER")
        expect(card).to_contain_text("refused")
        expect(card).to_contain_text("library")
        card.get_by_role("button", name="Adopt").click()
        page.get_by_role("menuitem", name=re.compile("^DD")).click()
        expect(page.get_by_role("alert").filter(has_text="window")).to_be_visible()
        page.get_by_role("button", name="Open for 60 s").click()
        expect(page.get_by_text(re.compile(r"window is open for \d+ s more"))).to_be_visible()
        card.get_by_role("button", name="Adopt").click()
        items = page.get_by_role("menuitem")
        expect(items).to_have_count(1)  # slots that are taken are not offered
        items.click()
        expect(card).to_have_count(0)
        page.get_by_role("button", name="Close", exact=True).first.click()
        page.goto(room.base)
        expect(card_of(page, "DD")).to_contain_text("active")


def test_a_swap_and_its_undo(browser: Browser, room: ClassRoom) -> None:
    with visit(browser, room, "tina", "/arrivals") as page, room.extra_part("ABCD", "--name", "spare"):
        waiting = page.locator(".slot .title").filter(has_not_text="STRANGER")
        expect(waiting).to_have_text("spare")
        page.goto(f"{room.base}/?slot=AA")
        page.get_by_role("button", name="Swap to spare").click()
        expect(page.get_by_role("dialog")).to_contain_text("tina swapped slot AA to spare")
        page.goto(f"{room.base}/arrivals")
        expect(waiting).to_have_text("ABCD-local")
        page.goto(f"{room.base}/journal")
        page.get_by_role("tab", name="Changes by people").click()
        page.get_by_role("button", name="Undo").first.click()
        expect(page.get_by_text("undone", exact=True).first).to_be_visible()
        page.goto(f"{room.base}/arrivals")
        expect(waiting).to_have_text("spare")


def test_a_student_sees_no_teachers_buttons_and_is_refused_by_the_server(browser: Browser, room: ClassRoom) -> None:
    with visit(browser, room, "stu") as page, room.extra_part("ABCD", "--name", "spare"):
        expect(page.get_by_role("link", name="Program")).to_be_visible()
        expect(page.get_by_role("link", name="Admin")).to_have_count(0)
        page.goto(f"{room.base}/?slot=BB")
        expect(page.get_by_role("button", name="Identify")).to_be_visible()
        for forbidden in ("Release slot", "Block part", "Swap to"):
            expect(page.get_by_role("button", name=forbidden)).to_have_count(0)
        page.goto(f"{room.base}/arrivals")
        # The part of the test before, which has left, may still be shown there.
        expect(page.locator(".slot").filter(has_text="spare").get_by_role("button", name="Why?").first).to_be_visible()
        for forbidden in ("Adopt", "Ignore", "Block", "Open for 60 s"):
            expect(page.get_by_role("button", name=forbidden)).to_have_count(0)
        page.goto(f"{room.base}/admin")
        expect(page.get_by_text("Only an administrator sees this page.")).to_be_visible()
        assert call(page, "POST", "/api/slots/BB/release", {}) == 403
        assert call(page, "POST", "/api/users", {"name": "x", "role": "viewer", "password": PASSWORD}) == 403
        assert call(page, "GET", "/api/backup", None) == 403
        page.goto(room.base)
        expect(card_of(page, "BB")).to_contain_text("active")


def test_a_part_that_is_pulled_out_is_shown_as_lost_and_comes_back(browser: Browser, room: ClassRoom) -> None:
    with visit(browser, room, "stu") as page:
        card = card_of(page, "CC")
        expect(card).to_contain_text("active")
        room.parts["CC"].end(signal.SIGKILL)
        expect(card).to_contain_text("lost")
        room.parts["CC"] = room.part("CC")
        expect(card).to_contain_text("active")


def test_after_a_restart_of_the_master_the_page_comes_back_to_its_view(browser: Browser, room: ClassRoom) -> None:
    with visit(browser, room, "tina", "/?slot=BB") as page:
        expect(page.get_by_role("heading", name="BB")).to_be_visible()
        page.reload()
        expect(page.get_by_role("heading", name="BB")).to_be_visible()
        page.evaluate("window.isOfTheFirstMaster = true")
        assert room.master.end() == 0
        assert not [line for line in room.master.lines if "Error" in line or "Traceback" in line]
        link_in(room.start_master())
        # The session survives the master: the page is made anew by itself, with what was open.
        page.wait_for_function("!window.isOfTheFirstMaster && window.did_handshake")
        expect(page.get_by_role("heading", name="BB")).to_be_visible()
        expect(page.get_by_role("dialog")).to_contain_text("active")
        for slot in ("AA", "CC"):
            expect(card_of(page, slot)).to_contain_text("active")


def test_who_is_removed_sees_nothing_any_more(browser: Browser, room: ClassRoom) -> None:
    room.add_people(guest="viewer")
    with visit(browser, room, "ada", "/admin") as ada, visit(browser, room, "guest") as page:
        ada.get_by_role("button", name="Remove guest").click()
        ada.get_by_role("button", name="Yes").click()
        expect(page).to_have_url(re.compile("/login"))
        fill_in(page, name="guest", password=PASSWORD)
        expect(page.get_by_role("alert")).to_have_text("wrong name or password")
