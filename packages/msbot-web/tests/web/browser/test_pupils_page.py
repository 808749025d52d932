"""A class in real browsers: a pupil comes in, is frozen, taken over and handed back; the wall has no names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.processes import run, running
from tests.web.browser.accessible import hurdles, hurdles_by_day_and_night
from tests.web.browser.conftest import CLICK, Site, again_until, call, click_by_script, go, new_page, told
from tests.web.browser.test_demo_pages import FITS

PROGRAM = """from msbot import Distance, Level, Part
part = Part("PILOT")
@part.on("distance", Distance)
def look(distance):
    part.publish("left", Level(percent=40))
part.run()
"""
TEXT = "getElement(document.querySelector('.ms-prog-editor').id.slice(1)).editor.state.doc.toString()"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A robot for two groups."""
    folder: Path = tmp_path_factory.mktemp("class")
    assert run("pupils", "robot", "class.toml", "--groups", "Red,Blue", cwd=folder).returncode == 0
    with running("master", "class.toml", "--port", "0", "--link", "udp:127.0.0.1:0", cwd=folder) as process:
        yield Site(process)


@pytest.fixture(scope="module")
def teacher(browser: Browser, site: Site) -> Page:
    """Who has set it up, and made the groups; their page Pupils."""
    page = new_page(browser)
    page.goto(site.link)
    page.fill("[name=name]", "Novak")
    for field in ("password", "again"):
        page.fill(f"[name={field}]", "long enough")
    page.click("button[type=submit]")
    page.wait_for_url(f"{site.base}/")
    go(page, f"{site.base}/pupils")
    page.get_by_role("button", name="Make the groups by the slots' names").click()
    expect(page.get_by_text("slots: program_Blue")).to_be_visible()
    page.get_by_role("button", name="Simulate all empty slots").click()
    told(page, "8 slots are simulated")
    return page


@pytest.fixture(scope="module")
def pupil(browser: Browser, site: Site, teacher: Page) -> Page:
    """Ada, on a list that was pasted, who has signed in by what is on her ticket; her page Program, on a phone."""
    teacher.get_by_role("textbox", name="Names").fill("Ada; Red\nBen; Blue")
    teacher.get_by_role("button", name="Let them in").click()
    ticket = teacher.locator(".ticket", has_text="Ada")
    expect(ticket.locator("svg")).to_be_visible()
    password = ticket.locator("b.mono").inner_text()
    teacher.get_by_role("button", name="Close").click()
    page = new_page(browser, width=390, height=844)
    page.goto(f"{site.base}/login?next=/program")
    page.fill("[name=name]", "Ada")
    page.fill("[name=password]", password)
    page.click("button[type=submit]")
    page.locator(".cm-line", has_text="import").first.wait_for()
    return page


def can_write(page: Page, *, yes: bool = True) -> None:
    """Whether somebody can type into the program."""
    expect(page.locator(".cm-content")).to_have_attribute("contenteditable", "true" if yes else "false")


def readable(page: Page, *, phone: bool = False) -> None:
    """Everybody can use a page, light and dark, and no part of it stands out; as wide as a phone, too, if so wanted."""
    page.mouse.move(0, 0)  # a button under it has another background
    assert hurdles_by_day_and_night(page) == []
    if phone:
        page.set_viewport_size({"width": 390, "height": 844})
        page.wait_for_function(FITS)
        assert hurdles(page, dark=False) == []
        page.set_viewport_size({"width": 1280, "height": 900})
    page.wait_for_function(FITS)


def test_a_program_runs_is_frozen_taken_over_and_handed_back(site: Site, teacher: Page, pupil: Page) -> None:
    pupil.locator(".cm-content").click()
    pupil.keyboard.press("Control+a")
    pupil.keyboard.insert_text(PROGRAM)
    pupil.get_by_role("button", name="Run", exact=True).click()
    reason, left = pupil.locator("#ms-prog-reason"), pupil.locator("#ms-prog-ports tr", has_text="left →")
    expect(reason).to_contain_text("program_Red")
    expect(left).to_contain_text("40")

    pupil.get_by_role("button", name="Put your hand up").click()
    expect(teacher.locator(".ms-pupil").first).to_contain_text("Ada")
    expect(teacher.locator(".ms-pupil .ms-hand-up")).to_be_visible()
    expect(teacher.locator(".ms-pupil").first).to_contain_text("program in program_Red")
    teacher.get_by_label("Why, for the pupils' pages").fill("look at me")
    teacher.get_by_role("button", name="Freeze all").click()
    strip, is_held, goes_on = pupil.locator(".ms-class-strip"), re.compile(r"\([1-9]"), re.compile(r"\(0\.")
    expect(strip).to_contain_text("frozen by Novak: look at me")
    expect(reason).to_contain_text("look at me")
    expect(left.locator(".ms-last")).to_contain_text(is_held)  # seconds since it published
    readable(teacher, phone=True)
    teacher.get_by_role("button", name="Let the class go on").first.click()
    expect(strip).to_have_count(0)
    expect(left.locator(".ms-last")).to_contain_text(goes_on)

    go(teacher, f"{site.base}/pupil?name=Ada")
    expect(teacher.locator(".cm-content")).to_contain_text("percent=40")
    teacher.get_by_role("button", name="Take over").click()
    expect(strip).to_contain_text("Novak has taken over")
    for name in ("Run", "Save", "More"):
        expect(pupil.get_by_role("button", name=name, exact=True)).to_be_disabled()
    can_write(teacher)
    readable(teacher)
    teacher.locator(".cm-content").click()
    teacher.keyboard.press("Control+Home")
    teacher.keyboard.insert_text("# shown by Novak\n")
    expect(pupil.locator(".cm-content")).to_contain_text("shown by Novak")  # as it is written
    can_write(pupil, yes=False)
    teacher.get_by_role("button", name="Run", exact=True).click()
    expect(strip).to_contain_text("runs your program now")
    expect(left.locator(".ms-last")).to_contain_text(goes_on)
    go(teacher, teacher.url)  # loaded again: the program is there, not an empty one that would be kept
    expect(teacher.locator(".cm-content")).to_contain_text("percent=40")
    teacher.get_by_role("button", name="Hand back").click()
    expect(strip).to_have_count(0)
    expect(pupil.get_by_role("button", name="Run", exact=True)).to_be_enabled()
    can_write(pupil)
    assert pupil.evaluate(TEXT) == "# shown by Novak\n" + PROGRAM
    pupil.get_by_role("button", name="Stop", exact=True).click()


def test_what_a_teacher_writes_into_blocks_makes_them_text_and_the_blocks_are_kept(
    site: Site, teacher: Page, pupil: Page
) -> None:
    pupil.get_by_role("button", name="Blocks", exact=True).click()
    pupil.wait_for_function("msbotBlocks.isShown()")
    pupil.wait_for_function(f"{TEXT}.includes('PILOT')")
    made = pupil.evaluate(TEXT)
    go(teacher, f"{site.base}/pupil?name=Ada")
    expect(teacher.locator(".cm-content")).to_contain_text("PILOT")
    teacher.get_by_role("button", name="Take over").click()
    box = pupil.locator(".ms-blocks-box")
    expect(box).to_have_attribute("inert", "")
    teacher.get_by_role("button", name="Hand back").click()  # nothing written: they are blocks as before
    expect(box).not_to_have_attribute("inert", "")
    assert pupil.evaluate("msbotBlocks.isShown()")
    can_write(pupil, yes=False)

    teacher.get_by_role("button", name="Take over").click()
    can_write(teacher)
    teacher.locator(".cm-content").click()
    teacher.keyboard.press("Control+End")
    teacher.keyboard.insert_text("# by Novak")
    expect(pupil.locator(".cm-content")).to_contain_text("by Novak")
    pupil.wait_for_function("!msbotBlocks.isShown()")  # a moment after the text has come
    can_write(pupil, yes=False)
    teacher.get_by_role("button", name="Hand back").click()  # without a run: it stays all the same
    can_write(pupil)
    go(pupil, pupil.url)  # as it was kept
    expect(pupil.locator(".cm-content")).to_contain_text("by Novak")
    assert pupil.evaluate(TEXT) == made + "# by Novak"
    pupil.get_by_role("button", name="Blocks", exact=True).click()
    pupil.get_by_role("button", name="Back to the blocks").click()
    pupil.wait_for_function("msbotBlocks.isShown()")
    pupil.wait_for_function(f"(text) => {TEXT} === text", arg=made)


def test_the_wall_has_no_names_and_only_teachers_have_a_wall(site: Site, teacher: Page, pupil: Page) -> None:
    wall = teacher.context.new_page()
    go(wall, f"{site.base}/projector")
    red = wall.locator(".wall-groups li", has_text="Red")
    expect(red).to_contain_text("parts 4/5")
    expect(red.locator(".wall-hand")).to_have_count(0)  # a hand is down when its program is taken over
    assert "Ada" not in wall.inner_text("body")
    readable(wall, phone=True)
    wall.get_by_role("switch", name="With names").click()
    expect(red).to_contain_text("Ada")
    wall.close()
    for path in ("/pupils", "/projector", "/pupil?name=Ben"):
        go(pupil, site.base + path)
        expect(pupil.get_by_text("Only a teacher sees this page.")).to_be_visible()
        assert "Ben" not in pupil.content()


ON_PAPER = """(selector) => [...document.querySelectorAll(selector)].map((one) => {
    const {left, top, right, bottom} = one.getBoundingClientRect(), root = document.documentElement;
    const fits = right <= root.clientWidth && bottom + scrollY <= root.scrollHeight;
    return left >= 0 && right > left && bottom > top && fits;
})"""
"""Of each such element: whether it has its place on what is printed, and all of it."""


def test_what_is_printed_are_all_tickets_and_nothing_else(site: Site, teacher: Page, pupil: Page) -> None:
    go(teacher, f"{site.base}/pupils")
    teacher.set_viewport_size({"width": 700, "height": 160})  # less than the tickets take: paper is not scrolled
    teacher.get_by_role("button", name="Tickets for all").click()
    expect(teacher.locator(".ticket svg")).to_have_count(2)
    teacher.emulate_media(media="print", color_scheme="dark")
    teacher.wait_for_function(f"({ON_PAPER})('.ticket').join() === 'true,true'")  # the dialog has come to its size
    expect(teacher.get_by_text("New pupils")).to_be_hidden()
    for selector in ("#ms-stop", ".ms-nav", ".tickets .q-btn"):
        expect(teacher.locator(selector).first).to_be_hidden()
    click_by_script(teacher.get_by_role("button", name="Close", include_hidden=True).last)
    expect(teacher.locator(".ticket")).to_have_count(0)
    expect(teacher.get_by_text("New pupils")).to_be_visible()  # a page without a dialog is printed itself
    ink, paper = teacher.evaluate("[getComputedStyle(document.body).color, getComputedStyle(document.body).background]")
    assert (ink, paper.split(")")[0]) == ("rgb(16, 32, 44)", "rgb(255, 255, 255")
    teacher.emulate_media(media="screen", color_scheme="light")
    teacher.set_viewport_size({"width": 1280, "height": 900})


def test_a_form_stays_while_its_list_changes_and_two_clicks_let_a_class_in_once(
    site: Site, teacher: Page, pupil: Page
) -> None:
    go(teacher, f"{site.base}/pupils")
    teacher.locator(".line", has_text="slots: program_Blue").get_by_role("button", name="Edit").click()
    slots = teacher.locator(".q-dialog").get_by_role("combobox", name="Slots")
    expect(slots).to_be_visible()
    assert call(teacher, "PUT", "/api/class/groups/Green", {"pupils": ["Ben"], "slots": []}) == 200
    expect(teacher.locator(".line", has_text="Ben; slots: none")).to_be_visible()  # drawn anew
    expect(slots).to_be_visible()
    slots.press_sequentially("_red")  # among those of all groups
    found = teacher.get_by_role("option")
    expect(found).to_have_text(["program_Red", "eyes_Red", "bumper_Red", "wheels_Red", "lamp_Red"])
    found.filter(has_text="lamp").click()
    expect(slots).to_have_value("")  # ready for the next
    expect(teacher.locator(".q-dialog .q-chip")).to_contain_text(["Ben"] + ["_Blue"] * 5 + ["lamp_Red"])
    slots.press("Escape")
    teacher.get_by_role("button", name="Cancel").click()

    teacher.get_by_role("textbox", name="Names").fill("Kim; green\nLou; blue")
    let_in = teacher.get_by_role("button", name="Let them in").element_handle()
    teacher.wait_for_function(f"(button) => ({CLICK})(button) && (button.click(), true)", arg=let_in)
    expect(teacher.locator(".ticket")).to_have_count(2)
    expect(teacher.locator(".ticket", has_text="Lou")).to_contain_text("Lou · Blue")
    told(teacher, "No slots belong to Green")
    assert not teacher.evaluate("told.some((one) => one.includes('there is a user'))")
    teacher.get_by_role("button", name="Close").first.click()


def test_a_class_comes_in_by_code_name_and_pictures(browser: Browser, site: Site, teacher: Page) -> None:
    go(teacher, f"{site.base}/pupils")
    ticket = teacher.locator(".q-dialog .mono").first
    again_until(
        teacher.get_by_role("button", name="Show a class ticket").click,
        lambda ms: expect(ticket).to_be_visible(timeout=ms),
    )
    code = ticket.inner_text()
    newcomer = new_page(browser, width=320, height=700)
    newcomer.goto(f"{site.base}/login")
    newcomer.get_by_role("link", name="Sign in with a class code").click()
    newcomer.get_by_label("Code of the class").fill(code.lower())
    newcomer.keyboard.press("Enter")
    expect(newcomer.get_by_label("Your name")).to_be_visible()
    readable(newcomer)
    newcomer.get_by_label("Your name").fill("Novak")
    newcomer.get_by_role("button", name="Ask to come in").click()
    expect(newcomer.locator(".error")).to_contain_text("already")
    newcomer.get_by_label("Your name").fill("Dora")
    newcomer.get_by_role("button", name="Ask to come in").click()
    expect(newcomer.get_by_role("status")).to_contain_text("Dora, wait a moment")
    expect(teacher.locator(".q-dialog")).to_contain_text("Want to come in, see below: Dora")
    teacher.get_by_role("button", name="Close").first.click()
    teacher.get_by_role("button", name="Let Dora in").click()
    expect(newcomer.get_by_text("You are in, Dora")).to_be_visible(timeout=20_000)  # it asks every few seconds
    pictures = [one.inner_text().split()[-1] for one in newcomer.locator(".own li").all()]
    assert len(pictures) == 3
    readable(newcomer)
    newcomer.get_by_role("button", name="Come in").click()
    newcomer.wait_for_url("**/program*")
    newcomer.context.close()

    again = new_page(browser, width=390, height=844)  # the next lesson, another tablet
    again.goto(f"{site.base}/come")
    again.get_by_label("Code of the class").fill(code)
    again.get_by_role("button", name="Next").click()
    again.get_by_role("button", name="Dora", exact=True).click()
    readable(again)
    for number, picture in enumerate(pictures, 1):
        again.get_by_role("group", name=f"Picture {number}").get_by_label(picture).check()
    again.get_by_role("button", name="Come in").click()
    again.wait_for_url("**/program*")
    again.context.close()
