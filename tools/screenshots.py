"""Pictures of every page: starts the demo and opens its pages in a headless Chromium, wide and narrow, light and dark.

    python tools/screenshots.py build/screenshots [--keep docs/pictures] [--only robot,bus]

With --keep the pictures that the documentation shows are copied there.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from threading import Thread

import httpx
from playwright.sync_api import Browser, Page, sync_playwright

WIDTHS = {"desk": (1280, 860), "phone": (390, 844)}
LOOKS = ("light", "dark")
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--hide-scrollbars"]
SETTLE_MS = 1200
"""So long a page is given to draw its live values."""
PATIENCE_MS = 60_000
SCRIPT = "1:unplug bumper"
"""What happens in the demo before the pictures are taken: a part is lost."""
KEPT = (
    "robot-desk-light", "robot-phone-dark", "slot-desk-light", "arrivals-desk-light", "bus-desk-dark",
    "wires-desk-light", "timeline-desk-light", "settings-desk-light", "passport-desk-light", "arena-desk-light",
    "pupils-desk-light", "projector-desk-light",
    "blocks-desk-light", "blocks-phone-light", "lesson-desk-light", "lesson-phone-light", "arena-phone-light",
    "pupils-phone-light", "follower-desk-light", "follower-desk-light-de",
)  # fmt: skip
"""The pictures in the documentation."""

CLASS = "class"
TEACHER = {"name": "Ms Novak", "password": "only for pictures"}


@dataclass(frozen=True, slots=True)
class Shot:
    """One page to take."""

    name: str
    path: str
    prepare: Callable[[Page], None] | None = None
    """What is done on the page before the picture is taken."""
    signed_in: bool = True
    world: str = ""
    """The world that the demo is in; "" = the rover, in none; CLASS = the robot of a class, and no demo."""
    of: str = ""
    """A selector: only this of the page, which is not scrolled."""
    language: str = ""
    """Of a picture in both languages, the second one; its name ends like that."""


PUPILS_PROGRAM = """from msbot import Distance, Level, Part

part = Part("PILOT")


@part.on("distance", Distance)
def when_distance(distance):
    power = 40 if distance.metres > 0.3 else -20
    part.publish("left", Level(percent=power))
    part.publish("right", Level(percent=power))


part.run()
"""


def _a_class(page: Page) -> None:
    """Pupils in groups, two with a program that runs, one who asks: made once, and there for all pictures."""
    if page.get_by_text("Ada", exact=True).count():
        return
    page.get_by_role("button", name="Make the groups by the slots' names").click()
    page.get_by_role("button", name="Simulate all empty slots").click()
    page.get_by_role("textbox", name="Names").fill("Ada; Red\nBen; Red\nCleo; Green\nDora; Green\nEmil; Blue")
    page.get_by_role("button", name="Let them in").click()
    tickets = page.locator(".ticket")
    tickets.first.wait_for()
    passwords = {name: tickets.filter(has_text=name).locator("b.mono").inner_text() for name in ("Ada", "Cleo", "Emil")}
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    base = re.sub(r"/pupils.*", "", page.url)
    assert page.context.browser is not None
    for name, password in passwords.items():
        desk = page.context.browser.new_context().new_page()
        _sign_in(desk, f"{base}/login?next=/program", name, password)
        desk.locator(".cm-line", has_text="import").first.wait_for()
        if name == "Cleo":
            desk.get_by_role("button", name="Put your hand up").click()
            continue
        desk.locator(".cm-content").click()
        desk.keyboard.press("Control+a")
        desk.keyboard.insert_text(PUPILS_PROGRAM)
        desk.get_by_role("button", name="Run", exact=True).click()
        desk.locator("#ms-prog-state[data-state=active]").wait_for()
    page.get_by_text("program in program_Blue").wait_for()
    for close in (
        page.locator(".q-notification").get_by_role("button").all()
    ):  # one who asks is told of until it is seen
        close.click()
    page.locator(".q-notification").first.wait_for(state="hidden")
    page.evaluate("window.scrollTo(0, 0)")


def _sign_in(page: Page, address: str, name: str, password: str) -> None:
    page.goto(address)
    page.fill("[name=name]", name)
    page.fill("[name=password]", password)
    page.click("button[type=submit]")


def _take_apart(page: Page) -> None:
    page.get_by_role("switch").first.click()
    page.get_by_role("textbox").first.fill("power")
    row = page.locator("tr[data-number]", has_text="power").first
    row.click()
    page.locator(".ms-side h2").wait_for()


def _whose_part_fits(page: Page) -> None:
    page.get_by_text("Whose part fits?").click()


def _last_minute(page: Page) -> None:
    page.get_by_text("1 min", exact=True).first.click()


def _second_tab(page: Page) -> None:
    page.get_by_role("tab").nth(1).click()


def _third_tab(page: Page) -> None:
    page.get_by_role("tab").nth(2).click()


def _put_on_a_board(page: Page) -> None:
    page.get_by_role("button", name="Put on a board").click()
    page.locator("#ms-board").scroll_into_view_if_needed()


def _describing_part(page: Page) -> None:
    page.get_by_role("button", name="More").click()
    page.get_by_text("New program", exact=True).click()
    page.locator(".ms-prog-choice").filter(has_text="program").wait_for()
    page.get_by_role("button", name="Run").click()
    page.locator("#ms-prog-adopt a").wait_for()


def _said_by_a_part(page: Page) -> None:
    desk = page.context.new_page()
    desk.goto(page.url.replace("/arrivals", "/program"))
    desk.wait_for_timeout(SETTLE_MS)
    _describing_part(desk)
    page.bring_to_front()
    page.locator(".ms-says").first.scroll_into_view_if_needed()


def _drive(page: Page) -> None:
    """A few seconds by hand, so that there is a trail."""
    plug = page.get_by_role("button", name="Plug the pilot in")
    if plug.is_visible():
        plug.click()
    for name, hold_ms in (("Ahead", 900), ("Turn left", 500), ("Ahead", 700)):
        button = page.locator(f"[data-drive][aria-label='{name}']")
        button.hover()
        page.mouse.down()
        page.wait_for_timeout(hold_ms)
        page.mouse.up()
    page.evaluate("window.scrollTo(0, 0)")


FOLLOWER = """() => {
  const number = (value) => ({ shadow: { type: "math_number", fields: { NUM: value } } });
  const block = (type, fields, inputs, more = {}) => ({ block: { type, fields, inputs, ...more } });
  const position = block("msbot_read", { PORT: '["line","Line","position","float32"]' });
  const steer = block("math_arithmetic", { OP: "MULTIPLY" }, { A: number(30), B: position });
  const send = (port, OP, next) => block(
    "msbot_send", { PORT: JSON.stringify([port, "Level"]) },
    { F_percent: block("math_arithmetic", { OP }, { A: number(35), B: steer }) },
    { extraState: { fields: [["percent", "float32", "%"]] }, ...(next && { next }) },
  );
  const workspace = msbotBlocks.workspace(), hat = workspace.getBlocksByType("msbot_when")[0];
  const made = Blockly.serialization.blocks.append(send("left", "ADD", send("right", "MINUS")).block, workspace);
  hat.getInput("DO").connection.connect(made.previousConnection);
}"""
"""The line follower of the handbook, put together."""


def _blocks(page: Page) -> None:
    page.get_by_role("button", name="Blocks", exact=True).click()
    page.wait_for_function("msbotBlocks.isShown()")
    page.evaluate(FOLLOWER)
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator("#ms-prog-state[data-state=active]").wait_for()
    page.locator(".q-notification").first.wait_for(state="hidden")
    page.evaluate("window.scrollTo(0, 0)")


def _lesson(page: Page) -> None:
    """Begun, with its first two checks ticked."""
    begin = page.get_by_role("button", name="Begin: Closing the loop")
    if begin.count():
        begin.click()
        page.get_by_text("1 of 8 checks are ticked.").wait_for()
        page.get_by_label("Answer").first.fill("0")
        page.get_by_role("button", name="Answer").first.click()
        page.get_by_text("2 of 8 checks are ticked.").wait_for()
        for toast in page.locator(".q-notification").all():
            toast.wait_for(state="detached")
    page.evaluate("window.scrollTo(0, 0)")


def _follower(page: Page) -> None:
    """The blocks alone, as large as they are."""
    page.locator(".ms-blocks-switch button").first.click()
    page.wait_for_function("msbotBlocks.isShown()")
    page.evaluate(FOLLOWER)
    page.evaluate(
        "msbotBlocks.workspace().getBlocksByType('msbot_when')[0].getSvgRoot().id = 'ms-follower'; Blockly.hideChaff()"
    )


SHOTS = (
    Shot("login", "/login", signed_in=False),
    Shot("robot", "/"),
    Shot("slot", "/?slot=fan"),
    Shot("arrivals", "/arrivals"),
    Shot("settings", "/settings"),
    Shot("blueprint", "/settings", _third_tab),
    Shot("bus", "/bus", _take_apart),
    Shot("wires", "/wires"),
    Shot("program", "/program"),
    Shot("blocks", "/program?name=01_hello.py", _blocks, world="line"),
    Shot("follower", "/program?name=01_hello.py", _follower, world="line", of="#ms-follower"),
    Shot("follower", "/program?name=01_hello.py", _follower, world="line", of="#ms-follower", language="de"),
    Shot("board", "/program", _put_on_a_board),
    Shot("describing", "/program", _describing_part),
    Shot("described", "/arrivals", _said_by_a_part),
    Shot("lost", "/?slot=bumper"),
    Shot("arena", "/arena", _drive, world="sorting"),
    Shot("gallery", "/gallery"),
    Shot("quiz", "/learn/quiz?seed=7"),
    Shot("plots", "/plots?show=ear.level,ear:threshold,@late&span=10"),
    Shot("timeline", "/timeline", _last_minute),
    Shot("learn", "/learn"),
    Shot("lesson", "/learn", _lesson, world="line"),
    Shot("library", "/library"),
    Shot("fits", "/library", _whose_part_fits),
    Shot("passport", "/library/SG90"),
    Shot("missions", "/missions"),
    Shot("faults", "/faults"),
    Shot("journal", "/journal"),
    Shot("changes", "/journal", _second_tab),
    Shot("class", "/class"),
    Shot("pupils", "/pupils", _a_class, world=CLASS),
    Shot("projector", "/projector", world=CLASS),
    Shot("doctor", "/doctor"),
    Shot("admin", "/admin"),
    Shot("api", "/api-docs"),
)


@contextmanager
def demo(folder: str, world: str) -> Iterator[str]:
    """A running demo, or the robot of a class; gives the link that signs one in, or leads to where one does."""
    msbot = [sys.executable, "-m", "msbot"]
    if world == CLASS:
        subprocess.run([*msbot, "pupils", "robot", "class.toml", "--groups", "Red,Green,Blue"], cwd=folder, check=True)
        command = [*msbot, "master", "class.toml", "--port", "0", "--link", "udp:127.0.0.1:0"]
    else:
        wishes = ["--world", world] if world else ["--robot", "rover", "--spare", "--script", SCRIPT]
        command = [*msbot, "demo", "--seed", "1", "--port", "0", *wishes]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        link = next(found[0] for line in process.stdout if (found := re.search(r"https?://\S+", line)))
        # The rest is read and thrown away: a demo whose pipe is full stands still.
        Thread(target=deque, args=(process.stdout, 0), daemon=True).start()
        if world == CLASS:
            base, _, token = link.partition("/setup?token=")
            form = {"token": token, **TEACHER, "again": TEACHER["password"]}
            assert httpx.post(f"{base}/setup", data=form).status_code == 303
            link = f"{base}/login"
        yield link
    finally:
        process.terminate()
        process.wait()


def take(browser: Browser, link: str, shots: list[Shot], form: tuple[str, str], folder: Path, *, locale: str) -> None:
    """Take pictures of pages in one form: width and look."""
    width, look = form
    size = WIDTHS[width]
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if look == "dark" else "light",
        locale=locale,
        reduced_motion="reduce",
    )
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    base = re.sub(r"/(enter\?.*|login)", "", link)
    context.add_cookies([{"name": "msbot_tour", "value": "seen", "url": base}])
    for shot in sorted(shots, key=lambda shot: shot.signed_in):
        if shot.signed_in and not any(one["name"].startswith("msbot_session") for one in context.cookies()):
            if link.endswith("/login"):
                _sign_in(page, link, **TEACHER)
            else:
                page.goto(link)
        page.goto(base + shot.path)
        page.wait_for_timeout(SETTLE_MS)
        if shot.prepare is not None:
            shot.prepare(page)
            page.wait_for_timeout(SETTLE_MS)
        path = folder / (f"{shot.name}-{width}-{look}" + (f"-{shot.language}" if shot.language else "") + ".png")
        if shot.of:
            page.locator(shot.of).screenshot(path=path)
        else:
            page.screenshot(path=path)
    context.close()


def main() -> None:
    """Take all pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--keep", type=Path, help="copy those of the documentation there")
    parser.add_argument("--only", default="", help="names of pages, with commas between")
    parser.add_argument("--forms", default="", help="only these of desk-light, desk-dark, phone-light, phone-dark")
    parser.add_argument("--locale", default="en-GB", help="what the browser prefers, as de-DE")
    options = parser.parse_args()
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        sys.exit("there is no Chromium on this machine: apt-get install chromium")
    wanted = [name for name in options.only.split(",") if name]
    shots = [shot for shot in SHOTS if not wanted or shot.name in wanted]
    options.folder.mkdir(parents=True, exist_ok=True)
    forms = [form for form in product(WIDTHS, LOOKS) if not options.forms or "-".join(form) in options.forms.split(",")]
    for world in sorted({shot.world for shot in shots}):
        here = [shot for shot in shots if shot.world == world]
        with tempfile.TemporaryDirectory() as folder, demo(folder, world) as link, sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
            for form, language in product(forms, sorted({shot.language for shot in here})):
                those = [shot for shot in here if shot.language == language]
                take(browser, link, those, form, options.folder, locale=language or options.locale)
            browser.close()
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
        for name in KEPT:
            if (options.folder / f"{name}.png").exists():
                shutil.copy(options.folder / f"{name}.png", options.keep / f"{name}.png")


if __name__ == "__main__":
    main()
