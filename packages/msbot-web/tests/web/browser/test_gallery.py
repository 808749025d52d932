"""The first evening: from the demo's page to a robot in a world, its program, and back, without a command line."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.prepared import REAL
from tests.e2e.processes import running
from tests.web.browser.accessible import hurdles_by_day_and_night
from tests.web.browser.conftest import Site, call, go, new_page

LIVE = "window.did_handshake && window.socket.connected"
ENDS = "fetch('/api/gallery').then((one) => one.json()).then((one) => one.ends.length)"
"""Whether anything would end by a change."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The demo as `make demo` starts it; it takes its own place later, which a copy of a prepared process cannot."""
    folder = tmp_path_factory.mktemp("demo")
    with running("demo", "--rec", "off", "--port", "0", cwd=folder, env={REAL: "1"}) as process:
        yield Site(process)


def robot_of(page: Page) -> str:
    """What runs, as the page's own API says it."""
    found: str = page.evaluate("fetch('/api/gallery').then((one) => one.json()).then((one) => one.robot + one.world)")
    return found


@pytest.mark.promise("The page starts any sample robot and world of a demo, and comes back with it by itself")
def test_a_world_is_chosen_and_the_page_comes_back_with_it(blank: Page, demo: Site, browser: Browser) -> None:
    page = blank
    go(page, f"{demo.base}/gallery")
    assert hurdles_by_day_and_night(page) == []
    other = new_page(browser, waits=False)  # a second device, which the demo's link has let in
    other.goto(demo.link)
    go(other, f"{demo.base}/journal")
    assert call(page, "POST", "/api/gallery", {"robot": "buggy", "world": "nowhere"}) == 400
    assert call(page, "POST", "/api/lesson/start", {"lesson": "ring"}) == 200
    assert call(page, "POST", "/api/gallery", {"robot": "buggy", "world": "line"}) == 409
    page.get_by_role("button", name="Start: Line track").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("The lesson 'The ring' ends")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_have_count(0)
    assert robot_of(page) == "rover"
    page.get_by_role("button", name="Start: Line track").click()
    dialog.get_by_role("button", name="Yes, change").click()
    page.wait_for_url("**/arena")
    page.wait_for_function(LIVE)
    assert robot_of(page) == "buggyline"
    other.wait_for_function(f"{LIVE} && document.querySelector('.ms-robot').textContent === 'BUGGY'")
    assert other.url == f"{demo.base}/journal"
    other.close()


@pytest.mark.promise("The page starts any sample robot and world of a demo, and comes back with it by itself")
def test_the_program_of_a_world_drives_and_one_click_leads_back(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/program")
    if robot_of(page) != "buggyline":  # this test alone
        page.evaluate("msbotChannel.comeBackTo('/program')")
        assert call(page, "POST", "/api/gallery", {"robot": "buggy", "world": "line"}) == 200
        page.wait_for_function(f"{LIVE} && document.querySelector('.ms-robot').textContent === 'BUGGY'")
    expect(page.get_by_role("combobox", name="Program")).to_have_value("line_follower.py (example)")
    page.get_by_role("button", name="Run", exact=True).click()
    arena = page.context.new_page()
    go(arena, f"{demo.base}/arena")
    arena.wait_for_function(ENDS)
    expect(arena.locator("body")).to_contain_text(re.compile("robot is at .* drives"))
    arena.get_by_role("button", name="Back to the rover").click()
    expect(arena.get_by_role("dialog")).to_contain_text("Programs and parts of people stop")
    arena.get_by_role("button", name="Yes, change").click()
    arena.wait_for_url(f"{demo.base}/")
    arena.wait_for_function(LIVE)
    assert robot_of(arena) == "rover"
    expect(arena.get_by_role("button", name="Back to the rover")).to_have_count(0)
    arena.close()


@pytest.mark.promise("STOP holds at the robot that takes another one's place")
def test_stop_holds_at_the_robot_that_comes_and_what_was_typed_is_there(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/program?name=00_blink.py")
    text = page.locator(".cm-content")
    text.click()
    page.keyboard.press("Control+Home")
    page.keyboard.type("# typed and not kept\n")
    expect(text).to_contain_text("# typed and not kept")
    assert call(page, "POST", "/api/stop", {}) == 200
    assert call(page, "POST", "/api/gallery", {"robot": "thesis"}) == 409
    assert call(page, "POST", "/api/gallery", {"robot": "thesis", "agreed": True}) == 200
    expect(page.locator(".ms-robot")).to_have_text("MSBOT_MASTER")
    page.wait_for_function(LIVE)
    expect(page.locator(".ms-banner.bad")).to_contain_text("STOP by demo")
    expect(text).to_contain_text("# typed and not kept")
