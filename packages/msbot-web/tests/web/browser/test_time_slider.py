"""The time slider in a real browser: one person looks back, on every page, by keyboard; the robot and others go on."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, Page, Route, expect

from tests.e2e.processes import running
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import Site, again_until, go

IS_PAST = "document.documentElement?.classList.contains('ms-past')"  # there is none while a page is being loaded
IS_PRESENT = f"document.documentElement && !{IS_PAST}"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The rover with its recorder, which other tests do without."""
    folder = tmp_path_factory.mktemp("demo")
    with running("demo", "--robot", "rover", "--rec", "10min", "--port", "0", cwd=folder) as process:
        yield Site(process)


WELL_FOR_2_S = """() => {
  const all = document.querySelectorAll(".slot.is-active").length === 10;
  window.wellSince = all ? window.wellSince ?? Date.now() : undefined;
  return all && Date.now() - window.wellSince > 2000;
}"""
"""A part that was lost on a busy computer has only just come back when the tenth is active."""
AT_MS = "Number(new URL(location.href).searchParams.get('at'))"
SLIDE_TO = """(slider, to) => {
  slider.value = (to - Date.now()) / 1000;
  slider.dispatchEvent(new Event("input"));
}"""


def look_back(page: Page, to_ms: float) -> None:
    """In one move, as with a mouse, and the rest by keyboard, half a second with each press.

    The move may have been too far: the slider counts from when it was drawn, up to a second before.
    """
    slider = page.locator("#ms-moment-at")
    slider.evaluate(SLIDE_TO, to_ms + 1000)
    page.wait_for_function(IS_PAST)
    slider.focus()
    while (at_ms := page.evaluate(AT_MS)) < to_ms - 600:
        page.keyboard.press("ArrowRight")
        page.wait_for_function(f"{AT_MS} > {at_ms}")
    while (at_ms := page.evaluate(AT_MS)) > to_ms:
        page.keyboard.press("ArrowLeft")
        page.wait_for_function(f"{AT_MS} < {at_ms}")
    expect(page.locator("#ms-moment-says")).to_contain_text("The past:")


def test_one_person_looks_back_and_comes_back_by_one_key(page: Page, demo: Site, signed_in: BrowserContext) -> None:
    other = signed_in.new_page()
    go(other, demo.base)
    page.wait_for_function(WELL_FOR_2_S)
    all_is_well_ms = page.evaluate("Date.now()")
    other.get_by_role("button", name="Unplug knob").click()
    expect(other.locator("[data-slot=knob] .slot")).to_have_class("slot is-lost")
    look_back(page, all_is_well_ms)
    knob = page.locator("[data-slot=knob] .slot")
    expect(knob).to_have_class("slot is-active")
    expect(page.get_by_role("button", name="Unplug knob")).to_have_count(0)
    assert not other.evaluate(IS_PAST), "everybody else sees the present"
    assert hurdles(page, dark=False) == []
    page.locator("[data-slot=fan]").click()
    drawer = page.get_by_role("dialog")
    expect(drawer).to_contain_text("This was so at the chosen moment.")
    expect(drawer.get_by_role("button", name="Release slot")).to_have_count(0)
    page.keyboard.press("Escape")
    expect(drawer).to_have_count(0)
    assert page.evaluate(IS_PAST), "Escape closes what is open first"
    page.get_by_role("navigation").get_by_text("Bus").click()
    page.wait_for_function(IS_PAST)
    expect(page.locator("tr[data-number]").first).to_be_visible()
    page.get_by_role("navigation").get_by_text("Wires").click()
    page.wait_for_function(IS_PAST)
    expect(page.get_by_role("button", name="New slot")).to_be_hidden()
    page.locator("#ms-stop").click()
    expect(other.get_by_text("STOP by")).to_be_visible()  # STOP is said now, wherever one looks
    page.get_by_role("button", name="Go on").click()
    expect(page.get_by_text("go back to now before you change the robot")).to_be_visible()
    expect(other.get_by_text("STOP by")).to_be_visible()
    page.keyboard.press("Escape")
    page.wait_for_function(IS_PRESENT)
    expect(page.get_by_role("button", name="New slot")).to_be_visible()
    assert "at=" not in page.url
    page.get_by_role("button", name="Go on").click()
    expect(other.get_by_text("STOP by")).to_have_count(0)
    other.close()


def test_a_page_that_loads_slowly_slides_to_the_same_moment(blank: Page, demo: Site) -> None:
    page = blank

    def late(route: Route) -> None:
        time.sleep(4)
        route.continue_()

    page.route("**/moment.js", late)
    go(page, demo.base)
    page.unroute("**/moment.js")
    slider = page.locator("#ms-moment-at")
    page.wait_for_function("document.getElementById('ms-moment-says').textContent === 'Now'")
    to_ms = page.evaluate("Date.now() - 3000")
    again_until(  # what time it is comes a moment after the slider
        lambda: slider.evaluate(SLIDE_TO, to_ms),
        lambda ms: page.wait_for_function(f"Math.abs({AT_MS} - {to_ms}) < 2000", timeout=ms),
    )
    page.keyboard.press("Escape")
    page.wait_for_function(IS_PRESENT)


def test_a_moment_before_the_recorder_ran_is_refused_in_a_sentence(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?at=1600000000000")
    expect(page.locator("#ms-moment-trouble")).to_contain_text("nothing was recorded at that time")
    assert not page.evaluate(IS_PAST)
    go(page, f"{demo.base}/?at=nonsense")
    expect(page.locator("#ms-moment-says")).to_have_text("Now")
