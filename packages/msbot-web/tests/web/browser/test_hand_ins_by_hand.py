"""A pupil hands in on a phone, the teacher comments and returns at a desk, and nobody else reads it."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.processes import running
from tests.web.browser.accessible import hurdles_by_day_and_night
from tests.web.browser.conftest import Site, call, go, new_page, told

PASSWORD = "correct horse battery"
NOTE = "It turns,\nbut slowly <b>today</b>."
PROGRAM = "from msbot import Part\nprint('<script>')\n"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The rover, with a database."""
    with running(
        "demo", "--robot", "rover", "--rec", "10min", "--port", "0", cwd=tmp_path_factory.mktemp("demo")
    ) as process:
        yield Site(process)


def signed_in(browser: Browser, demo: Site, name: str, width: int = 1280) -> Page:
    """Somebody's page Learn."""
    page = new_page(browser, width=width, height=844, by_finger=width < 600)
    page.goto(f"{demo.base}/login")
    page.locator("[name=name]").fill(name)
    page.locator("[name=password]").fill(PASSWORD)
    page.locator("button").click()
    go(page, f"{demo.base}/learn")
    return page


def look_at_its_recording(tina: Page, demo: Site) -> None:
    """The teacher looks at the robot as it was, back to what was handed in, and takes the file."""
    tina.get_by_role("link", name="The robot at the end").click()
    tina.wait_for_url("**/?at=*&work=1")
    tina.wait_for_function("document.documentElement?.classList.contains('ms-past')")
    expect(tina.locator(".slot")).to_have_count(10)
    expect(tina.get_by_role("button", name="A second later")).to_be_disabled()
    tina.get_by_role("button", name="A second earlier").click()
    expect(tina.get_by_role("button", name="A second later")).to_be_enabled()
    expect(tina.locator("#ms-moment-trouble")).to_be_empty()
    tina.get_by_role("button", name="Back to now").click()
    tina.wait_for_url("**/learn/hand_in/1")
    octets = tina.request.get(f"{demo.base}/api/lesson/hand_ins/1/recording").body()
    assert octets.startswith(b"\x89MCAP")
    assert octets.endswith(b"\x89MCAP0\r\n"), "whole"


@pytest.mark.promise("What a pupil hands in is read by that pupil and by teachers, and by nobody else")
def test_handed_in_returned_and_read_by_nobody_else(blank: Page, demo: Site, browser: Browser) -> None:
    go(blank, f"{demo.base}/admin")
    for name, role in {"ada": "student", "ben": "student", "vera": "viewer", "tina": "teacher"}.items():
        assert call(blank, "POST", "/api/users", {"name": name, "role": role, "password": PASSWORD}) == 200
    tina, ada, ben = (signed_in(browser, demo, *one) for one in (("tina",), ("ada", 390), ("ben",)))
    assert call(ada, "POST", "/api/lesson/hand_ins", {}) == 400, "no lesson runs"
    assert call(tina, "POST", "/api/lesson/start", {"lesson": "first_part"}) == 200
    ada.get_by_role("button", name="Take part").tap()
    ada.get_by_label("Answer").first.fill("10 slots")
    ada.get_by_role("button", name="Answer").first.tap()
    expect(ada.get_by_text("2 of 8 checks are ticked.")).to_be_visible()
    assert call(ada, "PUT", "/api/programs/lamp.py", {"text": PROGRAM}) == 200
    ada.get_by_role("button", name="Hand in", exact=True).tap()
    dialog = ada.get_by_role("dialog")
    expect(dialog.get_by_role("combobox", name="Program")).to_be_visible()
    dialog.get_by_label("What your teacher should know").fill(NOTE)
    assert hurdles_by_day_and_night(ada) == []
    dialog.get_by_role("button", name="Hand in").tap()
    told(ada, "anded in, number 1")
    expect(ada.get_by_role("link", name="Handed in: 1")).to_be_visible()
    expect(tina.get_by_role("link", name="Handed in: 1; it waits for you")).to_be_visible()
    expect(tina.get_by_role("row", name=re.compile("ada.*lamp.py"))).to_be_visible()
    tina.get_by_role("row", name=re.compile("ada.*lamp.py")).get_by_role("link").click()
    tina.wait_for_url("**/learn/hand_in/1")
    for words in (PROGRAM.strip(), NOTE, "10 slots", "2 of 8"):
        expect(tina.locator("#content")).to_contain_text(words)
    expect(tina.locator("#content")).to_contain_text(re.compile(r"Recording of the robot: \d\.\d min, 0\.\d\d MB"))
    assert hurdles_by_day_and_night(tina) == []
    look_at_its_recording(tina, demo)
    tina.get_by_label("Comment").fill("Well done. Try 80 %.")
    tina.get_by_role("button", name="Return it").click()
    tina.wait_for_url("**/learn")

    expect(ada.get_by_text("Well done. Try 80 %.")).to_be_visible()
    assert hurdles_by_day_and_night(ada) == []
    ada.get_by_role("link", name=re.compile("returned by tina")).tap()
    ada.wait_for_url("**/learn/hand_in/1")
    expect(ada.locator("#content")).to_contain_text("Well done. Try 80 %.")
    expect(ada.get_by_role("button", name="Return it")).to_have_count(0)
    ada.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    assert hurdles_by_day_and_night(ada) == []

    ada.get_by_role("link", name="The robot at the beginning").tap()
    ada.wait_for_function("document.documentElement?.classList.contains('ms-past')")
    expect(ada.locator(".slot")).to_have_count(10)
    assert call(ada, "GET", "/api/lesson/hand_ins/1/recording") == 403, "it says what everybody did at the robot"

    vera = signed_in(browser, demo, "vera")
    for other in (ben, vera):
        expect(other.get_by_role("button", name="Begin").or_(other.get_by_text("The first part")).first).to_be_visible()
        for number in (1, 2, 999):
            assert call(other, "GET", f"/api/lesson/hand_ins/{number}") == 404
            go(other, f"{demo.base}/learn/hand_in/{number}")
            expect(other.get_by_text(f"othing with the number {number} was handed in")).to_be_visible()
            assert "lamp.py" not in other.content()
            assert call(other, "GET", f"/api/lesson/hand_ins/{number}/recording") == 403
            assert "ada" not in other.locator("#content").inner_text()
        go(other, f"{demo.base}/?at=1&work=1")
        expect(other.locator("#ms-moment-trouble")).to_contain_text("othing with the number 1 was handed in")
        assert other.evaluate("fetch('/api/lesson/hand_ins').then((one) => one.json())") == []
        assert call(other, "POST", "/api/lesson/hand_ins/1/return", {"comment": "ha"}) == 403
    for word in ("0", "-1", "x", "1e3", str(2**70)):
        assert call(ben, "GET", f"/api/lesson/hand_ins/{word}") in {404, 422}
        go(ben, f"{demo.base}/learn/hand_in/{word}")
        expect(ben.get_by_text(f"othing with the number {word[:20]} was handed in")).to_be_visible()
