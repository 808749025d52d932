"""Blocks on the page Program, as a pupil of twelve uses them: dragged with the mouse, run, seen to drive; and kept."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect
from playwright.sync_api import TimeoutError as BrowserTimeout

from tests import ROOT
from tests.e2e.processes import running
from tests.effort import THOROUGH
from tests.lessons.lesson_stage import blocks_of_the_handbook
from tests.web.browser.accessible import hurdles, hurdles_by_day_and_night
from tests.web.browser.conftest import CLICK, FORGOTTEN, Site, again_until, call, go, new_page, told
from tests.web.browser.keyboard import tab_to
from tests.web.browser.test_demo_pages import FITS

WORK_MS = 120_000
"""How long a program may take to become active; the machine may be busy. It takes half a second."""
LAP_MS = 400_000
"""How long it may take until the robot has gone once round."""

IN_FLYOUT = """([type]) => {
  const block = msbotBlocks.workspace().getFlyout().getWorkspace().getTopBlocks(true).find((one) => one.type === type);
  const box = block.pathObject.svgPath.getBoundingClientRect();
  return [box.left + 8, box.top + Math.min(box.height, 30) / 2];
}"""
"""Where a block of the open category can be gripped."""
STANDS_IN_FLYOUT = f"""([type]) => new Promise((done) => {{
  const flyout = msbotBlocks.workspace().getFlyout();
  if (!flyout.isVisible() || !flyout.getWorkspace().getBlocksByType(type, false).length) return done(false);
  const before = String(({IN_FLYOUT})([type]));
  requestAnimationFrame(() => requestAnimationFrame(() => done(String(({IN_FLYOUT})([type])) === before)));
}})"""
"""Whether the open category has the block, and has drawn it where it stays."""
AT_INPUT = """([id, name]) => {
  const workspace = msbotBlocks.workspace(), block = workspace.getBlockById(id);
  const here = name === "next" ? block.nextConnection : block.getInput(name).connection, shadow = here.targetBlock();
  if (shadow && here.type === Blockly.ConnectionType.INPUT_VALUE) {
    const box = shadow.pathObject.svgPath.getBoundingClientRect();
    return [box.left, box.top];
  }
  const point = Blockly.utils.svgMath.wsToScreenCoordinates(workspace, new Blockly.utils.Coordinate(here.x, here.y));
  return [point.x, point.y];
}"""
"""Where a block goes that shall be put there."""
AT_FIELD = """([id, name]) => {
  const box = msbotBlocks.workspace().getBlockById(id).getField(name).getSvgRoot().getBoundingClientRect();
  return [box.left + box.width / 2, box.top + box.height / 2];
}"""
TWO_PICTURES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
WRITTEN_ANEW = "new Promise((done) => { document.body.className += ' '; requestAnimationFrame(done); })"
"""As NiceGUI does with the class of the page whenever it has something new."""
DRAWN = """() => [msbotBlocks.workspace().getFlyout().isVisible(),
  ...msbotBlocks.workspace().getFlyout().getWorkspace().getTopBlocks(true).map((one) => one.id)]"""
"""What the open category shows."""
IDS = "() => msbotBlocks.workspace().getAllBlocks(true).filter((one) => !one.isShadow()).map((one) => one.id)"
EDITOR = "getElement(document.querySelector('.ms-prog-editor').id.slice(1)).editor"
TEXT = f"{EDITOR}.state.doc.toString()"

DOCUMENTS = Path(__file__).parent / "blocks"
"""Blocks as they are kept."""
PROGRAMS = ROOT / "packages/msbot/tests/homes/programs"

FOLLOWER = blocks_of_the_handbook()
"""The line follower, as docs/howto/blocks.md prints it; `tests.lessons` drives it once round, in virtual time."""


class Pupil:
    """Somebody in front of the page Program, with a mouse."""

    def __init__(self, page: Page) -> None:
        self.page = page

    def open_blocks(self) -> None:
        """Press Blocks."""
        self.page.get_by_role("button", name="Blocks", exact=True).click()
        self.page.wait_for_function("msbotBlocks.isShown()")

    def blocks(self, kind: str) -> list[str]:
        found: list[str] = self.page.evaluate(
            "(type) => msbotBlocks.workspace().getBlocksByType(type, true).map((one) => one.id)", kind
        )
        return found

    def drag(self, category: str, kind: str, onto: str, place: str) -> str:
        """Drag a block out of the toolbox to a place of another one; returns its id."""
        before = self.page.evaluate(IDS)
        added = f"(before) => ({IDS})().find((one) => !before.includes(one))"
        for _ in range(3):  # on a busy machine moves come as one, and a block is dropped where it was
            self._carry(category, kind, onto, place)
            with suppress(BrowserTimeout):
                self.page.wait_for_function(added, arg=before, timeout=5_000)
                break
            self.page.evaluate("msbotBlocks.workspace().getToolbox().clearSelection()")
        block = str(self.page.wait_for_function(added, arg=before).json_value())
        held_by = "([id, onto]) => msbotBlocks.workspace().getBlockById(id).getParent()?.id === onto"
        assert self.page.evaluate(held_by, [block, onto]), f"{kind} was dropped, and is not at {place}"
        return block

    def _carry(self, category: str, kind: str, onto: str, place: str) -> None:
        """The mouse's way from the toolbox to that place."""
        self.page.locator(".blocklyToolboxCategory", has_text=category).first.click()
        self.page.wait_for_function(STANDS_IN_FLYOUT, arg=[kind])
        to_x, to_y = self.page.evaluate(AT_INPUT, [onto, place])
        mouse = self.page.mouse
        for attempt in range(4):  # on a busy machine moves come as one, and are taken for a click
            x, y = self.page.evaluate(IN_FLYOUT, [kind])
            mouse.move(x, y)
            mouse.down()
            mouse.move(x + 40, y + 3, steps=3)
            try:
                # Only then down to its place: one move downwards would scroll the toolbox.
                self.page.wait_for_function(
                    "msbotBlocks.workspace().isDragging()", timeout=5_000 if attempt < 3 else WORK_MS
                )
                break
            except BrowserTimeout:
                mouse.up()
        # A hand is slower than a picture. Blockly knows where the places of a new block are once it was drawn.
        for missing in (4, 1, 0):
            self.page.evaluate(TWO_PICTURES)
            mouse.move(to_x + 12 - missing, to_y + 18, steps=4)
        self.page.evaluate(TWO_PICTURES)
        mouse.up()

    def choose(self, block: str, field: str, label: str) -> None:
        """Choose in a drop-down."""
        self.page.mouse.click(*self.page.evaluate(AT_FIELD, [block, field]))
        self.page.locator(".blocklyMenuItem").filter(has_text=re.compile(f"^\\s*{re.escape(label)}\\s*$")).click()

    def write(self, block: str, place: str, value: float) -> None:
        """Write a number into an input."""
        find = "([id, name]) => msbotBlocks.workspace().getBlockById(id).getInputTargetBlock(name).id"
        inner = self.page.evaluate(find, [block, place])
        self.page.mouse.click(*self.page.evaluate(AT_FIELD, [inner, "NUM"]))
        self.page.keyboard.press("Control+A")
        self.page.keyboard.type(str(value))
        self.page.keyboard.press("Enter")

    def expect_text(self, text: str) -> None:
        self.page.wait_for_function(f"(text) => {TEXT} === text", arg=text)

    def run(self) -> None:
        self.page.get_by_role("button", name="Run", exact=True).click()
        self.expect_active()

    def expect_active(self) -> None:
        expect(self.page.locator("#ms-prog-state")).to_have_attribute("data-state", "active", timeout=WORK_MS)

    def append(self, block: dict[str, Any], then: str) -> None:
        """Put a block into the workspace, without the mouse, and do something before Blockly has told of it.

        What is to be clicked then waits until the page takes it.
        """
        is_dead = "document.documentElement.classList.contains('ms-dead')" if then else "false"
        self.page.wait_for_function(
            f"(one) => {{ if ({is_dead}) return false;"
            "Blockly.serialization.blocks.append({ x: 20, y: 250, ...one }, msbotBlocks.workspace());"
            f"{then}; return true; }}",
            arg=block,
        )

    def warning(self, block: str) -> str:
        """What a block says is amiss."""
        said: str = self.page.evaluate(
            "(id) => msbotBlocks.workspace().getBlockById(id).getIcon(Blockly.icons.IconType.WARNING)?.getText() ?? ''",
            block,
        )
        return said

    def keep(self, name: str, text: str, blocks: str) -> int:
        """Keep a program by the API; returns the status."""
        return call(self.page, "PUT", f"/api/programs/{name}", {"text": text, "blocks": blocks})

    def kept(self, name: str) -> dict[str, str]:
        """What is kept of a program."""
        found: dict[str, str] = self.page.evaluate(
            "async (name) => (await fetch(`/api/programs/${name}`)).json()", name
        )
        return found

    def stop(self) -> None:
        self.page.get_by_role("button", name="Stop", exact=True).click()
        expect(self.page.locator("#ms-prog-state")).to_have_attribute("data-state", "not running")


@pytest.fixture(scope="module")
def track(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The buggy in its world, and the lesson about it."""
    folder: Path = tmp_path_factory.mktemp("track")
    with running("demo", "--lesson", "closing_the_loop", "--port", "0", cwd=folder) as process:
        yield Site(process)


@pytest.fixture(scope="module")
def child(browser: Browser, track: Site) -> Iterator[BrowserContext]:
    """Whoever has followed the demo's link."""
    visitor = new_page(browser)
    visitor.goto(track.link)
    yield visitor.context
    visitor.context.close()


@pytest.fixture(scope="module")
def tab(child: BrowserContext) -> Page:
    """Where they write: a new tab for each test would cost a process of the browser each."""
    return child.pages[0]


@pytest.fixture
def desk(tab: Page, track: Site) -> Pupil:
    """The page Program, open in a tab, with a program that is text; the lesson stands beside it."""
    tab.set_viewport_size({"width": 1680, "height": 900})
    go(tab, f"{track.base}/program?name=01_hello.py")
    tab.wait_for_function("msbotBlocks.words('part') !== undefined")
    return Pupil(tab)


class Learner:
    """The page Learn beside it, where the lesson "Closing the loop" runs."""

    def __init__(self, page: Page, base: str) -> None:
        self.page = page
        go(page, f"{base}/learn")
        page.get_by_role("button", name="Take part").click()

    def expect_ticks(self, number: int, patience_ms: float = WORK_MS) -> None:
        expect(self.page.get_by_text(f"{number} of 8 checks are ticked.")).to_be_visible(timeout=patience_ms)

    def answer(self, words: str) -> None:
        """Answer the first question that is open."""
        place = self.page.locator(".ms-check").filter(has=self.page.get_by_role("button", name="Answer")).first
        if place.locator(".q-select").count():
            place.locator(".q-select").click()
            self.page.get_by_role("option", name=words).click()
        else:
            place.get_by_label("Answer").first.fill(words)
        place.get_by_role("button", name="Answer").click()


def test_the_lesson_about_the_line_follower_is_done_with_blocks(
    desk: Pupil, child: BrowserContext, track: Site
) -> None:
    """As its text says; to its end only in a thorough run: a motor must get its messages in time for half a minute."""
    learn = Learner(child.new_page(), track.base)
    learn.expect_ticks(1)
    learn.answer("0")
    learn.expect_ticks(2)
    desk.open_blocks()
    left = desk.drag("Send", "msbot_send", desk.blocks("msbot_when")[0], "DO")
    right = desk.drag("Send", "msbot_send", left, "next")
    desk.choose(right, "PORT", "right")
    for send in (left, right):
        desk.write(send, "F_percent", 35)
    desk.run()
    learn.expect_ticks(3)
    learn.answer("below")
    learn.expect_ticks(4)
    desk.stop()
    for send, sign in ((left, "+"), (right, "-")):
        total = desk.drag("Numbers", "math_arithmetic", send, "F_percent")
        desk.choose(total, "OP", sign)
        desk.write(total, "A", 35)
        steer = desk.drag("Numbers", "math_arithmetic", total, "B")
        desk.choose(steer, "OP", "×")
        desk.write(steer, "A", 30)
        desk.drag("Sense", "msbot_read", steer, "B")
    desk.expect_text(FOLLOWER)
    if THOROUGH:
        arena = child.new_page()
        go(arena, f"{track.base}/arena")
        # At half the speed, so that a busy machine's late messages do not throw it off the line.
        arena.get_by_role("button", name="½", exact=True).click()
        arena.get_by_role("button", name="Begin anew").click()
    desk.run()
    if THOROUGH:
        learn.expect_ticks(5, LAP_MS)
        learn.expect_ticks(6, LAP_MS)
        learn.page.locator("#ms-stop").click()
        learn.expect_ticks(7)
        learn.answer("the motor driver, by its own safe value")
        learn.expect_ticks(8)
        learn.page.get_by_role("button", name="Go on", exact=True).click()
        arena.close()
    desk.stop()
    learn.page.close()


class Keys:
    """Somebody who has no mouse, in the blocks: where the focus is, is what a screen reader says."""

    def __init__(self, page: Page) -> None:
        self.page = page
        tab_to(page, page.locator(".blocklyToolbox"))

    def said(self) -> str:
        words: str = self.page.evaluate(
            "document.activeElement === document.body ? 'nothing'"
            " : document.activeElement.getAttribute('aria-label') || document.activeElement.textContent.trim()"
        )
        return words

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def go(self, key: str, words: str) -> None:
        """Press an arrow key until something that begins like that has the focus."""
        heard = [self.said()]
        while not heard[-1].startswith(words):
            self.press(key)
            heard.append(self.said())
            assert len(heard) < 40, f"{key} does not lead to {words!r}: {heard}"

    def take(self, category: str, block: str) -> None:
        """Put a block out of the toolbox where the focus was: Blockly offers that place first."""
        self.press("t", *["ArrowUp"] * 8)
        self.go("ArrowDown", category)
        self.press("ArrowRight")
        self.go("ArrowDown", block)
        self.press("Enter")
        self.page.wait_for_function("msbotBlocks.workspace().isDragging()")
        self.press("Enter")
        self.page.wait_for_function("!msbotBlocks.workspace().isDragging() && document.activeElement !== document.body")

    def write(self, number: int) -> None:
        self.press("Enter", "Control+A")
        self.page.keyboard.type(str(number))
        self.press("Enter")

    def choose(self, label: str) -> None:
        """Choose in the drop-down that has the focus."""
        self.press("Enter")
        chosen = self.page.locator(".blocklyMenuItemHighlight", has_text=label)
        for _ in range(10):
            if chosen.count():
                break
            self.press("ArrowDown")
        chosen.wait_for()
        self.press("Enter")


def test_a_line_follower_is_built_with_the_keyboard_only(desk: Pupil) -> None:

    def open_blocks() -> None:
        desk.page.get_by_role("button", name="Blocks", exact=True).focus()
        desk.page.keyboard.press("Enter")

    again_until(open_blocks, lambda ms: desk.page.wait_for_function("msbotBlocks.isShown()", timeout=ms))
    keys = Keys(desk.page)
    keys.press("w")
    keys.go("ArrowDown", "End when a message arrives at, line")
    for send in ("left", "right"):
        keys.take("Send", "send to, left")
        if send == "right":
            keys.go("ArrowRight", "dropdown: left")
            keys.choose("right")
        keys.go("ArrowRight", "Edit number: 0")
        keys.take("Numbers", "1, plus, 1")
        keys.go("ArrowRight", "Edit first number, number: 1")
        keys.write(35)
        if send == "right":
            keys.go("ArrowRight", "dropdown: plus")
            keys.choose("-")
        keys.go("ArrowRight", "Edit second number, number: 1")
        keys.take("Numbers", "1, plus, 1")
        keys.go("ArrowRight", "Edit first number, number: 1")
        keys.write(30)
        keys.go("ArrowRight", "dropdown: plus")
        keys.choose("×")
        keys.go("ArrowRight", "Edit second number, number: 1")
        keys.take("Sense", "line: position")
        keys.press("w")
        keys.go("ArrowDown", f"send to, {send}")
    desk.expect_text(FOLLOWER)


def test_what_blocks_mean_is_what_every_home_runs(desk: Pupil) -> None:
    for document, program in (
        ("every_block", PROGRAMS / "blocks.py"),
        ("own_part", DOCUMENTS / "own_part.txt"),
        ("blink", DOCUMENTS / "blink.txt"),
    ):
        doc = (DOCUMENTS / f"{document}.json").read_text()
        assert desk.page.evaluate("(doc) => msbotBlocks.textOf(doc)", doc) == {"text": program.read_text()}, document


def test_an_error_lights_up_its_block_with_its_sentence(desk: Pupil) -> None:
    desk.open_blocks()
    number = {"type": "math_number", "fields": {"NUM": 0}}
    divided = {
        "type": "math_arithmetic",
        "fields": {"OP": "DIVIDE"},
        "inputs": {"A": {"shadow": number}, "B": {"shadow": number}},
    }
    print_it = {"type": "text_print", "inputs": {"TEXT": {"block": divided}}}
    desk.append(
        {"type": "msbot_every", "fields": {"SECONDS": 0.2}, "inputs": {"DO": {"block": print_it}}},
        then="[...document.querySelectorAll('button')].find((one) => one.textContent.includes('Run')).click()",
    )  # in one step: Run means what is seen
    (said,) = desk.blocks("text_print")
    desk.expect_active()
    expect(desk.page.locator(".ms-block-wrong")).to_have_attribute("data-id", said, timeout=WORK_MS)
    assert "ZeroDivisionError" in desk.warning(said)
    expect(desk.page.locator(".blocklyBubble, .blocklyTextBubble").first).to_contain_text("ZeroDivisionError")
    desk.page.locator("#ms-console").get_by_role("button", name="the block").click()
    desk.stop()
    desk.run()
    expect(desk.page.locator(".ms-block-wrong")).to_have_count(1)
    desk.stop()


def test_from_blocks_to_python_and_back_and_all_of_it_kept(desk: Pupil, child: BrowserContext, track: Site) -> None:
    page = desk.page
    desk.open_blocks()
    told(page, ".py is a new program of blocks; 01_hello.py stays")
    said = desk.drag("Send", "text_print", desk.blocks("msbot_when")[0], "DO")
    page.wait_for_function(f"{TEXT}.includes('print(\"hello\")')")
    made = page.evaluate(TEXT)
    assert page.locator(".cm-content").get_attribute("contenteditable") == "false"
    page.get_by_role("button", name="Save", exact=True).click()
    told(page, "is saved, version")
    address = page.url
    again = child.new_page()
    go(again, address)
    again.wait_for_function("msbotBlocks.isShown()")
    assert again.evaluate(TEXT) == made, "blocks and text are those that were kept"
    assert said in Pupil(again).blocks("text_print")
    again.close()
    to_python = "[...document.querySelectorAll('.ms-blocks-switch button')].at(-1)"
    seen = "[document.querySelector('#ms-blocks').hidden, msbotBlocks.isShown()]"
    pressed = f"() => ({CLICK})({to_python}) && {seen}"
    assert page.wait_for_function(pressed).json_value() == [True, False], (
        "blocks take no key and write nothing, before the robot has answered"
    )
    expect(page.get_by_text("Text does not turn into blocks. The blocks are kept as they were")).to_be_visible()
    expect(page.locator(".cm-content")).to_have_attribute("contenteditable", "true")
    page.locator(".cm-content").click()
    page.keyboard.press("Control+End")
    page.keyboard.type("# mine")
    desk.expect_text(made + "# mine")
    page.get_by_role("button", name="Blocks", exact=True).click()
    expect(page.get_by_text("The text has been changed since it was made of blocks.")).to_be_visible()
    page.get_by_role("button", name="Stay with the text").click()
    assert page.evaluate(TEXT) == made + "# mine"
    page.reload()  # before the server has kept that it is text now
    page.wait_for_function(f"window.did_handshake && {TEXT}.endsWith('# mine')")
    page.wait_for_function("msbotBlocks.words('part') !== undefined && !msbotBlocks.isShown()")
    expect(page.locator(".cm-content")).to_have_attribute("contenteditable", "true")
    page.get_by_role("button", name="Blocks", exact=True).click()
    page.get_by_role("button", name="Back to the blocks").click()
    page.wait_for_function("msbotBlocks.isShown()")
    desk.expect_text(made)
    # The robot is out of reach for so long that the page makes itself anew.
    page.evaluate(FORGOTTEN)
    desk.append({"type": "text_print", "id": "added"}, "")
    page.wait_for_function("!window.isOld && window.did_handshake && msbotBlocks.isShown()")
    page.wait_for_function("msbotBlocks.workspace().getBlockById('added') !== null")


def test_blocks_that_come_late_write_over_nothing(desk: Pupil) -> None:
    """Loading Blockly takes its time; what was typed, or has come from elsewhere, until then is not theirs."""
    page = desk.page
    desk.open_blocks()
    page.wait_for_function(f"{TEXT}.includes('def ')")
    doc, made = page.evaluate("msbotBlocks.doc()"), page.evaluate(TEXT)
    page.get_by_role("button", name="Python", exact=True).click()
    # Until the switch has turned, it takes no other press; the text may be written in since before there were blocks.
    expect(page.get_by_role("button", name="Python", exact=True)).to_have_attribute("aria-pressed", "true")
    late = f"""([doc, made, typed]) => {{
        const shown = msbotBlocks.show('late.py', doc, made);
        {EDITOR}.dispatch({{ changes: {{ from: made.length, insert: typed }} }});
        return shown;
    }}"""
    assert page.evaluate(late, [doc, made, "# mine"]) == {"changed": True}
    assert page.evaluate(TEXT) == made + "# mine"
    assert not page.evaluate("msbotBlocks.isShown()")
    # It comes when they are shown and have more to say: Blockly tells of what it has put in one picture later.
    page.evaluate(
        f"""async ([doc, made, typed]) => {{
        await msbotBlocks.show('late.py', doc, made + typed);
        await new Promise(requestAnimationFrame).then(() => new Promise((done) => setTimeout(done)));
        {EDITOR}.dispatch({{ changes: {{ from: 0, to: made.length, insert: made + typed }} }});
        document.body.click();
        msbotBlocks.hide();
    }}""",
        [doc, made, "# mine"],
    )
    assert page.evaluate(TEXT) == made + "# mine"
    # On the page: typed while they are on their way.
    desk.expect_text(made + "# mine")
    page.get_by_role("button", name="Blocks", exact=True).click()
    page.evaluate(f"""() => {{
        const show = msbotBlocks.show;
        msbotBlocks.show = (...all) => {{
            msbotBlocks.show = show;
            const shown = show(...all), editor = {EDITOR};
            editor.dispatch({{ changes: {{ from: editor.state.doc.length, insert: " and more" }} }});
            return shown;
        }};
    }}""")
    page.get_by_role("button", name="Back to the blocks").click()
    told(page, "The text has been changed since it was made of blocks.")
    assert page.evaluate(TEXT) == made + "# mine and more"
    expect(page.locator(".cm-content")).to_have_attribute("contenteditable", "true")
    page.get_by_role("button", name="Blocks", exact=True).click()
    page.get_by_role("button", name="Back to the blocks").click()
    page.wait_for_function("msbotBlocks.isShown()")
    desk.expect_text(made)


STRANGE = {
    '{"msbot":2,"view":"blocks","workspace":{}}': "The blocks of this program are of a newer MsBOT",
    '{"msbot":1,"view":"blocks","workspace":{"blocks":{"blocks":[{"type":"no_such"}]}}}': "are broken",
    '{"view":"blocks"}': "are broken",
    json.dumps({"msbot": 1, "view": "blocks", "workspace": [{"type": "text"}] * 1001}): "are too many",
}
"""Blocks that are kept, and why they cannot be shown."""


def test_blocks_that_cannot_be_shown_leave_their_python(desk: Pupil, track: Site) -> None:
    page = desk.page
    for number, (kept, sentence) in enumerate(STRANGE.items()):
        name = f"strange{number}.py"
        assert desk.keep(name, "print(1)\n", kept) == 200
        assert sentence in page.evaluate("(doc) => msbotBlocks.textOf(doc)", kept)["error"]
        if number > 1:
            continue
        # On the page: what cannot be read, and what cannot be put in.
        go(page, f"{track.base}/program?name={name}")
        told(page, sentence)
        assert page.evaluate(TEXT) == "print(1)\n"
        page.get_by_role("button", name="Save", exact=True).click()
        told(page, f"{name} is saved, version")
        assert desk.kept(name) == {"text": "print(1)\n", "blocks": kept}, "and the blocks are as they were"


def test_another_robot_has_other_drop_downs_and_nothing_is_lost(desk: Pupil, track: Site) -> None:
    page = desk.page
    desk.open_blocks()
    hat = desk.blocks("msbot_when")[0]
    before = page.evaluate(TEXT)
    other = Pupil(page.context.new_page())
    go(other.page, track.base)
    other.page.get_by_role("button", name="Unplug line").click()
    page.wait_for_function("(id) => (msbotBlocks.workspace().getBlockById(id).saidAmiss || '') !== ''", arg=hat)
    assert desk.warning(hat) == "Nobody sends to line now: no part is in the slot line."
    other.page.get_by_role("button", name="Plug line in").click()
    page.wait_for_function("(id) => msbotBlocks.workspace().getBlockById(id).saidAmiss === ''", arg=hat)
    other.page.close()
    page.evaluate("msbotBlocks.know({ parts: [] })")
    root = desk.blocks("msbot_part")[0]
    assert desk.warning(root).startswith("This robot has no slot for PILOT (missing) (any more).")
    assert page.evaluate(TEXT) == before, "the program is as it was"


def test_for_everybody_and_on_a_phone(desk: Pupil) -> None:
    page = desk.page
    desk.open_blocks()
    for width in (1280, 390):
        page.set_viewport_size({"width": width, "height": 844})
        page.wait_for_function(FITS)
    page.set_viewport_size({"width": 1280, "height": 900})
    expect(page.locator(".blocklyZoom").first).to_be_visible()
    expect(page.locator("#ms-blocks-zoom")).to_be_hidden()
    assert hurdles_by_day_and_night(page) == []
    page.locator(".blocklyToolboxCategory", has_text="Send").first.click()
    page.wait_for_function(STANDS_IN_FLYOUT, arg=["msbot_send"])
    drawn = page.evaluate(DRAWN)
    page.evaluate(f"{WRITTEN_ANEW}.then({TWO_PICTURES})")
    assert page.evaluate(DRAWN) == drawn, "a category that is open stays as it is when the page is updated"
    page.get_by_text("The program in words, and keys").click()
    words = page.locator("#ms-blocks-outline").inner_text().split("\n")
    assert words[:2] == ["this program is the part PILOT – Pilot", "when a message arrives at line"]


def test_on_a_phone_the_buttons_for_zooming_cover_no_blocks(browser: Browser, track: Site) -> None:
    page = new_page(browser, width=390, height=844, by_finger=True)
    page.goto(track.link)
    go(page, f"{track.base}/program")
    page.get_by_role("button", name="Blocks", exact=True).click()
    page.wait_for_function("msbotBlocks.isShown()")
    expect(page.locator(".blocklyZoom")).to_have_count(0)
    scale = "msbotBlocks.workspace().getScale()"
    before = page.evaluate(scale)
    page.get_by_role("button", name="Zoom in").tap()
    page.wait_for_function(f"{scale} > {before}")
    larger = page.evaluate(scale)
    page.get_by_role("button", name="Zoom out").tap()
    page.wait_for_function(f"{scale} < {larger}")
    page.get_by_role("button", name="All blocks").tap()
    root = "msbotBlocks.workspace().getBlocksByType('msbot_part')[0].getSvgRoot()"
    page.wait_for_function(f"{root}.getBoundingClientRect().right < innerWidth")
    assert page.evaluate(FITS)
    assert hurdles(page, dark=False) == []
    page.context.close()


def test_blocks_in_german(browser: Browser, track: Site) -> None:
    page = new_page(browser, locale="de-DE")
    page.goto(track.link)
    go(page, f"{track.base}/program")
    page.get_by_role("button", name="Blöcke", exact=True).click()
    page.wait_for_function("msbotBlocks.isShown()")
    words = page.locator("#ms-blocks-outline").text_content() or ""
    toolbox = page.locator(".blocklyToolbox").inner_text()
    undo = page.evaluate("Blockly.Msg.UNDO")
    page.context.close()
    assert words.startswith("dieses Programm ist das Teil PILOT")
    assert "Senden" in toolbox
    assert undo == "Rückgängig", "Blockly's own words"
