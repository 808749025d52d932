"""A class: two masters, each with a database of its own, and an access that leads nowhere, on one page; one STOP; one
blueprint for many."""

from __future__ import annotations

import json
import os
from pathlib import Path

from playwright.sync_api import Browser, expect

from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot.stop.socket_names import GROUP_VARIABLE
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile
from tests.e2e.processes import run, running
from tests.operations.stage import put_database
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import free_port, go, link_in, new_page, told


def test_one_page_shows_both_robots_and_one_stop_reaches_them(browser: Browser, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    away = f"http://127.0.0.1:{free_port()}"
    RemoteAccessFile(tmp_path / "msbot").add(RemoteAccess(away, "msbot_x", "GONE", "1"))
    state = {"XDG_STATE_HOME": str(tmp_path), GROUP_VARIABLE: f"{os.getpid()}class"}  # both have chosen it
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
        expect(page.locator("#ms-reach")).to_contain_text("MSBOT_MASTER")
        page.get_by_role("button", name="STOP all 3 robots of the class").click()
        expect(page.get_by_text("STOP: 2 robots were told")).to_be_visible()
        expect(page.get_by_text("NOT stopped: 1 robot on another computer does not answer: GONE 1")).to_be_visible()
        assert [one for one in hurdles(page, dark=False) if "notification" in one] == []
        expect(ring).to_contain_text("STOP is in force")
        for robot in ("ROVER", "MSBOT_MASTER"):
            status = json.loads(run("stop", "--status", "--json", "--robot", robot, cwd=tmp_path, env=state).stdout)
            assert status["stopped"] is True, robot
        page.context.close()


def test_one_blueprint_goes_to_many_robots_and_back(browser: Browser, tmp_path: Path) -> None:
    """The robot that runs, and one that does not, get what a third one has."""
    library = load_library()
    serial = next(line for line in SAMPLE_ROBOT_TOML.splitlines() if line.startswith("serial_number"))
    more = '\n[[slot]]\nname = "extra"\npart = "RELAY-1"\n'
    put_database(tmp_path / "robot.db")
    with open_registry(str(tmp_path / "robot.db")) as registry:
        for number, added in (("X2", more), ("X3", "")):
            text = SAMPLE_ROBOT_TOML.replace(serial, f'serial_number = "{number}"') + added
            registry.robots.apply_blueprint(parse_blueprint(text, library), library)

    def has_extra() -> list[bool]:
        with open_registry(str(tmp_path / "robot.db"), read_only=True) as registry:
            return ["extra" in registry.robots.slot_names(record) for record in registry.robots.all()]

    state = {"XDG_STATE_HOME": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)}
    words = ("demo", "--robot", "thesis", "--port", "0", "--db", "robot.db")
    with running(*words, cwd=tmp_path, env=state) as process:
        page = new_page(browser)
        link = link_in(process)
        there = link.partition("/enter")[0] + "/class"
        page.goto(link)
        go(page, there)
        expect(page.locator("a.slot, div.slot").filter(has_text="MSBOT_MASTER")).to_have_count(3)
        page.get_by_role("button", name="One blueprint for many").click()
        page.get_by_role("button", name="Show what would change").click()
        told(page, "Choose a blueprint first")
        page.get_by_label("Blueprint of the robot").click()
        page.get_by_role("option", name="MSBOT_MASTER X2").click()
        expect(page.get_by_text("Blueprint: MSBOT_MASTER X2")).to_be_visible()
        expect(page.get_by_role("button", name="Begin")).to_be_disabled()
        page.get_by_role("button", name="Show what would change").click()
        plan = page.locator("ul.ms-rollout > li")
        expect(plan).to_have_count(2)
        for position in (0, 1):
            expect(plan.nth(position)).to_contain_text("+ slot extra: part RELAY-1")
        assert [one for one in hurdles(page, dark=False) if "notification" not in one] == []
        page.get_by_role("button", name="Begin").click()
        page.get_by_role("button", name="Yes").click()
        expect(page.get_by_text("MSBOT_MASTER X2, rolled out: 2 of 2 robots; 0 to go, 0 not")).to_be_visible()
        expect(page.locator("ol.ms-rollout > li").filter(has_text="changed, edit")).to_have_count(2)
        assert has_extra() == [True] * 3
        page.close()
        page = page.context.new_page()
        page.set_viewport_size({"width": 390, "height": 844})
        go(page, there)
        page.get_by_role("button", name="One blueprint for many").click()
        expect(page.locator("ol.ms-rollout > li").filter(has_text="changed, edit")).to_have_count(2)
        assert hurdles(page, dark=True) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        page.get_by_role("button", name="Take it back").click()
        page.get_by_role("button", name="Yes").click()
        expect(page.get_by_text("MSBOT_MASTER X2, taken back: 2 of 2 robots; 0 to go, 0 not")).to_be_visible()
        assert sorted(has_extra()) == [False, False, True]
        page.context.close()
