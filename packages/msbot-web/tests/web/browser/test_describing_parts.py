"""A part type that did not exist: written on the page Program, run, adopted with a click, wired to a lamp."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest
from playwright.sync_api import Browser, Page, expect

from msbot_web.pages.program import NEW
from msbot_web.programs.browser_files import examples
from tests import ROOT
from tests.e2e.processes import Process, run, running
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import Site, free_port, new_page
from tests.web.browser.test_program_page import expect_said, expect_state, open_as_ada, press, set_up, write

MINE = """from msbot import Message, Part, Switch, float32


class Mood(Message):
    units = {"warmth": "K"}
    warmth: float32


part = Part("GLOW-1", describes="Glow <b>worm</b>")
part.publishes("glow", Switch)
part.publishes("mood", Mood)


@part.on_setting("most", float, default=80.0, least=0.0, most=100.0, unit="%")
def set_most(value):
    global most
    most = value


@part.every(0.1)
def glow():
    if part.bound("glow"):
        part.publish("glow", Switch(on=most > 0))


part.run()
"""


RELAY = '[[slot]]\nname = "relay"\npart = "RELAY-1"\n'
CAMERA = """from msbot import Angle, CallError, Part, Text

part = Part("CAM-1", describes="Camera")


@part.serves("photo", Angle, Text)
def photo(request):
    if request.degrees > 90:
        raise CallError("it turns from 0 to 90 degrees only")
    return Text(text=f"a tree at {request.degrees:g} degrees")


part.run()
"""
BRAIN = """from msbot import Angle, CallError, Part, Text

part = Part("BRAIN-1", describes="Brain")
part.calls("look", Angle, Text)


@part.every(0.2)
def look():
    for degrees in (45, 99):
        try:
            part.call("look", Angle(degrees=degrees), on_reply=seen)
        except CallError as error:
            print(error)


def seen(reply, error):
    print(error or reply.text)


part.run()
"""
BIND = """async ([topic, wish]) => {
  const { csrf } = await (await fetch("/api/me")).json();
  const headers = { "content-type": "application/json", "x-csrf-token": csrf };
  return (await fetch(`/api/topics/${topic}/bind`, { method: "POST", headers, body: JSON.stringify(wish) })).status;
}"""


class Lesson(NamedTuple):
    """A robot with its page."""

    site: Site
    lamp: Process
    link: str
    """Where parts join."""


@pytest.fixture(scope="module")
def lesson(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lesson]:
    """A robot with a simulated lamp, and a slot for a relay."""
    folder = tmp_path_factory.mktemp("describing")
    assert run("init", cwd=folder).returncode == 0
    blueprint = folder / "robot.toml"
    blueprint.write_text(blueprint.read_text() + '\n[[slot]]\nname = "lamp"\npart = "LED"\n' + RELAY)
    link = f"udp:127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        process = stack.enter_context(running("master", "--link", link, "--port", "0", cwd=folder))
        site = Site(process)
        set_up(browser, site)
        lamp = stack.enter_context(running("part", "LED", "--link", link, cwd=folder))
        lamp.wait_for("active")
        yield Lesson(site, lamp, link)


def join(page: Page) -> Page:
    """A phone that has never been here scans the code that the page shows."""
    link = page.get_by_text(re.compile(r"/join\?ticket=")).text_content()
    assert link is not None
    browser = page.context.browser
    assert browser is not None
    phone = new_page(browser, width=390, height=844)
    phone.goto(link)
    phone.get_by_role("button", name="Join as a guest").click()
    phone.wait_for_function("window.did_handshake && window.socket.connected")
    expect(phone.locator(".cm-content")).to_be_visible()
    return phone


@pytest.fixture
def visit(lesson: Lesson) -> Iterator[Callable[..., Page]]:
    """Opens a page as ada, in a tab."""
    opened: list[Page] = []

    def open_it(path: str, **size: int) -> Page:
        page = open_as_ada(lesson.site, path, **size)
        opened.append(page)
        return page

    yield open_it
    for page in opened:
        page.close()


def test_one_program_one_click_and_the_lamp_obeys(
    visit: Callable[..., Page], lesson: Lesson, record_property: Callable[[str, object], None]
) -> None:
    page = visit("/program")
    press(page, "More")
    page.get_by_text("New program", exact=True).click()
    expect(page.locator(".ms-prog-choice")).to_contain_text("program1.py")
    write(page, MINE)
    began = time.monotonic()
    press(page, "Run")
    page.locator("#ms-prog-adopt button").click()
    page.get_by_role("button", name="glow_1.glow → lamp.on").click()
    lesson.lamp.wait_for("100")
    taken = time.monotonic() - began
    record_property("run_to_lamp_s", taken)
    print(f"from Run to the lamp: {taken:.2f} s")
    expect_state(page, "active")
    expect(page.locator("#ms-prog-ports")).to_contain_text("Switch(on=True)")
    expect(page.locator("#ms-prog-ports tr", has_text="mood →")).to_contain_text("not wired in this robot")
    assert page.get_by_role("link", name="The robot in another tab").get_attribute("target") == "_blank"
    assert hurdles(page, dark=True) == []
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    # It is a part type like any other.
    library = visit("/library/GLOW-1")
    expect(library.get_by_text("said by the part")).to_be_visible()
    expect(library.get_by_role("heading", name="Glow <b>worm</b>")).to_be_visible()
    # The same program on a phone without an account, by the link behind the QR code.
    press(page, "More")
    page.get_by_text("Share, or open on a phone").click()
    phone = join(page)
    expect(phone.locator(".cm-content")).to_contain_text("GLOW-1")
    press(phone, "Run")
    expect_state(phone, "standby")  # the slot is taken: it waits as a spare
    tray = visit("/arrivals", width=390, height=844)
    tray.get_by_role("button", name="Adopt into slot").click()
    tray.get_by_text("Into a new slot").click()
    expect_state(phone, "active")
    expect(phone.locator("#ms-prog-reason")).to_contain_text("In slot glow")
    phone.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    phone.wait_for_function(
        "(([box]) => box.scrollWidth <= box.clientWidth)(document.querySelectorAll('.ms-prog-side .scroll'))"
    )
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    for one in (phone, page):
        press(one, "Stop")
    phone.context.close()


def test_a_part_in_one_browser_calls_a_part_in_another(visit: Callable[..., Page]) -> None:
    camera, brain = visit("/program"), visit("/program")
    for page, program in ((camera, CAMERA), (brain, BRAIN)):
        write(page, program)
        press(page, "Run")
        page.locator("#ms-prog-adopt button").click()
        expect_state(page, "active")
    brain.get_by_role("button", name="cam_1.photo → brain_1.look").click()
    expect_said(brain, "a tree at 45 degrees")
    expect_said(brain, "call of look: refused: it turns from 0 to 90 degrees only")
    expect(brain.locator("#ms-prog-ports tr", has_text="look ⇢")).to_contain_text("Angle -> Text")
    expect(camera.locator("#ms-prog-ports tr", has_text="photo ⇠")).to_contain_text("Angle -> Text")
    for page in (brain, camera):  # both were offered wires
        page.get_by_role("dialog").get_by_role("button", name="Close").click()
    press(camera, "Stop")
    expect_said(brain, "call of look: the robot does not pass it on: slot cam_1 is empty")
    write(brain, BRAIN.replace(", on_reply=seen", ""))
    press(brain, "Run")
    expect_said(brain, ":11 in look: part.call('look', ...) cannot wait for the reply on boards and in browsers")
    press(brain, "Stop")


def test_a_phone_without_an_account_is_a_part_that_switches_a_relay(
    visit: Callable[..., Page], lesson: Lesson, tmp_path: Path
) -> None:
    page = visit("/program")
    press(page, "More")
    page.get_by_text("A phone as a part").click()
    phone = join(page)
    expect(page.get_by_text("Used. For another device make a new code.")).to_be_visible()
    expect(phone.get_by_role("button", name="More", exact=True)).to_have_count(0)
    phone.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    press(phone, "Run")
    expect_state(phone, "refused")
    tray = visit("/arrivals", width=390, height=844)
    tray.get_by_role("button", name="Adopt into slot").click()
    tray.get_by_text("Into a new slot, phone").click()
    expect_state(phone, "active")
    status = tray.evaluate(BIND, ["button_1", {"from": "phone.button_1", "to": ["relay.on"], "type": "Switch"}])
    assert status == 200
    expect(phone.locator("#ms-prog-ports")).to_contain_text("button_1 →")
    button = phone.get_by_role("button", name="1", exact=True)
    with running("part", "RELAY-1", "--link", lesson.link, cwd=tmp_path) as relay:
        relay.wait_for("active")
        for act, is_on in (("pointerdown", "true"), ("pointerup", "false")):
            button.dispatch_event(act)
            relay.wait_for(f"closed {is_on}")
    press(phone, "Stop")
    phone.context.close()


def test_arrivals_shows_what_it_says_as_text_and_why_it_is_refused(visit: Callable[..., Page]) -> None:
    page = visit("/program")
    wrong = MINE.replace("GLOW-1", "GLOW-2").replace("class Mood", "class Light").replace("Mood)", "Light)")
    tray = visit("/arrivals")
    for program, words in (
        (wrong, 'the message type "Light" has other fields'),
        (MINE.replace("GLOW-1", "GLOW-3"), ""),
    ):
        write(page, program)
        press(page, "Run")
        expect_state(page, "refused")
        card = tray.locator(".slot", has_text="GLOW-")
        if words:
            expect(card).to_contain_text(words)
            expect(card.get_by_role("button", name="Adopt", exact=True)).to_have_count(0)
        else:
            expect(card).to_contain_text("It describes itself: Glow <b>worm</b>")
            expect(card).to_contain_text("most = 80.0 % (0 … 100)")
            expect(card).to_contain_text("mood → Mood (warmth K)")
            expect(card).not_to_contain_text("library file")
            assert card.locator("b", has_text="worm").count() == 0, "as data"
            assert hurdles(tray, dark=False) == []
            tray.set_viewport_size({"width": 390, "height": 844})
            tray.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        press(page, "Stop")
        expect_state(page, "not running")
        expect(card).to_have_count(0)


def test_a_new_program_is_that_of_the_how_to() -> None:
    page = (ROOT / "docs/howto/add_a_part_type.md").read_text()
    assert f"```python\n{examples()[NEW]}```" in page
