"""The page Arena in a real browser: the world moves, a person drives, drags, pauses; another look needs no mouse."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.processes import running
from tests.web.browser.accessible import hurdles_by_day_and_night
from tests.web.browser.conftest import Site, again_until, call, go, new_page
from tests.web.browser.keyboard import out_of_reach

FRAMES = "window.msbotArenaFrames ? msbotArenaFrames() : 0"
GAPS = """new Promise((done) => {
  let frames = msbotArenaFrames(), at = performance.now();
  const gaps = [], look = () => {
    if (msbotArenaFrames() !== frames) {
      gaps.push(performance.now() - at);
      frames = msbotArenaFrames();
      at = performance.now();
    }
    gaps.length < 4 ? requestAnimationFrame(look) : done(gaps);
  };
  look();
})"""
"""Milliseconds between pictures."""
COUNT = """new Promise((done) => {
  const last = msbotArenaFrames();
  let first = null, at = 0;
  const look = () => {
    const frames = msbotArenaFrames(), now = performance.now();
    if (first === null && frames !== last) [first, at] = [frames, now];
    first !== null && now - at > 3000 ? done([frames - first, now - at]) : requestAnimationFrame(look);
  };
  look();
})"""
"""How many pictures came in some 3 s after one, and in how many milliseconds."""
WHERE = "document.querySelector('.arena-robot').getAttribute('transform')"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A robot in a world."""
    folder = tmp_path_factory.mktemp("demo")
    with running("demo", "--world", "sorting", "--rec", "off", "--port", "0", cwd=folder) as process:
        yield Site(process)


@pytest.fixture
def moving(blank: Page) -> Iterator[Page]:
    """A tab of somebody who does not mind motion."""
    blank.emulate_media(reduced_motion="no-preference")
    yield blank
    blank.emulate_media(reduced_motion="reduce")


def test_who_does_not_want_motion_sees_it_less_often(moving: Page, demo: Site) -> None:
    page = moving
    go(page, f"{demo.base}/arena")
    page.wait_for_function(f"{FRAMES} > 0")
    assert any(min(page.evaluate(GAPS)) < 300 for _ in range(20)), "on a busy machine a picture may be late"
    page.emulate_media(reduced_motion="reduce")
    frames, elapsed_ms = page.evaluate(COUNT)
    assert 0 < frames <= elapsed_ms / 500 + 1


def test_what_is_seen_is_told_in_words_and_the_keyboard_comes_to_everything(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/arena")
    told = page.locator("#ms-arena-told")
    expect(told).to_have_text(re.compile(r"robot is at [\d.]+, [\d.]+ m, looks [a-z-]+, (stands|drives).*\."))
    assert out_of_reach(page) == []
    robot = page.locator(".arena-robot")
    start = page.evaluate(WHERE)
    page.get_by_role("button", name="Pause").click()
    robot.focus()
    before = told.text_content()
    for _ in range(6):
        page.keyboard.press("ArrowRight")
    expect(told).not_to_have_text(before or "")
    anew, go_on = page.get_by_role("button", name="Begin anew"), page.get_by_role("button", name="Go on")
    again_until(anew.click, lambda ms: page.wait_for_function(f"{WHERE} === {start!r}", timeout=ms))
    again_until(
        lambda: go_on.click() if go_on.is_visible() else None, lambda ms: expect(go_on).to_have_count(0, timeout=ms)
    )


def test_a_person_drives_drags_and_pauses_the_world(moving: Page, demo: Site) -> None:
    page, errors = moving, list[str]()
    page.on("pageerror", lambda error: errors.append(str(error)))
    go(page, f"{demo.base}/arena")
    page.wait_for_function(f"{FRAMES} > 30")
    start = page.evaluate(WHERE)
    page.get_by_role("button", name="Plug the pilot in").click()
    ahead = page.get_by_role("button", name="Ahead")
    expect(ahead).to_be_visible()
    expect(page.locator("#ms-arena-senses")).to_contain_text("distance")

    def press() -> None:
        page.mouse.up()
        ahead.hover()
        page.mouse.down()

    again_until(press, lambda ms: page.wait_for_function(f"{WHERE} !== {start!r}", timeout=ms))
    expect(page.locator("body")).to_contain_text(re.compile(r"robot is at .* drives"))
    page.mouse.up()
    expect(page.locator("body")).to_contain_text(re.compile(r"robot is at .* stands"))
    assert page.locator(".arena-trails polyline").count() == 1

    pause, go_on = page.get_by_role("button", name="Pause"), page.get_by_role("button", name="Go on")

    def stand_still() -> None:
        if pause.is_visible():
            pause.click()

    again_until(stand_still, lambda ms: expect(go_on).to_be_visible(timeout=ms))
    robot = page.locator(".arena-robot")
    before = page.evaluate(WHERE)

    def nudge() -> None:
        robot.focus()
        page.keyboard.press("ArrowLeft")

    again_until(nudge, lambda ms: page.wait_for_function(f"{WHERE} !== {before!r}", timeout=ms))
    box = robot.bounding_box()
    assert box is not None
    left, top, width, height = box["x"], box["y"], box["width"], box["height"]
    picture = page.locator("svg", has=robot).bounding_box()
    assert picture is not None
    aside = (
        -150 if left > picture["x"] + picture["width"] / 2 else 150
    )  # where the robot stands depends on how long the button was held

    def drag() -> None:
        page.mouse.move(left + width / 2, top + height / 2)
        page.mouse.down()
        page.mouse.move(left + width / 2 + aside, top + height / 2, steps=4)
        page.mouse.up()

    moved = f"Math.abs(document.querySelector('.arena-robot').getBoundingClientRect().x - {left}) > 60"
    again_until(drag, lambda ms: page.wait_for_function(moved, timeout=ms))
    anew = page.get_by_role("button", name="Begin anew")
    again_until(anew.click, lambda ms: page.wait_for_function(f"{WHERE} === {start!r}", timeout=ms))
    assert hurdles_by_day_and_night(page) == []
    assert errors == []


def test_keys_drive_wherever_the_focus_is_and_the_pilot_goes_with_its_page(moving: Page, demo: Site) -> None:
    first = moving.context.new_page()
    first.emulate_media(reduced_motion="no-preference")
    go(first, f"{demo.base}/arena")
    plug, out = (first.get_by_role("button", name=name) for name in ("Plug the pilot in", "Take the pilot out"))
    again_until(lambda: plug.click() if plug.is_visible() else None, lambda ms: expect(out).to_be_visible(timeout=ms))
    out.click()
    expect(plug).to_be_visible()
    again_until(lambda: plug.click() if plug.is_visible() else None, lambda ms: expect(out).to_be_visible(timeout=ms))
    go_on = first.get_by_role("button", name="Go on")
    if go_on.is_visible():
        go_on.click()
    start = first.evaluate(WHERE)
    first.evaluate("document.activeElement.blur()")

    def drive() -> None:
        first.keyboard.up("s")
        first.keyboard.down("s")

    again_until(drive, lambda ms: first.wait_for_function(f"{WHERE} !== {start!r}", timeout=ms))
    first.keyboard.up("s")
    expect(first.locator("body")).to_contain_text(re.compile(r"robot is at .* stands"))

    go(moving, f"{demo.base}/program?name=line_follower.py")
    moving.get_by_role("button", name="Run", exact=True).click()
    note = moving.get_by_role("status").filter(has_text="The pilot of the page Arena holds the slot pilot")
    expect(note).to_be_visible()
    first.close()
    expect(note).to_be_hidden()
    moving.get_by_role("button", name="Stop", exact=True).click()


def test_who_may_only_look_is_offered_no_button_that_changes_the_world(
    blank: Page, browser: Browser, demo: Site
) -> None:
    go(blank, f"{demo.base}/arena")
    expect(blank.get_by_role("button", name="Begin anew")).to_be_visible()
    person = {"name": "Vera", "role": "viewer", "password": "long enough 1"}
    assert call(blank, "POST", "/api/users", person) == 200
    page = new_page(browser)
    page.goto(f"{demo.base}/login")
    page.fill("[name=name]", person["name"])
    page.fill("[name=password]", person["password"])
    page.click("button[type=submit]")
    page.wait_for_url(f"{demo.base}/")
    go(page, f"{demo.base}/arena")
    expect(page.get_by_role("button", name="Zoom in")).to_be_visible()
    for name in ("Begin anew", "One step", "½", "Plug the pilot in"):
        expect(page.get_by_role("button", name=name)).to_have_count(0)
