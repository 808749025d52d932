"""Blocks on the page Program, as a pupil of twelve uses them: dragged with the mouse, run, seen to drive; and kept."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from tests.e2e.processes import running
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import Site, go, new_page

WORK_MS = 60_000
"""How long a program may take to become active; the machine may be busy. It takes half a second."""
LINE_MS = 240_000
"""How long it may take until the robot has followed the line for 15 seconds."""

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
IDS = "() => msbotBlocks.workspace().getAllBlocks(true).filter((one) => !one.isShadow()).map((one) => one.id)"
TEXT = "getElement(document.querySelector('.ms-prog-editor').id.slice(1)).editor.state.doc.toString()"

DOCUMENTS = Path(__file__).parent / "blocks"
"""Blocks as they are kept."""
PROGRAMS = Path(__file__).parents[2] / "homes/programs"

FOLLOWER = """# Made of blocks.
from msbot import Level, Line, Part

part = Part("PILOT")
line = Line()


@part.on("line", Line)
def when_line(message):
    global line
    line = message
    part.publish("left", Level(percent=35 + 30 * line.position))
    part.publish("right", Level(percent=35 - 30 * line.position))


part.run()
"""


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
        self.page.locator(".blocklyToolboxCategory", has_text=category).first.click()
        self.page.wait_for_function(STANDS_IN_FLYOUT, arg=[kind])
        x, y = self.page.evaluate(IN_FLYOUT, [kind])
        to_x, to_y = self.page.evaluate(AT_INPUT, [onto, place])
        mouse = self.page.mouse
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + 40, y + 3, steps=3)
        mouse.move(to_x + 12, to_y + 18, steps=8)
        mouse.up()
        made = self.page.wait_for_function(f"(before) => ({IDS})().find((one) => !before.includes(one))", arg=before)
        return str(made.json_value())

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
        expect(self.page.locator("#ms-prog-state")).to_have_attribute("data-state", "active", timeout=WORK_MS)

    def append(self, block: dict[str, Any]) -> str:
        """Put a block into the workspace, without the mouse; returns its id."""
        made: str = self.page.evaluate(
            "(one) => Blockly.serialization.blocks.append({ x: 20, y: 250, ...one }, msbotBlocks.workspace()).id",
            block,
        )
        return made

    def warning(self, block: str) -> str:
        """What a block says is amiss."""
        said: str = self.page.evaluate(
            "(id) => msbotBlocks.workspace().getBlockById(id).getIcon(Blockly.icons.IconType.WARNING)?.getText() ?? ''",
            block,
        )
        return said

    def keep(self, name: str, text: str, blocks: str) -> int:
        """Keep a program by the API; returns the status."""
        status: int = self.page.evaluate(
            """async ([name, text, blocks]) => {
              const csrf = (await (await fetch("/api/me")).json()).csrf;
              const headers = { "content-type": "application/json", "x-csrf-token": csrf };
              const body = JSON.stringify({ text, blocks });
              return (await fetch(`/api/programs/${name}`, { method: "PUT", headers, body })).status;
            }""",
            [name, text, blocks],
        )
        return status

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


@pytest.fixture
def desk(child: BrowserContext, track: Site) -> Iterator[Pupil]:
    """The page Program, open in a tab, with a program that is text."""
    page = child.new_page()
    go(page, f"{track.base}/program?name=01_hello.py")
    page.wait_for_function("msbotBlocks.words('part') !== undefined")
    yield Pupil(page)
    page.close()


@pytest.mark.timeout(600)
def test_a_line_follower_of_blocks_makes_the_lesson_tick(desk: Pupil, child: BrowserContext, track: Site) -> None:
    learn = child.new_page()
    go(learn, f"{track.base}/learn")
    learn.get_by_role("button", name="Take part").click()

    def expect_ticks(number: int, patience_ms: float = WORK_MS) -> None:
        expect(learn.get_by_text(f"{number} of 8 checks have ticked.")).to_be_visible(timeout=patience_ms)

    def answer(number: int, words: str) -> None:
        place = learn.locator(".ms-check").filter(has=learn.get_by_role("button", name="Answer")).nth(number)
        if place.locator(".q-select").count():
            place.locator(".q-select").click()
            learn.get_by_role("option", name=words).click()
        else:
            place.get_by_label("Answer").first.fill(words)
        place.get_by_role("button", name="Answer").click()

    expect_ticks(1)
    answer(0, "0")
    expect_ticks(2)
    desk.open_blocks()
    hat = desk.blocks("msbot_when")[0]
    left = desk.drag("Send", "msbot_send", hat, "DO")
    right = desk.drag("Send", "msbot_send", left, "next")
    desk.choose(right, "PORT", "right")
    sums = []
    for send, sign in ((left, "+"), (right, "-")):
        sums.append(desk.drag("Numbers", "math_arithmetic", send, "F_percent"))
        desk.choose(sums[-1], "OP", sign)
        desk.write(sums[-1], "A", 35)
        desk.write(sums[-1], "B", 0)
    desk.run()
    expect_ticks(3)
    answer(0, "below")
    expect_ticks(4)
    desk.stop()
    for total in sums:
        steer = desk.drag("Numbers", "math_arithmetic", total, "B")
        desk.choose(steer, "OP", "×")
        desk.write(steer, "A", 30)
        desk.drag("Sense", "msbot_read", steer, "B")
    desk.expect_text(FOLLOWER)
    arena = child.new_page()
    go(arena, f"{track.base}/arena")
    # At half the speed, so that a busy machine's late messages do not throw it off the line.
    arena.get_by_role("button", name="½", exact=True).click()
    arena.get_by_role("button", name="Begin anew").click()
    desk.run()
    expect_ticks(5, LINE_MS)
    desk.stop()
    learn.close()
    arena.close()


@pytest.mark.parametrize(
    ("document", "program"), [("every_block", PROGRAMS / "blocks.py"), ("own_part", DOCUMENTS / "own_part.txt")]
)
def test_what_blocks_mean_is_what_every_home_runs(desk: Pupil, document: str, program: Path) -> None:
    doc = (DOCUMENTS / f"{document}.json").read_text()
    assert desk.page.evaluate("(doc) => msbotBlocks.textOf(doc)", doc) == {"text": program.read_text()}


def test_an_error_lights_up_its_block_with_its_sentence(desk: Pupil) -> None:
    desk.open_blocks()
    every = desk.append({"type": "msbot_every", "fields": {"SECONDS": 0.2}})
    said = desk.drag("Words", "text_print", every, "DO")
    divided = desk.drag("Numbers", "math_arithmetic", said, "TEXT")
    desk.choose(divided, "OP", "÷")
    desk.write(divided, "B", 0)
    desk.run()
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
    expect(page.get_by_text(re.compile(r"blocks\d+.py is a new program of blocks; 01_hello.py stays"))).to_be_visible()
    said = desk.drag("Send", "text_print", desk.blocks("msbot_when")[0], "DO")
    page.wait_for_function(f"{TEXT}.includes('print(\"hello\")')")
    made = page.evaluate(TEXT)
    assert page.locator(".cm-content").get_attribute("contenteditable") == "false"
    page.get_by_role("button", name="Keep", exact=True).click()
    expect(page.get_by_text("is kept, version")).to_be_visible()
    address = page.url
    again = child.new_page()
    go(again, address)
    again.wait_for_function("msbotBlocks.isShown()")
    assert again.evaluate(TEXT) == made, "blocks and text are those that were kept"
    assert said in Pupil(again).blocks("text_print")
    again.close()
    page.get_by_role("button", name="Python", exact=True).click()
    expect(page.get_by_text("Text does not turn into blocks. The blocks are kept as they were")).to_be_visible()
    expect(page.locator(".cm-content")).to_have_attribute("contenteditable", "true")
    page.locator(".cm-content").click()
    page.keyboard.press("Control+End")
    page.keyboard.type("# mine")
    page.get_by_role("button", name="Blocks", exact=True).click()
    expect(page.get_by_text("The text has been changed since it was made of blocks.")).to_be_visible()
    page.get_by_role("button", name="Stay with the text").click()
    assert page.evaluate(TEXT) == made + "# mine"
    page.get_by_role("button", name="Blocks", exact=True).click()
    page.get_by_role("button", name="Back to the blocks").click()
    page.wait_for_function("msbotBlocks.isShown()")
    desk.expect_text(made)


@pytest.mark.parametrize(
    ("kept", "sentence"),
    [
        ('{"msbot":2,"view":"blocks","workspace":{}}', "The blocks of this program are of a newer MsBOT"),
        ('{"msbot":1,"view":"blocks","workspace":{"blocks":{"blocks":[{"type":"no_such"}]}}}', "are broken"),
        ('{"view":"blocks"}', "are broken"),
        (json.dumps({"msbot": 1, "view": "blocks", "workspace": [{"type": "text"}] * 1001}), "are too many"),
    ],
    ids=["newer", "of an unknown kind", "no blocks", "too many"],
)
def test_blocks_that_cannot_be_shown_leave_their_python(desk: Pupil, track: Site, kept: str, sentence: str) -> None:
    page = desk.page
    assert desk.keep("strange.py", "print(1)\n", kept) == 200
    go(page, f"{track.base}/program?name=strange.py")
    expect(page.locator(".q-notification").filter(has_text=sentence)).to_be_visible()
    assert page.evaluate(TEXT) == "print(1)\n"
    page.get_by_role("button", name="Keep", exact=True).click()
    expect(page.get_by_text("strange.py is kept, version")).to_be_visible()
    assert desk.kept("strange.py") == {"text": "print(1)\n", "blocks": kept}, "and the blocks are as they were"


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
        page.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    page.set_viewport_size({"width": 1280, "height": 900})
    for dark in (False, True):
        assert hurdles(page, dark=dark) == []
    page.get_by_text("The program in words, and keys").click()
    words = page.locator("#ms-blocks-outline").inner_text().split("\n")
    assert words[:2] == ["this program is the part PILOT – Pilot", "when a message arrives at line"]


def test_blocks_in_german(browser: Browser, track: Site) -> None:
    context = browser.new_context(locale="de-DE", viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.goto(track.link)
    go(page, f"{track.base}/program")
    page.get_by_role("button", name="Blöcke", exact=True).click()
    page.wait_for_function("msbotBlocks.isShown()")
    words = page.locator("#ms-blocks-outline").text_content() or ""
    toolbox = page.locator(".blocklyToolbox").inner_text()
    undo = page.evaluate("Blockly.Msg.UNDO")
    context.close()
    assert words.startswith("dieses Programm ist das Teil PILOT")
    assert "Senden" in toolbox
    assert undo == "Rückgängig", "Blockly's own words"
