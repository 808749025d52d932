"""Whole lessons in a real browser, as pupils do them: with the mouse, by keyboard only, and easy to read."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.e2e.processes import running
from tests.web.browser.accessible import hurdles, hurdles_by_day_and_night
from tests.web.browser.conftest import PATIENCE_MS, Site, again_until, go, told
from tests.web.browser.keyboard import out_of_reach, tab_to


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The rover without a spare part: what a lesson takes out is lost at once, and nothing takes its place first."""
    with running("demo", "--robot", "rover", "--port", "0", cwd=tmp_path_factory.mktemp("demo")) as process:
        yield Site(process)


@pytest.fixture
def learn(blank: Page, demo: Site) -> Iterator[Page]:
    """The page Learn; whatever lesson has begun is ended afterwards."""
    go(blank, f"{demo.base}/learn")
    yield blank
    blank.context.clear_cookies(name="msbot_easy")
    go(blank, f"{demo.base}/learn")
    blank.get_by_role("button", name="End the lesson").click()
    blank.get_by_role("button", name="Yes").click()
    told(blank, "everything is as it was before")
    expect(blank.get_by_role("button", name="Begin: The ring")).to_be_visible()


@pytest.fixture
def robot(learn: Page, demo: Site) -> Iterator[Page]:
    """The page Robot in a second tab, as pupils have it."""
    tab = learn.context.new_page()
    go(tab, demo.base)
    yield tab
    tab.close()


def ticked(page: Page, number: int, patience_ms: float = PATIENCE_MS) -> None:
    expect(page.get_by_text(f"{number} of 8 checks are ticked.")).to_be_visible(timeout=patience_ms)


def button(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=name).first


def test_a_lesson_with_the_mouse(learn: Page, robot: Page) -> None:
    def answer(choice: str) -> None:
        learn.get_by_role("combobox", name="Answer").first.click()
        learn.get_by_role("option", name=choice).click()
        button(learn, "Answer").click()

    expect(learn.get_by_text("Nobody has begun a lesson yet.")).to_be_visible()
    learn.get_by_role("button", name="Begin: The first part").click()
    ticked(learn, 1)
    expect(learn.get_by_text("Taking part: demo")).to_be_visible()
    assert hurdles(learn, dark=False) == []
    field = learn.get_by_label("Answer").first
    field.fill("eleven")
    field.press("Enter")
    expect(learn.get_by_text("that is not right yet")).to_be_visible()
    field.fill("10")
    button(learn, "Answer").click()
    ticked(learn, 2)
    button(learn, "Ask for help").click()
    expect(learn.get_by_text("Asking for help: demo")).to_be_visible()
    button(learn, "No help needed").click()
    expect(learn.get_by_text("Asking for help: demo")).to_be_hidden()
    button(robot, "Plug knob in").click()
    ticked(learn, 3)
    row = learn.get_by_role("row").filter(has_text="demo")
    expect(row).to_contain_text("The first part")
    expect(row).to_contain_text("3 of 8")
    knob = button(robot, "Open slot knob")
    knob.click()
    slider = robot.get_by_role("slider").first

    def turn() -> None:
        for share, shown in ((0.02, r"percent [0-4]\b"), (0.98, r"percent (9[6-9]|100)\b")):
            box = slider.bounding_box()
            assert box is not None
            robot.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
            expect(knob).to_contain_text(re.compile(shown))

    again_until(turn, lambda patience_ms: ticked(learn, 4, patience_ms))
    button(robot, "Close").click()
    answer("it stands still")
    ticked(learn, 5)
    button(robot, "Unplug knob").click()
    ticked(learn, 6)
    answer("it went to its safe value, 0 %")
    ticked(learn, 7)
    button(robot, "Plug knob in").click()
    ticked(learn, 8)
    expect(robot.get_by_role("complementary", name="Lesson")).to_contain_text("8/8 · All done!")
    robot.get_by_role("complementary", name="Lesson").get_by_role("link", name="Certificate").click()
    expect(robot.get_by_text("has done the lesson")).to_be_visible()
    on_paper(learn)
    learn.get_by_role("row", name="The first part").get_by_role("link", name="Certificate").click()
    expect(learn.get_by_text("The first part")).to_be_visible()
    sheet = learn.pdf(prefer_css_page_size=True)
    assert sheet.count(b"/Type /Page\n") == 1, "a certificate is one sheet"
    assert hurdles(learn, dark=True) == []


def on_paper(learn: Page) -> None:
    """A lesson is printed without what only a screen has, and without the list of the others."""
    learn.emulate_media(media="print")
    expect(learn.get_by_text("5. Plug it in again")).to_be_visible()
    for name in ("Lessons", "For the teacher", "Answers"):
        expect(learn.get_by_role("heading", name=name, exact=True)).to_be_hidden()
    for name in ("Hand in", "End the lesson", "Easy to read"):
        expect(learn.get_by_role("button", name=name)).to_be_hidden()
    expect(learn.locator(".ms-nav, .ms-header").first).to_be_hidden()
    learn.emulate_media(media="screen")


def test_a_step_is_beside_the_robot_points_and_covers_nothing(learn: Page, robot: Page) -> None:
    page = robot
    learn.get_by_role("button", name="Begin: The first part").click()
    lesson = page.get_by_role("complementary", name="Lesson")
    expect(lesson).to_contain_text("1/8")
    lesson.get_by_label("Answer").first.fill("ten slots")
    lesson.get_by_role("button", name="Answer").click()
    expect(lesson).to_contain_text("2/8 · ✓ This step is done: press Next sheet.")
    lesson.get_by_role("button", name="Next sheet").click()
    expect(lesson.get_by_role("heading", name="2. Plug it in")).to_be_visible()
    for width, height in ((1280, 900), (820, 1180), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        expect(page.locator(".plug.ms-pointed")).to_have_text(re.compile("Plug in$"))
        fold = lesson.get_by_role("button", name="Unfold the lesson")
        if width < 600:  # a strip, which says what comes next
            expect(fold).to_have_attribute("aria-expanded", "false")
            expect(lesson).to_contain_text("2/8 · The knob is active")
            expect(lesson.get_by_role("heading", name="2. Plug it in")).to_be_hidden()
        page.wait_for_function(
            """() => { const box = document.querySelector(".plug.ms-pointed").getBoundingClientRect();
            const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
            return top && top.closest(".plug.ms-pointed"); }"""
        )
        page.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert hurdles(page, dark=width == 820) == []
    button(page, "Plug knob in").click()
    expect(lesson).to_contain_text("3/8")
    page.locator("[data-slot=knob]").click()
    for width, height in ((820, 1180), (1280, 900)):  # the fan is seen while the knob is turned
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(
            """() => { const drawer = document.querySelector(".ms-drawer")?.getBoundingClientRect();
            const fan = document.querySelector("[data-slot=fan]").getBoundingClientRect();
            return drawer && fan.right <= drawer.left; }"""
        )


def test_code_of_a_lesson_is_copied_and_opened_as_a_program(learn: Page, demo: Site) -> None:
    page = learn
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=demo.base)
    page.get_by_role("button", name="Begin: A message of your own").click()
    code = page.locator(".ms-code").filter(has=page.get_by_role("button", name="Open in Program")).first
    text = code.locator("code").inner_text()
    assert "part.run()" in text
    code.get_by_role("button", name="Copy").click()
    page.wait_for_function("text => navigator.clipboard.readText().then((one) => one === text)", arg=text)
    code.get_by_role("button", name="Open in Program").click()
    page.wait_for_url("**/program?name=own_message1.py")
    expect(page.get_by_role("combobox", name="Program", exact=True)).to_have_value("own_message1.py")
    expect(page.locator(".cm-content")).to_contain_text("part.run()")
    shown = [one for one in page.locator(".cm-line").all_inner_texts() if one.strip()]
    assert shown == [one for one in text.splitlines() if one.strip()]

    # The program has the room; the lesson is a strip below it, and blocks reach down to it.
    lesson = page.get_by_role("complementary", name="Lesson")
    fold = lesson.get_by_role("button", name="Unfold the lesson")
    expect(fold).to_have_attribute("aria-expanded", "false")
    expect(lesson).to_contain_text("0/5")
    room = page.locator(".cm-editor").bounding_box()
    fold.click()
    expect(lesson.get_by_role("button", name="Next sheet")).to_be_visible()
    smaller = page.locator(".cm-editor").bounding_box()
    assert room is not None
    assert smaller is not None
    assert room["width"] - smaller["width"] > 100
    go(page, f"{demo.base}/program")
    expect(fold).to_have_attribute("aria-expanded", "true")  # as the person had it last
    go(page, demo.base)
    expect(lesson.get_by_role("button", name="Next sheet")).to_be_visible()


@pytest.mark.timeout(300)  # some thousand key presses, each a way to the browser and back
def test_a_lesson_by_keyboard_only(learn: Page, robot: Page) -> None:
    # Tab comes to it; the key then goes to it, also when the page has been drawn anew in between.
    def press(target: Locator) -> None:
        tab_to(target.page, target)
        target.press("Enter")

    def answer(words: str) -> None:
        field = learn.get_by_role("textbox", name="Answer").first
        tab_to(learn, field)
        field.press_sequentially(words)
        field.press("Enter")

    def turn(*ways: tuple[str, str, str]) -> None:
        press(button(robot, "Open slot knob"))
        slider = robot.get_by_role("slider").first
        tab_to(robot, slider)
        fan = button(robot, "Open slot fan")
        for key, end, shown in ways:
            slider.press(key)
            expect(slider).to_have_value(end)
            expect(fan).to_contain_text(re.compile(shown))
        robot.keyboard.press("Escape")
        expect(robot.locator(".ms-drawer")).to_be_hidden()

    up, down = ("End", "100", r"percent (9[5-9]|100)"), ("Home", "0", r"percent [0-4]\b")
    press(button(learn, "Begin: A part dies"))
    ticked(learn, 0)
    turn(up)
    ticked(learn, 1)

    def stop() -> None:
        learn.keyboard.press("Escape")
        learn.keyboard.press("Escape")

    again_until(stop, lambda ms: ticked(learn, 2, ms))
    tab_to(learn, learn.get_by_role("combobox", name="Answer").first)
    learn.keyboard.press("Enter")
    expect(learn.get_by_role("option", name="it stands still")).to_be_visible()
    for key in ("ArrowDown", "ArrowDown", "Enter"):
        learn.keyboard.press(key)
    press(button(learn, "Answer"))
    ticked(learn, 3)
    press(button(learn, "Go on"))
    ticked(learn, 4)
    press(button(robot, "Unplug knob"))
    ticked(learn, 5)
    answer("6")
    ticked(learn, 6)
    press(button(robot, "Open slot knob"))
    expect(robot.locator(".ms-drawer .why").first).to_contain_text("late")
    robot.keyboard.press("Escape")
    answer("late")
    ticked(learn, 7)
    press(button(robot, "Plug knob in"))
    expect(button(robot, "Open slot knob")).to_contain_text("active")
    turn(up, down)
    ticked(learn, 8)
    press(learn.get_by_role("row", name="A part dies").get_by_role("link", name="Certificate"))
    expect(learn.get_by_text("A part dies")).to_be_visible()


def test_a_lesson_easy_to_read(learn: Page, demo: Site) -> None:
    page = learn
    page.get_by_role("button", name="Easy to read").click()
    page.get_by_role("button", name="Ordinary text").wait_for()
    page.wait_for_function("window.did_handshake && window.socket.connected")
    page.get_by_role("button", name="Begin: The first part").click()
    ticked(page, 1)
    assert page.get_by_role("heading", level=2, name="2. Plug it in").is_hidden()
    for sheet in (2, 3, 1):
        page.get_by_role("button", name="Back" if sheet == 1 else "Next sheet").click()
        if sheet == 1:
            page.get_by_role("button", name="Back").click()
            expect(page.get_by_role("navigation", name="Sheets")).not_to_contain_text("Step")  # the aim is none
        else:
            expect(page.get_by_text(f"Step {sheet - 1} of 5")).to_be_visible()
    page.get_by_role("button", name="Next sheet").click()
    expect(page.get_by_text("Count the cards. How many are there?")).to_be_visible()
    page.get_by_label("Answer").first.fill("10")
    page.get_by_role("button", name="Answer").first.click()
    ticked(page, 2)
    menus = page.get_by_role("navigation").first
    assert menus.get_by_role("link", name="Journal").is_hidden()
    menus.get_by_text("More").click()
    expect(menus.get_by_role("link", name="Journal")).to_be_visible()
    for path in ("/learn", "/"):  # with a card whose part is gone
        go(page, demo.base + path)
        for width in (1280, 390):
            page.set_viewport_size({"width": width, "height": 844})
            page.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert hurdles_by_day_and_night(page) == []


@pytest.mark.parametrize("path", ["/learn", "/", "/?slot=button", "/arrivals", "/bus", "/wires", "/program"])
def test_the_keyboard_comes_to_everything_that_a_mouse_does(blank: Page, demo: Site, path: str) -> None:
    go(blank, demo.base + path)
    if "slot" in path:
        blank.locator(".ms-drawer").wait_for()
    assert out_of_reach(blank) == []


def test_what_is_held_with_the_mouse_can_be_held_by_a_key(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?slot=button")
    tab_to(page, page.locator(".ms-drawer .panel button").filter(has_text="press").first)
    page.keyboard.down(" ")
    card = page.get_by_role("button", name="Open slot button")
    expect(card).to_contain_text("on on")
    page.keyboard.up(" ")
    expect(card).to_contain_text("on off")
