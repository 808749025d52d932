"""Learn and Missions as a teacher and a pupil with a phone have them open together: nobody loads a page again."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.processes import running
from tests.web.browser.accessible import hurdles_by_day_and_night
from tests.web.browser.conftest import Site, call, go, new_page, told
from tests.web.browser.test_demo_pages import FITS, choose

PASSWORD = "a pupil's own"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with running("demo", "--robot", "rover", "--port", "0", cwd=tmp_path_factory.mktemp("demo")) as process:
        yield Site(process)


@pytest.fixture(scope="module")
def pupil(browser: Browser, tab: Page, demo: Site) -> Page:
    """A pupil whom the teacher has let in, with a phone."""
    go(tab, demo.base)
    assert call(tab, "POST", "/api/users", {"name": "Ada", "role": "student", "password": PASSWORD}) == 200
    phone = new_page(browser, width=390, height=844, by_finger=True)
    phone.context.add_cookies([{"name": "msbot_tour", "value": "seen", "url": demo.base}])
    phone.goto(f"{demo.base}/login?next=/learn")
    phone.fill("[name=name]", "Ada")
    phone.fill("[name=password]", PASSWORD)
    phone.click("button[type=submit]")
    phone.wait_for_function("window.did_handshake && window.socket.connected")
    return phone


def test_a_lesson_comes_to_a_pupil_who_waits_on_the_page_learn(blank: Page, pupil: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/learn")
    expect(pupil.get_by_text("A teacher begins a lesson.")).to_be_visible()
    expect(pupil.get_by_role("button", name="Begin")).to_have_count(0)
    assert pupil.evaluate(FITS)
    loop = page.locator(".panel .row", has_text="Closing the loop").first
    expect(loop.get_by_text("needs a robot in the world line", exact=False)).to_be_visible()
    expect(loop.get_by_role("button")).to_have_count(0)
    expect(loop.get_by_role("link", name="Robots and worlds")).to_have_attribute("href", "/gallery")
    page.get_by_role("button", name="Begin: A part dies").click()
    pupil.get_by_role("button", name="Take part").tap()
    expect(page.get_by_text("Taking part: demo, Ada")).to_be_visible()
    assert hurdles_by_day_and_night(pupil) == []
    assert pupil.evaluate(FITS)
    end = page.get_by_role("button", name="End the lesson")
    end.click()
    expect(page.get_by_role("dialog")).to_be_visible()
    page.keyboard.press("Escape")  # leaves the question, and is no STOP
    expect(page.get_by_role("dialog")).to_have_count(0)
    expect(page.get_by_text("STOP by")).to_have_count(0)
    end.click()
    page.get_by_role("button", name="Yes").click()
    told(page, "everything is as it was before")
    expect(pupil.get_by_text("A teacher begins a lesson.")).to_be_visible()


def test_a_mission_comes_to_a_pupil_and_goes_without_loading_a_page(blank: Page, pupil: Page, demo: Site) -> None:
    page = blank
    go(pupil, f"{demo.base}/missions")
    expect(pupil.get_by_text("A teacher starts one here.")).to_be_visible()
    go(page, f"{demo.base}/missions")
    begin = page.get_by_role("button", name="Start")
    choose(page, "Mission", 0, "wrong-hands · needs another robot")
    expect(begin).to_be_disabled()
    others = page.locator(".panel").get_by_role("link", name="Robots and worlds")
    expect(others).to_be_visible()
    choose(page, "Mission", 0, "one-silent")
    expect(begin).to_be_enabled()
    expect(others).to_be_hidden()
    begin.click()
    expect(pupil.get_by_role("timer", name="Time left")).to_be_visible()
    expect(pupil.get_by_role("button", name="Stop the mission")).to_have_count(0)
    pupil.get_by_role("button", name="That is it").tap()
    told(pupil, "Choose a fault and a place first.")
    pupil.get_by_role("button", name="Do it").tap()
    told(pupil, "Choose a repair and a place first.")
    pupil.get_by_role("button", name="A hint, please").tap()
    expect(page.get_by_text("hints left: 2")).to_be_visible()
    assert pupil.evaluate(FITS)
    assert hurdles_by_day_and_night(pupil) == []
    # STOP goes before a mission: it ends, on all pages, and the report says so.
    assert call(pupil, "POST", "/api/stop", {}) == 200
    expect(pupil.get_by_text("A teacher starts one here.")).to_be_visible()
    expect(page.get_by_role("heading", name="Reports")).to_be_visible()
    begin.click()
    told(page, "STOP is in force: no mission begins until GO")
    page.get_by_role("button", name="Go on").click()
    expect(page.get_by_text("STOP by")).to_have_count(0)
