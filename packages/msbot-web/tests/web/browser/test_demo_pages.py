"""What a student sees and does on the demo's pages, in a real browser."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import cast

from playwright.sync_api import Browser, Page, Route, expect

from msbot_school.quiz import questions
from msbot_web.language import languages
from msbot_web.models.robot_models import PartLine, PortLine, Robot, Scalar, SlotCard
from msbot_web.pages.live_cards import card_piece, looks_of
from msbot_web.robot_view import RobotView
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import Site, again_until, call, click_by_script, go, new_page, told, undo_newest

PAGES = {
    "/": "Robot", "/arrivals": "Arrivals", "/settings": "Settings", "/bus": "Bus", "/wires": "Wires",
    "/arena": "Arena", "/gallery": "Robots and worlds", "/plots": "Plots", "/timeline": "Timeline", "/learn": "Learn",
    "/learn/quiz?seed=7": "Quiz", "/library": "Library",
    "/library/SG90": "Library", "/pupils": "Pupils", "/projector": "Our class",
    "/journal": "Journal", "/faults": "Faults", "/missions": "Missions",
    "/class": "Class", "/admin": "Admin", "/doctor": "Doctor",
    "/api-docs": "API",
}  # fmt: skip
"""Every page and its heading. `test_german` looks at them all, `test_hostile_names` at all in English."""


DRAWN_ANEW = """new Promise((done) => new MutationObserver((_, itself) => { itself.disconnect(); done(); })
  .observe(document.querySelector(".place"), { childList: true, subtree: true }))"""
"""The first card is drawn anew, as with every beat."""
FITS = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"


IN_PIECES = """([whole, pieces, after]) => {
  document.body.insertAdjacentHTML("beforeend", "<div id=cards><div data-slot=fan></div></div>");
  const root = document.getElementById("cards"), seen = (cards) => (msbotCards("cards", cards), root.innerHTML);
  const results = [seen(whole), seen(pieces), seen(after)];
  root.remove();
  return results;
}"""
"""What a card is after it has come whole, after pieces of it have come, and when what they lead to comes whole."""


class Reader:
    """Who reads cards."""

    language = languages()["de"]

    def __init__(self, curve: list[float]) -> None:
        self._curve = curve
        self.sight = cast("RobotView", self)

    def translate(self, text: str, **values: object) -> str:
        return self.language.translate(text, **values)

    def sparkline(self, _topic: str) -> list[float]:
        return self._curve


def test_a_card_that_comes_in_pieces_is_as_one_that_comes_whole(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/settings")

    def robot(beats: int, next_beat_s: float | None, type_name: str, fields: dict[str, Scalar]) -> Robot:
        line = PartLine.model_construct(
            part="fan", state="active", life=min(beats, 3), beats=beats, beat_age_s=0.5, nature="", part_number="FAN-5V"
        )
        port = PortLine(
            port="power", topic="<t>", type_name=type_name, publishes=True, reliable=True, fields=fields, rate_hz=1.0
        )
        card = SlotCard.model_construct(
            name="fan",
            part_number="FAN-5V",
            type_name="Fan",
            category="sensor",
            description="",
            state="active",
            reason="",
            part=line,
            ports=[port],
            next_beat_s=next_beat_s,
            spares=[],
            simulated=True,
            plugged=True,
            faults=[],
            type_differences=[],
            wear=None,
        )
        return Robot.model_construct(beat_s=1.0, slots=[card])

    values: list[tuple[str, dict[str, Scalar], dict[str, Scalar]]] = [
        ("Level", {"percent": 1.5}, {"percent": 90.25}),
        ("Switch", {"on": False}, {"on": True}),
        ("Text", {"text": "<b>one</b>"}, {"text": "two & three", "more": 1}),
        ("Scan", {}, {"ranges": "[1, 2, 3]", "angle": 1.0}),
    ]
    for type_name, first, then in values:
        before, after = robot(3, 0.75, type_name, first), robot(4, 0.25, type_name, then)
        old, new = looks_of(before), looks_of(after)
        changed = {name for name in new if new[name] != old.get(name)}
        assert changed == {"now:fan", "ring:fan"}
        readers = Reader([]), Reader([1.0, 2.0, 5.0])
        whole, last = (
            {"fan": card_piece(reader, "fan", one.slots[0], one)}
            for reader, one in zip(readers, (before, after), strict=True)
        )
        pieces = {name: card_piece(readers[1], name, after.slots[0], after) for name in changed}
        shown = page.evaluate(IN_PIECES, [whole, pieces, last])
        assert shown[1] == shown[2]
        assert shown[0] != shown[1]
    before, after = robot(3, 0.75, "Level", {}), robot(0, None, "Level", {})
    shown = page.evaluate(
        IN_PIECES,
        [
            {"fan": card_piece(Reader([]), "fan", before.slots[0], before)},
            {"ring:fan": card_piece(Reader([]), "ring:fan", after.slots[0], after)},
            {"fan": card_piece(Reader([]), "fan", after.slots[0], after)},
        ],
    )
    assert shown[1] == shown[2]


def test_why_follows_in_an_open_drawer(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?slot=bumper")
    why = page.locator(".ms-drawer .why")
    expect(why).to_contain_text("is active")
    page.get_by_role("button", name="Release slot").click()
    expect(why).to_contain_text("took it out of slot bumper")
    undo_newest(page)
    expect(page.get_by_role("button", name="Open slot bumper")).to_contain_text("active")


def test_an_open_drawer_follows_who_is_in_the_slot(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?slot=knob")
    drawer = page.get_by_role("dialog")
    expect(drawer).to_contain_text(re.compile(r"standby\s*DD"))
    drawer.get_by_role("button", name="Swap to DD").click()
    drawer.get_by_role("button", name="Swap to knob").click()  # the buttons are those of the part that stands by now
    expect(drawer.get_by_role("button", name="Swap to DD")).to_be_visible()


def test_what_is_marked_in_why_stays_marked_while_it_follows(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?slot=ear")
    why = page.locator(".why")
    expect(why).to_contain_text("claim: part number")
    # Found and marked in one step: the lines are other ones after each refresh.
    why.evaluate(
        """(why) => {
            const texts = document.createTreeWalker(why, NodeFilter.SHOW_TEXT);
            while (!texts.nextNode().textContent.includes("claim: part number"));
            getSelection().selectAllChildren(texts.currentNode.parentElement);
        }"""
    )
    marked, before = page.evaluate("getSelection().toString()"), why.inner_text()
    plug = page.get_by_role("switch", name="Plugged in")
    click_by_script(plug)  # a pointer that is pressed elsewhere would let go of the mark
    expect(page.get_by_role("dialog").get_by_text(re.compile(r"^(late|lost)$"))).to_be_visible()
    assert marked
    assert page.evaluate("getSelection().toString()") == marked
    assert why.inner_text() == before
    page.evaluate("getSelection().removeAllRanges()")
    expect(why).to_contain_text("active -> late")
    plug.click()
    expect(page.get_by_role("dialog").get_by_text("active", exact=True)).to_be_visible()


def test_turning_the_knob_drives_the_fan(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?slot=knob")
    slider = page.get_by_role("slider").first

    def turn() -> None:
        slider.press("Home")
        slider.press("End")
        slider.press("PageDown")  # a tenth of the way

    drawer = page.get_by_role("dialog")
    again_until(turn, lambda ms: expect(drawer).to_contain_text(re.compile(r"percent\s+(89|90)"), timeout=ms))
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    fan = page.get_by_role("button", name="Open slot fan")
    expect(fan).to_contain_text(re.compile(r"percent\s+(89|90)"))


def test_a_changed_setting_is_obeyed_journalled_and_undone(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?slot=knob")
    field = page.get_by_label("period_s [s]")
    # In the drawer: a slot of this robot is called `hand`, too.
    by_hand = page.get_by_role("dialog").get_by_text("hand", exact=True)

    def change() -> None:
        field.fill("0.2")
        field.blur()

    again_until(change, lambda ms: expect(by_hand).to_be_visible(timeout=ms))
    go(page, f"{demo.base}/journal")
    page.get_by_role("tab", name="Changes by people").click()
    line = page.get_by_text(re.compile("period_s of knob: 0.5 s -> 0.2 s"))
    expect(line).to_be_visible()
    page.get_by_role("button", name="Undo").first.click()
    expect(page.get_by_text("undone", exact=True).first).to_be_visible()
    go(page, f"{demo.base}/?slot=knob")
    expect(page.get_by_label("period_s [s]")).to_have_value("0.5")


def test_a_first_visit_is_offered_a_tour_that_leads_through_the_page(page: Page, demo: Site) -> None:
    page.get_by_role("button", name="Take the tour").click()
    for step in range(1, 7):
        expect(page.get_by_text(f"{step} / 6")).to_be_visible()
        if step in (2, 3):
            page.evaluate(DRAWN_ANEW)
        expect(page.locator(".ms-framed")).to_be_in_viewport()
        assert step > 1 or page.evaluate("scrollY") == 0, "from the top"
        page.get_by_role("button", name="Next" if step < 6 else "Done").click()
    expect(page.locator(".ms-framed")).to_have_count(0)
    page.reload()
    page.get_by_role("button", name="Help for this page").click()
    expect(page.get_by_text("Every card is a slot: a role in the robot")).to_be_visible()
    expect(page.get_by_text("Your first visit?")).to_have_count(0)
    page.get_by_role("link", name="More in the handbook").click()
    expect(page.get_by_role("heading", name="Use the page", level=1)).to_be_visible()
    picture = page.get_by_role("img").first
    assert picture.evaluate("img => img.decode().then(() => img.naturalWidth)") > 300


def test_escape_twice_is_stop_and_a_teacher_lets_it_go_on(page: Page) -> None:
    expect(page.get_by_role("button", name="Open slot fan")).to_contain_text("active")
    banner = page.get_by_role("alert").filter(has_text="STOP by")

    def press_twice() -> None:
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")

    again_until(press_twice, lambda ms: expect(banner).to_be_visible(timeout=ms))
    # All presses are answered: one that is heard after GO would be a STOP.
    expect(page.locator("#ms-stop-says")).not_to_have_class(re.compile("warn|bad"))
    page.get_by_role("link", name="Robot", exact=True).click(trial=True)  # what STOP says covers no entry of the menu
    page.get_by_role("button", name="Go on").click()
    expect(banner).to_have_count(0)
    # The page is busy with something else between the two.
    page.evaluate(
        """() => {
            const [first, second] = [1, 2].map(() => new KeyboardEvent("keydown", { key: "Escape" }));
            dispatchEvent(first);
            setTimeout(() => dispatchEvent(second), 1500);
        }"""
    )
    expect(banner).to_be_visible()
    page.get_by_role("button", name="Go on").click()
    expect(banner).to_have_count(0)


def test_a_stop_whose_answers_are_lost_is_said_again_and_is_over_with_go(page: Page) -> None:
    banner = page.get_by_role("alert").filter(has_text="STOP by")
    heard: list[str | None] = []

    def lose(route: Route) -> None:
        route.fetch()
        heard.append(route.request.header_value("x-stop-press"))
        route.abort()

    page.route("**/api/stop", lose)
    page.locator("#ms-stop").click()
    expect(banner).to_be_visible()
    page.get_by_role("button", name="Go on").click()
    expect(banner).to_have_count(0)
    before = len(heard)
    while len(heard) < before + 2:
        with page.expect_event("requestfailed", lambda request: request.url.endswith("/api/stop")):
            pass
    assert len(set(heard)) == 1
    page.unroute("**/api/stop")
    expect(page.locator("#ms-stop-says")).to_contain_text("somebody has ended it since: the robot may move")
    assert call(page, "POST", "/api/go", {}) == 400, "no STOP holds"
    expect(banner).to_have_count(0)


def test_the_bus_is_paused_and_a_frame_taken_apart(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/bus")
    rows = page.locator("tr[data-number]")
    expect(rows.nth(10)).to_be_visible()
    expect(rows.filter(has_text=re.compile(r"knob says level \d")).first).to_be_visible()
    page.get_by_role("switch", name="Pause").click()
    expect(rows.first).to_have_attribute("tabindex", "0")  # it stands still
    first = rows.first.get_attribute("data-number")
    page.get_by_label("Filter").fill("BEACON:")
    expect(rows.first).to_contain_text("the master says that it is there")  # found by its word in the protocol, too
    page.get_by_label("Filter").fill("")
    expect(rows.first).to_have_attribute("data-number", str(first))
    rows.first.click()
    expect(page.get_by_role("heading", name=f"Frame {first}", exact=True)).to_be_visible()
    expect(page.get_by_role("heading", name=f"Frame {first} on the wire")).to_be_visible()
    levels = page.get_by_role("img", name="CAN-H and CAN-L, bit by bit")
    page.wait_for_function("(image) => image.naturalHeight > 300", arg=levels.element_handle())


def test_two_browsers_see_the_same_change_and_one_chooses_a_language(browser: Browser, demo: Site, page: Page) -> None:
    other = new_page(browser)
    other.goto(demo.link)
    page.get_by_role("button", name="Unplug horn").click()
    entry = page.get_by_role("navigation").get_by_role("link", name="Robot", exact=False).first
    expect(entry.locator(".count")).to_be_hidden()
    for visitor in (page, other):
        expect(visitor.get_by_role("button", name="Open slot horn")).to_contain_text("lost")
    expect(entry.locator(".count")).to_have_text("1")
    expect(entry.locator(".count")).to_be_visible()
    other.get_by_role("button", name="Plug horn in").press("Enter")  # what says the loss lies over it for a while
    for visitor in (page, other):
        expect(visitor.get_by_role("button", name="Open slot horn")).to_contain_text("active")
        expect(visitor.get_by_role("button", name="Unplug horn")).to_be_visible()
    expect(entry.locator(".count")).to_be_hidden()
    # Who is there chooses a language, which is kept.
    other.get_by_role("button", name="You").click()
    other.get_by_text("Deutsch").click()
    expect(other.get_by_role("heading", level=1)).to_have_text("Roboter")
    other.get_by_role("button", name="Du").click()
    other.get_by_text("English").click()
    expect(other.get_by_role("heading", level=1)).to_have_text("Robot")
    other.context.close()


def test_the_library_is_searched(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/library")
    page.get_by_label("Search").fill("servo")
    expect(page.get_by_text("3 part types")).to_be_visible()
    page.get_by_role("link", name="SG90: Servo, 180 degrees").click()
    expect(page.get_by_role("heading", name="Pins")).to_be_visible()
    others = page.locator(".panel").filter(has_text="Which others could fill its slot")
    expect(others.get_by_role("row").filter(has_text="MG996R")).to_be_visible()
    go(page, f"{demo.base}/library")
    page.get_by_text("Whose part fits?").click()
    expect(page.get_by_role("row").filter(has_text="Distance")).to_contain_text("HC-SR04")


def test_a_quiz_is_answered_by_keyboard_graded_and_asks_about_frames_of_the_bus(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/learn/quiz?seed=7")
    first, second, third = islice(questions(7), 3)
    answer = page.get_by_label("Your answer")
    expect(page.locator("pre")).to_have_text(first.shown)
    answer.press("Enter")
    told(page, "Write an answer first")
    answer.fill(f" {first.answer} ")
    answer.press("Enter")
    expect(page.get_by_role("status").filter(has_text="Right.")).to_contain_text(first.why)
    expect(page.get_by_text("1 of 1 are right")).to_be_visible()
    onward = page.get_by_role("button", name="Next question")
    expect(onward).to_be_focused()
    onward.press("Enter")
    expect(page.locator("pre")).to_have_text(second.shown)
    expect(answer).to_be_focused()
    page.keyboard.type("nonsense")
    page.keyboard.press("Enter")
    expect(page.get_by_role("status").filter(has_text=f"No: {second.answer}.")).to_contain_text(second.why)
    expect(page.get_by_text("1 of 2 are right")).to_be_visible()
    page.get_by_role("button", name="Next question").press("Enter")
    expect(page.locator("pre")).to_have_text(third.shown)
    page.wait_for_url("**/learn/quiz?seed=7&past=2&asked=2&right=1")
    go(page, page.url)  # as after a connection that was lost for long
    expect(page.locator("pre")).to_have_text(third.shown)
    expect(page.get_by_text("1 of 2 are right")).to_be_visible()
    second = third
    page.get_by_label("Bytes and frames").click()
    page.get_by_role("option", name="from this robot's bus").click()
    expect(page.locator("pre")).not_to_have_text(second.shown)
    shown = page.locator("pre").inner_text()
    assert re.fullmatch(r"[0-9A-F]{3}#[0-9A-F]*|[01]+", shown), shown
    page.get_by_role("button", name="I do not know").click()
    expect(page.get_by_role("status").filter(has_text="How one finds it:")).to_contain_text("What it says")
    expect(page.get_by_text("1 of 3 are right")).to_be_visible()
    expect(onward).to_be_focused()
    assert hurdles(page, dark=True) == []


def test_a_backup_and_a_blueprint_are_handed_in_from_the_page(blank: Page, demo: Site, tmp_path: Path) -> None:
    page = blank
    go(page, f"{demo.base}/admin")
    with page.expect_download() as download:
        page.get_by_role("button", name="Download a backup").click()
    download.value.save_as(tmp_path / "backup.db")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Restore a backup").click()
    chooser.value.set_files(tmp_path / "backup.db")
    page.get_by_role("button", name="Yes").click()
    told(page, "takes effect when the master restarts")
    go(page, f"{demo.base}/settings")
    page.get_by_role("tab", name="Blueprint").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    blueprint = tmp_path / "robot.toml"
    download.value.save_as(blueprint)
    blueprint.write_text(blueprint.read_text().replace('description = "', 'description = "Brand-new: ', 1))
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Import a file").click()
    chooser.value.set_files(blueprint)
    expect(page.get_by_role("listitem").filter(has_text="Brand-new")).to_be_visible()


def test_a_simulated_part_without_a_slot_is_played_with(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/arrivals")
    waiting = page.locator(".slot").filter(has_text="DD")
    plug = page.get_by_role("switch", name="Plugged in")
    expect(waiting).to_contain_text("standby")
    plug.click()
    expect(waiting).to_have_count(0)
    expect(page.get_by_role("slider")).to_have_count(0)
    plug.click()
    expect(waiting).to_contain_text("standby")
    expect(page.get_by_role("slider")).to_have_count(1)
    adopt, item = waiting.get_by_role("button", name="Adopt"), page.get_by_role("menuitem").filter(has_text="No slot")
    adopt.click()
    expect(item).to_have_text("No slot is free: release or swap one.")
    made = item.get_attribute("id")
    page.keyboard.press("Escape")
    expect(item).to_have_count(0)
    adopt.click()
    expect(item).to_be_visible()
    page.wait_for_timeout(500)
    assert item.get_attribute("id") == made, "an item that is made anew loses the click that is on its way"


def test_the_keyboard_skips_the_menu_and_opens_a_slot(blank: Page, demo: Site) -> None:
    page = blank
    go(page, demo.base)
    expect(page.get_by_role("button", name="Open slot knob")).to_be_visible()
    page.keyboard.press("Tab")
    expect(page.get_by_role("link", name="Skip to the content")).to_be_focused()
    page.keyboard.press("Enter")
    knob = page.get_by_role("button", name="Open slot knob")
    while not knob.evaluate("(knob) => document.activeElement === knob"):
        page.keyboard.press("Tab")  # on a first visit a tour is offered before the cards
        # What has the focus may be drawn anew just then: the body has it, and the next Tab goes on from there.
        assert page.evaluate("document.activeElement.closest('nav, header') === null"), "the menu is skipped"
    page.keyboard.press("Space")
    expect(page.get_by_role("heading", name="knob")).to_be_visible()


def test_a_lamp_is_driven_by_hand_and_goes_dark_when_the_page_is_closed(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/?slot=headlight")
    drawer = page.get_by_role("dialog")
    drawer.get_by_role("switch", name="on by hand").click()
    drawer.get_by_role("switch", name="on", exact=True).click()
    expect(drawer).to_contain_text(re.compile(r"How brightly \[%\]\s*100"))
    page.goto("about:blank")
    go(page, f"{demo.base}/?slot=headlight")
    expect(page.get_by_role("dialog")).to_contain_text(re.compile(r"How brightly \[%\]\s*0"))


def test_a_class_list_makes_people_with_tickets_and_a_removal_is_asked_once_more(
    blank: Page, demo: Site, tmp_path: Path
) -> None:
    page = blank
    (tmp_path / "class.csv").write_text("name,role\nmia,student\nben,viewer\n")
    go(page, f"{demo.base}/admin")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Import a class list (CSV)").click()
    chooser.value.set_files(tmp_path / "class.csv")
    expect(page.get_by_text("Let 2 people sign in: mia, ben?")).to_be_visible()
    expect(page.get_by_text("which no other computer can open")).to_be_visible()
    page.get_by_role("button", name="Yes").click()
    expect(page.locator(".ticket")).to_have_count(2)
    expect(page.locator(".ticket").first).to_contain_text("mia")
    page.get_by_role("button", name="Close").last.click()
    expect(page.get_by_text("user ben added as viewer")).to_be_visible()
    page.get_by_label("Name", exact=True).first.fill("eve")
    page.get_by_label("Password", exact=True).first.fill("long enough 1")
    page.get_by_role("button", name="Add").click()
    expect(page.get_by_text("Let eve sign in as student?")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_text("Let eve sign in as student?")).to_have_count(0)
    for name in ("mia", "ben"):
        page.get_by_role("button", name=f"Remove {name}").click()
        page.get_by_role("button", name="Cancel").click()
        page.get_by_role("button", name=f"Remove {name}").click()
        page.get_by_role("button", name="Yes").click()
        expect(page.get_by_role("button", name=f"Remove {name}")).to_have_count(0)


def test_a_teacher_plants_a_fault_and_ends_it(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/faults")
    page.get_by_role("button", name="Plant", exact=True).click()
    expect(page.get_by_text("1. loss at knob: packets are lost (30 %)")).to_be_visible()
    go(page, demo.base)
    card = page.get_by_role("button", name="Open slot knob")
    expect(card).to_contain_text("has planted fault 1 here: loss at knob")
    go(page, f"{demo.base}/faults")
    page.get_by_role("button", name="End all").click()
    expect(page.get_by_text("everything that goes wrong now is real")).to_be_visible()


def make_slot(page: Page, demo: Site, number: str, name: str) -> None:
    go(page, f"{demo.base}/library/{number}")
    page.get_by_role("button", name="New slot for this type").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Name of the slot").fill(name)
    dialog.get_by_role("button", name="Make the slot").click()
    expect(dialog).to_have_count(0)


def test_a_form_wires_parts_to_a_board_and_sees_pins_that_are_taken_or_cannot(blank: Page, demo: Site) -> None:
    page = blank
    make_slot(page, demo, "BOARD-8", "front board")
    go(page, f"{demo.base}/?slot=front%20board")
    lamp = page.get_by_label(re.compile("^part_1"))
    lamp.fill("LED lamp: s=2")
    lamp.press("Enter")
    expect(
        page.get_by_role("dialog").get_by_text("hand", exact=True)
    ).to_be_visible()  # it is stored: the form reads it
    page.get_by_role("button", name="Choose part and pins: part_2").click()
    form = page.get_by_role("dialog").filter(has_text="What is wired to front board: part_2")
    form.get_by_label("Part type").fill("SG90")
    page.get_by_role("option", name=re.compile("^SG90")).click()
    form.get_by_label("Name of its slot").fill("arm")
    pin = form.get_by_label("pin for pwm")
    wire_it = form.get_by_role("button", name="Wire it so")
    pin.fill("2")
    expect(form.get_by_text("pin 2 is taken by part_1; wire one of them elsewhere")).to_be_visible()
    expect(wire_it).to_be_disabled()
    form.get_by_label("Board").click()
    page.get_by_role("option", name="ESP32").click()
    pin.fill("35")
    expect(form.get_by_text("pin 35 of the ESP32 is an input only: no output, no PWM")).to_be_visible()
    expect(wire_it).to_be_disabled()
    pin.fill("13")
    expect(form.locator(".wiring svg").get_by_text("pin 13 (pwm)")).to_be_visible()
    wire_it.click()
    expect(page.get_by_label(re.compile("^part_2"))).to_have_value(re.compile("^SG90 arm: pwm=13"))
    # The drawer under the form is still there; Back closes the form only, and then the drawer.
    page.get_by_role("button", name="Choose part and pins: part_3").click()
    expect(page.get_by_text("What is wired to front board: part_3")).to_be_visible()
    page.wait_for_function("history.state.msbot.open.length === 2")  # a moment after it is seen
    page.go_back()
    expect(page.get_by_text("What is wired to front board: part_3")).to_have_count(0)
    expect(page.get_by_label(re.compile("^part_2"))).to_be_visible()
    page.go_back()
    expect(page.get_by_role("dialog")).to_have_count(0)
    expect(page.get_by_role("button", name="Open slot front board")).to_be_visible()
    undo_newest(page)
    go(page, f"{demo.base}/?slot=front%20board")
    expect(page.get_by_label(re.compile("^part_1"))).to_have_value("LED lamp: s=2")
    expect(page.get_by_label(re.compile("^part_2"))).to_have_value("")


def test_a_slot_is_simulated_by_one_click_and_given_back_by_another(blank: Page, demo: Site) -> None:
    page = blank
    make_slot(page, demo, "BH1750", "dusk")
    go(page, f"{demo.base}/?slot=dusk")
    drawer = page.get_by_role("dialog")
    simulate = drawer.get_by_role("button", name="Simulate this slot")
    button, topics = simulate.bounding_box(), drawer.get_by_role("heading", name="Topics").bounding_box()
    assert button is not None
    assert topics is not None
    assert button["y"] < topics["y"], "what an empty slot needs next comes first"
    simulate.click()
    expect(drawer.get_by_text("active", exact=True)).to_be_visible()
    drawer.get_by_role("button", name="Wiring").click()
    expect(drawer.locator(".wiring svg").get_by_text("SDA, GPIO 2")).to_be_visible()
    drawer.get_by_role("button", name="Give the slot back").click()
    expect(drawer.get_by_role("button", name="Simulate this slot")).to_be_visible()
    expect(drawer.get_by_text("active", exact=True)).to_have_count(0)


def test_a_mission_is_started_answered_and_reported(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/missions")
    toml = (
        '[mission]\ntitle = "Who is deaf?"\nstory = "Find out."\nhints = ["Look around."]\n'
        '[[fault]]\nkind = "slow-consumer"\nat = "fan"\n'
    )
    with page.expect_file_chooser() as chosen:
        page.get_by_role("button", name="Mission from a file").click()
    chosen.value.set_files({"name": "deaf.toml", "mimeType": "application/toml", "buffer": toml.encode()})
    expect(page.get_by_text("Who is deaf?", exact=True)).to_be_visible()
    go(page, f"{demo.base}/faults")
    expect(page.get_by_text("a fault of the mission deaf; which one is to be found")).to_be_visible()
    go(page, f"{demo.base}/missions")
    choose(page, "Fault", 0, "packets are lost")
    choose(page, "Where", 0, "fan")
    page.get_by_role("button", name="That is it").click()
    expect(page.locator(".panel").get_by_text("only the place is right")).to_be_visible()
    choose(page, "Fault", 0, "the part takes what is for it too slowly")
    page.get_by_role("button", name="That is it").click()
    expect(page.get_by_text("Named: 1 of 1 · mended: 0 of 1")).to_be_visible()
    choose(page, "Repair", 0, "switch the part off and on")
    choose(page, "Where", 1, "fan")
    page.get_by_role("button", name="Do it").click()
    expect(page.get_by_text("over after")).to_contain_text("everything is found and done")
    expect(page.locator(".mr-score")).to_contain_text("9 of 10 marks")
    expect(page.get_by_role("row", name=re.compile("wrong answer: .*only the place is right"))).to_be_visible()
    page.emulate_media(media="print")  # on paper there is the report alone, without a frame
    expect(page.get_by_text("No mission runs")).to_be_hidden()
    expect(page.locator(".panel:has(.mr)")).to_have_css("border-top-width", "0px")
    page.emulate_media(media="screen")
    with page.expect_download() as saved:
        page.get_by_role("button", name="Report (HTML)").click()
    assert "<svg" in Path(saved.value.path()).read_text()
    go(page, f"{demo.base}/faults")
    expect(page.get_by_text("No fault is planted")).to_be_visible()


def test_how_a_part_is_wired_can_be_read_on_a_phone(blank: Page, demo: Site) -> None:
    page = blank
    page.set_viewport_size({"width": 390, "height": 844})
    go(page, f"{demo.base}/library/SG90")
    drawing = page.locator(".wiring svg")
    smallest = (
        "(svg) => Math.min(...[...svg.querySelectorAll('text')].map((one) => one.getBoundingClientRect().height))"
    )
    assert drawing.evaluate(smallest) >= 11
    assert page.evaluate(FITS), "only the drawing goes on to the right"
    assert hurdles(page, dark=False) == []


def choose(page: Page, label: str, which: int, option: str) -> None:
    page.get_by_label(label, exact=True).nth(which).click()
    page.get_by_role("option", name=option).first.click()
