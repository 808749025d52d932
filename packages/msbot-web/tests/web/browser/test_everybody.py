"""Everybody can use every page: teacher, pupil and guest, by keyboard, by finger, on a narrow phone, and on paper.

The pages are those of a person's own menu and what they lead to, so that a new page is looked at without being named
here. A page is looked at by one role in one of four settings, in turn; with MSBOT_THOROUGH=1 by all in all.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Literal

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.effort import THOROUGH
from tests.web.browser.accessible import COLOURS, hurdles, hurdles_by_day_and_night
from tests.web.browser.conftest import Site, again_until, call, go, new_page
from tests.web.browser.test_demo_pages import FITS

PASSWORD = "long enough 1"
SETTINGS = ("desk", "phone", "dark", "easy")
IN_TURN = "in turn"
MENU = "[...document.querySelectorAll('.ms-nav a')].map((link) => new URL(link.href).pathname)"
BEYOND = {
    "guest": ("/?slot=knob", "/learn/quiz?seed=7"),
    "pupil": ("/?slot=knob", "/learn/quiz?seed=7", "/library/SG90"),
    "teacher": (
        "/?slot=fan",
        "/?slot=knob",
        "/pupil?name=Mia",
        "/projector",
        "/library/SG90",
        "/learn/quiz?seed=7",
        "/handbook/howto/web_page",
        "/api-docs",
    ),
}
"""What no menu has."""


@pytest.fixture(scope="module")
def seen() -> set[str]:
    """The pages that somebody has looked at."""
    return set()


@pytest.fixture(scope="module")
def visitors(browser: Browser, demo: Site) -> Iterator[Mapping[str, Page]]:
    """One of each role."""
    teacher = new_page(browser, by_finger=True)
    go(teacher, demo.link)
    found = {"teacher": teacher}
    for name, role, of in (("Mia", "student", "pupil"), ("Gus", "viewer", "guest")):
        assert call(teacher, "POST", "/api/users", {"name": name, "role": role, "password": PASSWORD}) == 200
        found[of] = page = new_page(browser, by_finger=True)
        page.goto(f"{demo.base}/login")
        assert hurdles(page, dark=False) + hurdles(page, dark=True, rules=COLOURS) == []
        page.fill("[name=name]", name)
        page.fill("[name=password]", PASSWORD)
        page.click("button[type=submit]")
        page.wait_for_url(f"{demo.base}/")
    yield found
    for page in found.values():
        page.context.close()


@pytest.mark.timeout(600)  # some twenty pages, each of them examined
@pytest.mark.parametrize("setting", SETTINGS if THOROUGH else (IN_TURN,))
@pytest.mark.parametrize("role", BEYOND)
def test_every_page_of_a_role(
    visitors: Mapping[str, Page], demo: Site, seen: set[str], role: str, setting: str
) -> None:
    page = visitors[role]
    go(page, demo.base)
    paths = list(dict.fromkeys([*page.evaluate(MENU), *BEYOND[role]]))
    assert len(paths) > len(BEYOND[role]) + 4, "the menu has pages"
    found: list[str] = []
    for number, path in enumerate(paths):
        is_others = path in seen or (role != "teacher" and number % 2)
        if is_others and not THOROUGH:
            continue
        seen.add(path)
        looked = SETTINGS[number % len(SETTINGS)] if setting == IN_TURN else setting
        found += [f"{path}, {looked}: {one}" for one in _hurdles_in(page, demo.base + path, looked)]
    assert found == []


def _hurdles_in(page: Page, address: str, setting: str) -> list[str]:
    page.context.add_cookies([{"name": "msbot_easy", "value": "yes" if setting == "easy" else "", "url": address}])
    page.set_viewport_size({"width": 390 if setting == "phone" else 1280, "height": 844})
    go(page, address)
    expect(page.get_by_role("main")).to_have_count(1)
    expect(page.get_by_role("heading", level=1)).to_have_count(1)
    found = hurdles(page, dark=setting == "dark")
    page.set_viewport_size({"width": 320, "height": 700})
    page.wait_for_function(FITS)
    return found


@pytest.mark.parametrize(
    ("path", "opener"),
    [
        ("/admin", "Remove Gus"),
        ("/wires", "New slot"),
        ("/pupils", "Show a class ticket"),
        ("/learn", "End the lesson"),
        ("/learn", "Hand in"),
    ],
)
def test_what_opens_above_a_page_is_for_everybody(
    visitors: Mapping[str, Page], demo: Site, path: str, opener: str
) -> None:
    page = visitors["teacher"]
    page.set_viewport_size({"width": 1280, "height": 844})
    go(page, demo.base + path)
    if path == "/learn" and page.get_by_role("button", name=opener).count() == 0:
        page.get_by_role("button", name="Begin: The first part").click()
    page.get_by_role("button", name=opener, exact=True).click()
    expect(page.get_by_role("dialog")).to_be_visible()
    assert hurdles_by_day_and_night(page) == []
    page.set_viewport_size({"width": 320, "height": 700})
    page.wait_for_function(FITS)
    assert hurdles(page, dark=False) == []
    if path == "/learn":  # a lesson holds parts back
        assert call(page, "POST", "/api/lesson/stop") == 200


@pytest.mark.parametrize(
    ("path", "opener", "opened"),
    [
        ("/", "You", "menu"),
        ("/", "Help for this page", "dialog"),
        ("/program", "More", "menu"),
        ("/admin", "New password", "dialog"),
        ("/pupils", "New group", "dialog"),
    ],
)
def test_what_a_button_opens_is_for_everybody(
    visitors: Mapping[str, Page], demo: Site, path: str, opener: str, opened: Literal["menu", "dialog"]
) -> None:
    page = visitors["teacher"]
    page.set_viewport_size({"width": 1280, "height": 844})
    go(page, demo.base + path)
    page.get_by_role("button", name=opener, exact=True).first.click()
    expect(page.get_by_role(opened)).to_be_visible()
    assert hurdles_by_day_and_night(page) == []
    page.set_viewport_size({"width": 320, "height": 700})
    page.wait_for_function(FITS)
    assert hurdles(page, dark=False) == []


def test_a_newcomers_way_in_is_for_everybody(browser: Browser, visitors: Mapping[str, Page], demo: Site) -> None:
    teacher = visitors["teacher"]
    teacher.set_viewport_size({"width": 1280, "height": 844})
    go(teacher, f"{demo.base}/pupils")
    teacher.get_by_role("button", name="Show a class ticket").click()
    code = teacher.get_by_role("dialog").locator(".mono").first.inner_text()
    page = new_page(browser, width=320, height=700, by_finger=True)
    page.goto(f"{demo.base}/come")

    def readable() -> None:
        page.wait_for_function(FITS)
        assert hurdles_by_day_and_night(page) == []

    readable()
    page.get_by_label("Code of the class").fill(code)
    page.get_by_role("button", name="Next").click()
    page.get_by_role("button", name="Mia", exact=True).wait_for()
    readable()
    page.get_by_role("button", name="Mia", exact=True).click()
    page.get_by_role("group", name="Picture 1").wait_for()
    readable()
    page.context.close()


def test_a_cards_name_says_its_state_and_follows_it(visitors: Mapping[str, Page], demo: Site) -> None:
    page = visitors["teacher"]
    go(page, demo.base)
    page.get_by_role("button", name="Open slot bumper: active", exact=True).wait_for()
    page.get_by_role("button", name="Unplug bumper").click()
    expect(page.get_by_role("button", name="Open slot bumper: lost", exact=True)).to_be_visible()
    page.get_by_role("button", name="Plug bumper in").click()
    expect(page.get_by_role("button", name="Open slot bumper: active", exact=True)).to_be_visible()


def test_a_slider_says_its_name_and_value_and_obeys_every_key(visitors: Mapping[str, Page], demo: Site) -> None:
    page = visitors["teacher"]
    go(page, f"{demo.base}/?slot=knob")
    slider = page.get_by_role("slider", name=re.compile("Turn the knob"))
    slider.focus()
    for key, value in (("End", "100"), ("Home", "0"), ("ArrowRight", "0.5"), ("PageUp", "10.5"), ("ArrowLeft", "10")):
        slider.press(key)
        expect(slider).to_have_value(value)
        expect(slider).to_have_attribute("aria-valuetext", re.compile(rf"^{re.escape(value)}\b"))
    # It publishes steps of 0.5.
    expect(page.get_by_role("dialog")).to_contain_text(re.compile(r"percent\s+(10|9\.[5-9])\b"))
    expect(slider).to_have_value("10")  # what the robot answers does not put it back


def test_the_focus_stays_with_the_person(visitors: Mapping[str, Page], demo: Site) -> None:
    page = visitors["teacher"]
    go(page, demo.base)
    card = page.get_by_role("button", name="Open slot knob")
    card.press("Enter")
    expect(page.get_by_role("dialog")).to_be_visible()
    page.keyboard.press("Escape")
    expect(card).to_be_focused()
    # Another page has drawn the list anew, with the same card in it; then it is gone, and a neighbour has its place.
    page.evaluate("grid = document.querySelector('.ms-cards'), grid.parentElement.innerHTML = grid.outerHTML")
    expect(card).to_be_focused()
    page.evaluate("document.activeElement.closest('.place').remove()")
    page.wait_for_function("document.activeElement.matches('.open, .plug')")
    # A dialog whose opener is gone, too: the page's content.
    page.get_by_role("button", name="Open slot fan").press("Enter")
    expect(page.get_by_role("dialog")).to_be_visible()
    page.evaluate("document.querySelector('.ms-cards').remove()")
    dialog = page.get_by_role("dialog")
    again_until(
        lambda: dialog.get_by_role("button", name="Close").press("Enter"),  # Escape twice would be STOP
        lambda patience_ms: expect(dialog).to_have_count(0, timeout=patience_ms),
    )
    page.wait_for_function("document.activeElement !== document.body")
    # What is pressed and then greyed out, or taken away.
    go(page, f"{demo.base}/faults")
    page.get_by_role("button", name="Plant", exact=True).press("Enter")
    end = page.get_by_role("button", name=re.compile("^End")).last
    end.press("Enter")
    expect(page.get_by_text("No fault is planted")).to_be_visible()
    page.wait_for_function("document.activeElement !== document.body")


@pytest.mark.parametrize(("role", "may_change"), [("teacher", True), ("pupil", False), ("guest", False)])
def test_only_who_may_change_the_blueprint_gets_an_editor(
    visitors: Mapping[str, Page], demo: Site, role: str, *, may_change: bool
) -> None:
    page = visitors[role]
    go(page, f"{demo.base}/settings")
    page.get_by_role("tab", name="Blueprint").click()
    expect(page.get_by_role("button", name="Download")).to_be_visible()
    expect(page.locator(".cm-editor")).to_have_count(int(may_change))
    expect(page.get_by_role("button", name="Apply")).to_have_count(int(may_change))
    expect(page.get_by_text("[robot]").first).to_be_visible()


def test_ports_are_as_large_as_a_finger_needs_them(visitors: Mapping[str, Page], demo: Site) -> None:
    page = visitors["teacher"]
    page.set_viewport_size({"width": 390, "height": 844})
    go(page, f"{demo.base}/wires")
    low = (
        "[...document.querySelectorAll('.wires [role=button] .field')].map((one) => one.getBoundingClientRect().height)"
    )
    page.wait_for_function(f"{low}.length && Math.min(...{low}) >= 44")
    page.wait_for_function(FITS)


def test_on_paper_there_is_what_one_prints(visitors: Mapping[str, Page], demo: Site) -> None:
    page = visitors["teacher"]
    go(page, f"{demo.base}/missions")
    page.emulate_media(media="print")
    for one in (page.locator(".ms-header"), page.get_by_role("navigation"), page.locator("#ms-stop")):
        expect(one).to_be_hidden()
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    assert page.locator("button:visible").count() == 0
    page.emulate_media(media="screen")
