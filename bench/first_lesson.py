"""How long a pupil of twelve needs from `make demo` to the end of the first lesson, reading every word.

    python -m bench.first_lesson [--make] [--easy] [--write]

A real Chromium at the page of a real demo, as large as a school's laptop. What the robot and the page need is measured
by the clock. What the pupil needs is counted: each word that comes into sight for the first time, also those of cards,
menus and messages, and the words of each sheet of the lesson; each act, as finding and pressing a button; each letter
typed. The pupil asks nobody and is never told where to press: every button is found by the words that the page or the
lesson has just said. `--make` begins with a copy of the project without `.venv` and `make demo`; else the demo is
started. `--write` keeps the table in bench/results.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

from playwright.sync_api import Locator, Page, expect, sync_playwright

from bench.machine import describe_machine
from bench.result import write_result
from tests.web.browser.conftest import ARGUMENTS, chromium, go

WORDS_PER_MINUTE = 100
"""How fast a child reads that wants to understand what it reads; fluent silent reading is about twice as fast."""
ACT_S, LETTER_S, COUNT_S, WATCH_S = 5.0, 1.5, 2.0, 5.0
"""Finding and pressing something, typing a letter, counting one thing, looking at what has happened."""
ROOT = Path(__file__).parents[1]
LINK = re.compile(r"https?://\S+/enter\S*")
SEEN = """() => [...document.querySelectorAll("#content, .ms-nav, .ms-drawer, .ms-lesson, .ms-tour, .q-notification")]
  .filter((one) => one.checkVisibility()).flatMap((one) => one.innerText.split("\\n"))"""


class Pupil:
    """Reads, acts, and keeps count."""

    def __init__(self, page: Page, pictures: Path | None) -> None:
        self.page, self._pictures = page, pictures
        self.rows: list[tuple[str, int, int, float, float]] = []
        """What was done, words, acts, seconds of the pupil, seconds of the machine."""
        self._known = set[str]()
        self._words = self._acts = 0
        self._own_s = self._waited_s = 0.0

    def read(self) -> None:
        """Read what is in sight and was not before."""
        for line in self.page.evaluate(SEEN):
            plain = re.sub(r"[\d.,%]+", "", line).strip()
            if plain not in self._known:
                self._known.add(plain)
                self._words += len(re.findall(r"\w{2,}", plain))

    def read_again(self, place: Locator) -> None:
        """Read a sheet of the lesson, also what has been read elsewhere."""
        self._words += len(re.findall(r"\w{2,}", place.inner_text()))
        self.read()

    def press(self, what: Locator, until: Callable[[], object] = lambda: None) -> None:
        """Find something and press it; wait for what comes of it."""
        self._acts += 1
        began = time.monotonic()
        what.click()
        until()
        self._waited_s += time.monotonic() - began

    def type(self, field: Locator, text: str) -> None:
        """Type something into a field."""
        field.fill(text)
        self._acts += 1
        self._own_s += LETTER_S * len(text)

    def wait(self, until: Callable[[], object]) -> None:
        """Wait for the robot."""
        began = time.monotonic()
        until()
        self._waited_s += time.monotonic() - began

    def takes(self, seconds: float) -> None:
        """Something else that takes a while: to count, to look."""
        self._own_s += seconds

    def done(self, what: str) -> None:
        """End a row of the table."""
        own_s = self._own_s + self._words * 60 / WORDS_PER_MINUTE + self._acts * ACT_S
        self.rows.append((what, self._words, self._acts, own_s, self._waited_s))
        self._words = self._acts = 0
        self._own_s = self._waited_s = 0.0
        if self._pictures is not None:
            self.page.screenshot(path=self._pictures / f"{len(self.rows):02d}.png")


@contextmanager
def demo(folder: Path, *, make: bool) -> Iterator[tuple[str, float]]:
    """A demo, from nothing or from an environment that is there; its link, and how many seconds it took."""
    if make:
        subprocess.run(["git", "clone", "-q", str(ROOT), str(folder / "msbot")], check=True)
        command, place = ["make", "demo", "ARGS=--port 0"], folder / "msbot"
    else:
        command, place = [str(ROOT / ".venv/bin/msbot"), "demo", "--port", "0"], folder
    began = time.monotonic()
    process = subprocess.Popen(
        command, cwd=place, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, start_new_session=True
    )
    try:
        assert process.stdout is not None
        link = next(found[0] for line in process.stdout if (found := LINK.search(line)))
        took_s = time.monotonic() - began
        # The rest is read and thrown away: a demo whose pipe is full stands still.
        Thread(target=deque, args=(process.stdout, 0), daemon=True).start()
        yield link, took_s
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait()


def walk(pupil: Pupil, link: str) -> None:
    """The whole way."""
    page = pupil.page
    lesson = page.get_by_role("complementary", name="Lesson")

    def button(name: str) -> Locator:
        return page.get_by_role("button", name=name)

    def at(number: int) -> Callable[[], None]:
        return lambda: expect(lesson).to_contain_text(f"{number}/8")

    pupil.takes(ACT_S * 2)  # the terminal: find the link, open it
    pupil.wait(lambda: go(page, link))
    pupil.read()
    pupil.done("Open the link, look at the page")

    pupil.press(button("To the first lesson"), button("Begin: The first part").wait_for)
    pupil.read()
    pupil.done("To the first lesson; the list of lessons")

    pupil.press(button("Begin: The first part"), lambda: page.get_by_text("1. Look at the robot").wait_for())
    pupil.read()
    pupil.done("Begin the first lesson; read all of it")

    pupil.press(button("To the robot"), at(1))
    pupil.read_again(lesson)
    pupil.takes(10 * COUNT_S)
    pupil.type(lesson.get_by_label("Answer").first, "10")
    pupil.press(lesson.get_by_role("button", name="Answer"), at(2))
    pupil.read()
    pupil.done("1. Look at the robot")

    next_sheet = lesson.get_by_role("button", name="Next sheet")
    pupil.press(next_sheet, lambda: lesson.get_by_text("2. Plug it in", exact=True).wait_for())
    pupil.read_again(lesson)
    pupil.press(page.locator(".plug.ms-pointed"), at(3))
    pupil.takes(WATCH_S)
    pupil.read()
    pupil.done("2. Plug it in")

    pupil.press(next_sheet, lambda: lesson.get_by_text("3. Turn it", exact=True).wait_for())
    pupil.read_again(lesson)
    slider = page.get_by_role("dialog").get_by_role("slider")
    pupil.press(page.locator("[data-slot=knob]"), slider.wait_for)
    pupil.read()
    for share in (0.02, 0.98):
        turn(pupil, slider, share)
    pupil.wait(at(4))
    turn(pupil, slider, 0.0)
    choose(pupil, lesson, "it stands still", at(5))
    pupil.done("3. Turn it")

    pupil.press(next_sheet, lambda: lesson.get_by_text("4. Pull it out", exact=True).wait_for())
    pupil.read_again(lesson)
    pupil.press(page.get_by_role("dialog").get_by_role("button", name="Close"))
    pupil.press(page.locator(".plug.ms-pointed"), at(6))
    pupil.read()
    choose(pupil, lesson, "it went to its safe value, 0 %", at(7))
    pupil.done("4. Pull it out")

    pupil.press(next_sheet, lambda: lesson.get_by_text("5. Plug it in again", exact=True).wait_for())
    pupil.read_again(lesson)
    pupil.press(page.locator(".plug.ms-pointed"), at(8))
    pupil.read()
    pupil.done("5. Plug it in again")

    certificate = lesson.get_by_role("link", name="Certificate")
    pupil.press(certificate, lambda: page.get_by_text("has done the lesson").wait_for())
    pupil.read()
    pupil.done("The certificate")


def turn(pupil: Pupil, slider: Locator, share: float) -> None:
    """Pull a slider to a place."""
    box = slider.bounding_box()
    assert box is not None
    slider.click(position={"x": max(share * box["width"], 2), "y": box["height"] / 2})
    pupil.page.wait_for_timeout(WATCH_S * 1000)
    pupil.takes(ACT_S + WATCH_S)


def choose(pupil: Pupil, lesson: Locator, choice: str, until: Callable[[], object]) -> None:
    """Answer a question with choices."""
    pupil.press(lesson.get_by_role("combobox", name="Answer").first)
    option = pupil.page.get_by_role("option", name=choice)
    pupil.press(option)
    pupil.press(lesson.get_by_role("button", name="Answer").first, until)


def minutes(seconds: float) -> str:
    """`m:ss`."""
    return f"{int(seconds) // 60}:{round(seconds) % 60:02d}"


def main() -> None:
    """Walk, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--make", action="store_true", help="begin with `make demo` in a copy without .venv")
    parser.add_argument("--pictures", type=Path, help="a picture of each step goes there")
    parser.add_argument("--write", action="store_true", help="keep the table in bench/results")
    options = parser.parse_args()
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as folder,
        demo(Path(folder), make=options.make) as (link, took_s),
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        context = browser.new_context(viewport={"width": 1366, "height": 768}, locale="en-GB", reduced_motion="reduce")
        context.set_default_timeout(120_000)
        pupil = Pupil(context.new_page(), options.pictures)
        walk(pupil, link)
        browser.close()
    begin = "`make demo`, with setting up" if options.make else "`msbot demo`"
    rows = [(begin, 0, 1, ACT_S, took_s), *pupil.rows]
    lines = ["| step | words | acts | pupil | machine |", "|---|---|---|---|---|"]
    lines += [
        f"| {what} | {words} | {acts} | {minutes(own)} | {minutes(waited)} |" for what, words, acts, own, waited in rows
    ]
    total_s = sum(own + waited for _, _, _, own, waited in rows)
    sums = [sum(column) for column in zip(*(row[1:] for row in rows), strict=True)]
    lines += [f"| all: **{minutes(total_s)}** | {sums[0]} | {sums[1]} | {minutes(sums[2])} | {minutes(sums[3])} |", ""]
    lines += [
        f"{WORDS_PER_MINUTE} words a minute, {ACT_S:g} s an act, {LETTER_S:g} s a letter, {COUNT_S:g} s a card.",
        "",
        describe_machine(),
    ]
    print("\n".join(lines))
    if options.write:
        made_by = "python -m bench.first_lesson" + (" --make" if options.make else "") + " --write"
        write_result("first_lesson", "From make demo to the end of the first lesson", lines, made_by=made_by)


if __name__ == "__main__":
    main()
