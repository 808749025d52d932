"""A class: two masters, each with a database of its own, and an access that leads nowhere, on one page; one STOP."""

from __future__ import annotations

import json
from pathlib import Path

from playwright.sync_api import Browser, expect

from msbot.school.access import AccessBook, FarAccess
from tests.e2e.processes import run, running
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import free_port, link_in, new_page


def test_one_page_shows_both_robots_and_one_stop_reaches_them(browser: Browser, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    away = f"http://127.0.0.1:{free_port()}"
    AccessBook(tmp_path / "msbot").keep(FarAccess(away, "msbot_x", "GONE", "1"))
    state = {"XDG_STATE_HOME": str(tmp_path)}
    with (
        running("demo", "--robot", "rover", "--port", "0", cwd=tmp_path / "one", env=state) as first,
        running("demo", "--robot", "thesis", "--port", "0", cwd=tmp_path / "two", env=state) as second,
    ):
        page = new_page(browser)
        link = link_in(first)
        other = link_in(second).partition("/enter")[0]
        page.goto(link)
        page.goto(link.partition("/enter")[0] + "/class")
        tiles = page.locator("a.slot")
        expect(tiles.filter(has_text="ROVER")).to_contain_text("all well")
        ring = tiles.filter(has_text="MSBOT_MASTER")
        expect(ring).to_have_attribute("href", other)
        gone = tiles.filter(has_text="GONE")
        expect(gone).to_contain_text(f"{away}: Connection refused")
        expect(gone).not_to_contain_text("slots active")
        shown = page.locator("a.slot:visible")
        page.get_by_label("Search").fill("msbot_master")
        expect(shown).to_have_count(1)
        page.get_by_label("Search").fill("")
        expect(shown).to_have_count(3)
        page.get_by_role("button", name="STOP all robots of the class").click()
        expect(page.get_by_text("STOP: 2 robots were told")).to_be_visible()
        expect(page.get_by_text("NOT stopped: 1 robots on other computers do not answer: GONE 1")).to_be_visible()
        assert [one for one in hurdles(page, dark=False) if "notification" in one] == []
        expect(ring).to_contain_text("STOP is in force")
        for robot in ("ROVER", "MSBOT_MASTER"):
            status = json.loads(run("stop", "--status", "--json", "--robot", robot, cwd=tmp_path).stdout)
            assert status["stopped"] is True, robot
        page.context.close()
