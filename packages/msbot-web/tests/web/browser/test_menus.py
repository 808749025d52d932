"""A menu for each person, the search for all, and a pupil's own group first, at a robot of thirty groups of five."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.processes import run, running
from tests.web.browser.accessible import hurdles, hurdles_by_day_and_night
from tests.web.browser.conftest import Site, call, go, new_page

PASSWORD = "long enough"
GROUPS = [f"Team{number}" for number in range(1, 31)]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A robot of thirty groups."""
    folder: Path = tmp_path_factory.mktemp("big")
    assert run("pupils", "robot", "class.toml", "--groups", ",".join(GROUPS), cwd=folder).returncode == 0
    with running("master", "class.toml", "--port", "0", "--link", "udp:127.0.0.1:0", cwd=folder) as process:
        yield Site(process)


@pytest.fixture(scope="module")
def teacher(browser: Browser, site: Site) -> Page:
    page = new_page(browser)
    page.goto(site.link)
    page.fill("[name=name]", "Novak")
    for field in ("password", "again"):
        page.fill(f"[name={field}]", PASSWORD)
    page.click("button[type=submit]")
    page.wait_for_url(f"{site.base}/")
    for name in ("Ada", "Ben"):
        assert call(page, "POST", "/api/users", {"name": name, "role": "student", "password": PASSWORD}) == 200
    kinds = ("program", "eyes", "bumper", "wheels", "lamp")
    for group, pupils in (("Team7", ["Ada"]), ("Team8", ["Ben"])):
        slots = [f"{kind}_{group}" for kind in kinds]
        assert call(page, "PUT", f"/api/class/groups/{group}", {"pupils": pupils, "slots": slots}) == 200
    return page


@pytest.fixture(scope="module")
def ada(browser: Browser, site: Site, teacher: Page) -> Page:
    assert teacher.url
    page = new_page(browser, width=390, height=844)
    page.goto(f"{site.base}/login")
    page.fill("[name=name]", "Ada")
    page.fill("[name=password]", PASSWORD)
    page.click("button[type=submit]")
    page.wait_for_url(f"{site.base}/")
    return page


def test_a_teachers_menu_has_four_groups(site: Site, teacher: Page) -> None:
    go(teacher, f"{site.base}/")
    menu = teacher.get_by_role("navigation")
    groups = {name: menu.get_by_role("group", name=name, exact=True) for name in ("Robot", "Teach", "Look", "Care")}
    assert [one.get_by_role("link").count() for one in groups.values()] == [6, 5, 5, 3]
    expect(groups["Care"].get_by_role("link", name="Admin")).to_be_visible()


TAKEN = """() => {
  const frame = document.body.appendChild(document.createElement("iframe")), own = frame.contentWindow;
  const isOwn = (one) => typeof one === "function" && /native code/.test(Function.prototype.toString.call(one));
  const taken = Object.getOwnPropertyNames(own).filter((name) => isOwn(own[name]) && !isOwn(window[name]));
  frame.remove();
  return taken;
}"""
"""Names of the browser's own functions that a script of the page has taken: `open` leads to other pages."""


@pytest.mark.parametrize("path", ["/", "/learn", "/program", "/wires"])
def test_scripts_of_a_page_leave_the_browsers_own_functions_alone(site: Site, teacher: Page, path: str) -> None:
    go(teacher, site.base + path)
    assert teacher.evaluate(TAKEN) == []


def test_everything_is_found_by_typing(site: Site, teacher: Page) -> None:
    go(teacher, f"{site.base}/journal")
    teacher.keyboard.press("Control+k")
    field = teacher.get_by_role("combobox", name="Find pages, slots and pupils")
    expect(field).to_be_focused()
    expect(teacher.locator("#ms-stop")).to_be_enabled()  # STOP stays within reach
    field.press_sequentially("lamp team17")
    expect(teacher.get_by_role("option")).to_have_text(["lamp_Team17 · Colour lamp (RGB LED)"])
    assert [one for one in hurdles(teacher, dark=False) if "notification" not in one] == []
    field.fill("ada team7")
    field.press("ArrowDown")
    field.press("Enter")
    teacher.wait_for_url("**/pupil?name=Ada")
    teacher.get_by_role("button", name="Find (Ctrl-K)").click()
    for words, found in (
        ("quiz", "Quiz · Learn"),
        ("our class", "Our class · Pupils"),
        ("program blocks", "Write a program with blocks · Handbook"),
    ):
        field.fill(words)
        expect(teacher.get_by_role("option").filter(has_text=found)).to_be_visible()
    field.fill("dioct")
    expect(teacher.get_by_text("Nothing fits.")).to_be_visible()
    field.press("Escape")
    expect(teacher.get_by_role("button", name="Find (Ctrl-K)")).to_be_focused()

    go(teacher, f"{site.base}/")
    cards = teacher.locator(".place:visible")
    expect(cards).to_have_count(150)
    teacher.get_by_label("Find cards").fill("team17 wheels")
    expect(cards).to_have_count(1)
    expect(teacher.locator("#ms-cards-count")).to_have_text("1 / 150")
    teacher.get_by_label("Find cards").fill("team8")
    expect(cards).to_have_count(5)
    teacher.get_by_label("Find cards").fill("")
    expect(cards).to_have_count(150)


def test_a_pupil_has_a_short_menu_and_the_own_group_first(site: Site, ada: Page) -> None:
    go(ada, f"{site.base}/")
    ada.get_by_role("button", name="Menu", exact=True).click()
    menu = ada.get_by_role("navigation")
    expect(menu.locator("a:visible [data-title]")).to_have_text(["Robot", "Program", "Arena", "Learn", "Help"])
    menu.get_by_text("More").click()
    expect(menu.get_by_role("link", name="Journal")).to_be_visible()
    go(ada, f"{site.base}/")
    own = ada.get_by_role("list", name="Your group: Team7")
    expect(own.locator(".place")).to_have_count(5)
    expect(ada.locator(".place:visible")).to_have_count(5 + 140)  # 28 teams have no group of pupils yet
    assert ada.locator(".ms-cards .place").first.text_content() == own.locator(".place").first.text_content()
    assert ada.locator(".ms-others [data-plug]").count() == 0
    assert hurdles_by_day_and_night(ada) == []
    ada.get_by_text("Other groups (5)").click()
    ada.get_by_role("button", name="Open slot wheels_Team8").click()
    expect(ada.get_by_role("heading", name="wheels_Team8").first).to_be_visible()
    assert ada.get_by_role("heading", name="Drive by hand").count() == 0
    for width in (320, 820, 1280):
        go(ada, f"{site.base}/")
        ada.set_viewport_size({"width": width, "height": 844})
        ada.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
