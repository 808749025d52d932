"""Three pupils at one robot, each with a browser: the class table, the CSV and the panel are right to the tick."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.processes import running
from tests.web.browser.conftest import Site, again_until, call, go, new_page

PASSWORD = "correct horse battery"
PEOPLE = {"tina": "teacher", "ada": "student", "ben": "student", "cleo": "student"}


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The rover without a spare part."""
    with running("demo", "--robot", "rover", "--port", "0", cwd=tmp_path_factory.mktemp("demo")) as process:
        yield Site(process)


def signed_in(browser: Browser, demo: Site, name: str, width: int, path: str) -> Page:
    page = new_page(browser, width=width, height=900)
    page.goto(f"{demo.base}/login")
    page.locator("[name=name]").fill(name)
    page.locator("[name=password]").fill(PASSWORD)
    page.locator("button").click()
    go(page, demo.base + path)
    return page


def press(page: Page, name: str, seen: str) -> None:
    """Press what is on the knob's card, until the card says what comes of it."""
    again_until(
        page.get_by_role("button", name=name).click,
        lambda ms: expect(page.get_by_role("button", name=f"Open slot knob: {seen}")).to_be_visible(timeout=ms),
    )


def has(page: Page, count: int) -> None:
    """How many checks are ticked for a pupil, as the lesson beside the robot says."""
    expect(page.get_by_role("complementary", name="Lesson")).to_contain_text(f"{count}/8")


@pytest.mark.promise("What ticks in a lesson belongs to the person who did it")
def test_a_class_of_three_is_graded_to_the_tick(blank: Page, demo: Site, browser: Browser, tmp_path: Path) -> None:
    go(blank, f"{demo.base}/admin")
    for name, role in PEOPLE.items():
        assert call(blank, "POST", "/api/users", {"name": name, "role": role, "password": PASSWORD}) == 200
    tina = signed_in(browser, demo, "tina", 1280, "/learn")
    assert call(tina, "PUT", "/api/class/groups/red", {"pupils": ["ada", "ben"], "slots": []}) == 200
    assert call(tina, "POST", "/api/lesson/start", {"lesson": "first_part"}) == 200
    pupils = {}
    for name, width in (("ada", 1280), ("ben", 390), ("cleo", 820)):
        page = signed_in(browser, demo, name, width, "/learn")
        page.get_by_role("button", name="Take part").click()
        expect(page.get_by_text("1 of 8 checks are ticked.")).to_be_visible()
        go(page, demo.base)
        pupils[name] = page
    ada, ben, cleo = pupils.values()

    lesson = ada.get_by_role("complementary", name="Lesson")
    lesson.get_by_label("Answer").first.fill("ten slots")
    lesson.get_by_role("button", name="Answer").first.click()
    has(ada, 2)
    press(ada, "Plug knob in", "active")
    has(ada, 3)
    has(ben, 2)  # she is of his group
    has(cleo, 1)  # and not of hers
    press(cleo, "Unplug knob", "lost")
    press(cleo, "Plug knob in", "active")
    has(cleo, 2)
    has(ada, 3)

    table = {
        "ada": ("3 of 8", "2 by own hand"),
        "ben": ("2 of 8", "1 with the group (ada)"),
        "cleo": ("2 of 8", "1 by own hand"),
    }
    for name, words in table.items():
        row = tina.get_by_role("row", name=re.compile(f"^{name}"))
        for word in words:
            expect(row).to_contain_text(word)
    with tina.expect_download() as download:
        tina.get_by_role("button", name="Table (CSV)").click()
    download.value.save_as(tmp_path / "lessons.csv")
    rows = {one["person"]: one for one in csv.DictReader((tmp_path / "lessons.csv").read_text().splitlines())}
    marks = ("ticked", "checks", "own", "group", "helped", "robot", "partners")
    assert {name: tuple(rows[name][mark] for mark in marks) for name in table} == {
        "ada": ("3", "8", "2", "0", "0", "1", ""),
        "ben": ("2", "8", "0", "1", "0", "1", "ada"),
        "cleo": ("2", "8", "1", "0", "0", "1", ""),
    }
