"""The page Program puts a program on a board: its own code is what is tested, in a real browser.

`navigator.serial` is a double, because a browser without a screen has nobody who chooses a port: it carries octets
between the page and the simulated board (MicroPython's VM behind a pseudo terminal).
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from msbot.carried.carried_files import OF_GENERIC_BOARDS, package_files
from tests.homes.runners import NODE
from tests.homes.simulated_board import SimulatedBoard, simulated_board
from tests.web.browser.accessible import hurdles_by_day_and_night
from tests.web.browser.test_program_page import WORK_MS, expect_said, lesson, open_desk, press, write

__all__ = ["lesson", "open_desk"]

pytestmark = pytest.mark.skipif(NODE is None, reason="needs node")

SERIAL = """
class Port {
  async open() {
    if (!(await boardOpen())) throw new Error("Failed to open serial port.");
    let isOpen = true;  // who has closed it takes nothing from who opens it next
    this.readable = new ReadableStream({ async pull(controller) {
      while (isOpen) {
        const octets = await boardRead();
        if (!isOpen) return;
        if (octets === null) return controller.error(new Error("The device has been lost."));
        if (octets.length) return controller.enqueue(new Uint8Array(octets));
        await new Promise((done) => setTimeout(done, 3));
      }
    }, cancel() { isOpen = false; } });
    this.writable = new WritableStream({ write: (octets) => boardWrite(Array.from(octets)) });
  }
  async close() {}
}
Object.defineProperty(navigator, "serial", { value: { requestPort: async () => new Port() } });
"""


class Cable:
    """Octets between a page and a port; it can be pulled."""

    def __init__(self, page: Page, port: str) -> None:
        self._port = port
        self._end: int | None = None
        self.pull_after: int | None = None
        """After so many octets to the board, the cable is out."""
        self.can_open = True
        page.expose_function("boardOpen", self._open)
        page.expose_function("boardRead", self._read)
        page.expose_function("boardWrite", self._write)
        page.evaluate(SERIAL)

    def _open(self) -> bool:
        if self.can_open and self._end is None:
            self._end = os.open(self._port, os.O_RDWR | os.O_NOCTTY)
        return self.can_open

    def _read(self) -> list[int] | None:
        if self._end is None:
            return None
        return list(os.read(self._end, 4096)) if select.select([self._end], [], [], 0)[0] else []

    def _write(self, octets: list[int]) -> None:
        if self._end is None:
            raise OSError("The device has been lost.")
        os.write(self._end, bytes(octets))
        if self.pull_after is not None:
            self.pull_after -= len(octets)
            if self.pull_after <= 0:
                self.close()

    def close(self) -> None:
        if self._end is not None:
            os.close(self._end)
            self._end = None


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as the page would put it on a board of this version."""
    folder = tmp_path_factory.mktemp("lib")
    for name, octets in package_files(6).items():
        (folder / name).write_bytes(octets)
    return folder


@contextlib.contextmanager
def plugged(page: Page, **settings: object) -> Iterator[tuple[SimulatedBoard, Cable]]:
    with simulated_board(**settings) as board:
        cable = Cable(page, board.port)
        try:
            press(page, "Put on a board")
            yield board, cable
        finally:
            cable.close()


def choose(page: Page) -> None:
    press(page, "Choose the port and write")


def expect_told(page: Page, words: str) -> None:
    expect(page.locator("#ms-board-state")).to_contain_text(words, timeout=WORK_MS)


def test_a_program_is_put_on_a_board_and_says_what_it_does_in_the_console(
    open_desk: Callable[..., Page],
    compiled: Path,
) -> None:
    page = open_desk("?name=01_hello.py")
    write(page, 'import msbot\n\nprint("I run on", "the board")\nundefined\n')
    with plugged(page, lib=str(compiled), files={"/lib/msbot/old.py": ""}) as (board, cable):
        page.locator("#ms-board-link").fill("ws://192.168.1.20:8080")
        page.get_by_text("Wi-Fi and API token").click()
        page.locator("#ms-board-token").fill("msbot_abc")
        page.locator("#ms-board-wifi").fill("school")
        page.locator("#ms-board-password").fill("secret")
        assert hurdles_by_day_and_night(page) == []
        choose(page)
        expect_told(page, "01_hello.py runs on the board now, and whenever it starts; 3 files were written.")
        expect_said(page, "I run on the board")
        expect_said(page, "NameError: name 'undefined' isn't defined")
        page.get_by_role("button", name="line 4").click()
        expect(page.locator(".ms-wrong-line")).to_be_visible()

        choose(page)  # once more: nothing is different
        expect_told(page, "0 files were written.")
        press(page, "Put on a board")  # leaves it
        expect(page.locator("#ms-board")).to_be_hidden()
        cable.close()
        from msbot.cli.board.board_connection import open_board

        with open_board(board.port) as one:
            link = {"link": "ws://192.168.1.20:8080", "wifi": ["school", "secret"], "token": "msbot_abc"}
            assert json.loads(one.read("/msbot.json")) == link
            assert one.read("/main.py") == b'import msbot\n\nmsbot.start("01_hello.py")\n'
            assert "old.py" not in one.files("/lib/msbot")


@pytest.mark.parametrize("paste", ["no", "unknown"])
def test_a_board_without_raw_paste_gets_its_program_by_plain_raw_mode(
    open_desk: Callable[..., Page], compiled: Path, tmp_path: Path, paste: str
) -> None:
    """What is there is not written again, what is older is, and what only a generic board needs is left out."""
    library = tmp_path / "lib"
    shutil.copytree(compiled, library, ignore=shutil.ignore_patterns(*(f"{name}.mpy" for name in OF_GENERIC_BOARDS)))
    (library / "words.mpy").write_bytes(b"an older one")
    page = open_desk("?name=01_hello.py")
    text = 'print("I have", 200, "lines")\n' + "".join(f"# line {number} of many\n" for number in range(199))
    write(page, text)
    with plugged(page, lib=str(library), paste=paste) as (board, cable):
        page.locator("#ms-board-link").fill("serial:1")
        choose(page)
        expect_told(page, "01_hello.py runs on the board now, and whenever it starts; 4 files were written.")
        expect_said(page, "I have 200 lines")
        press(page, "Put on a board")  # leaves it
        cable.close()
        from msbot.cli.board.board_connection import open_board

        with open_board(board.port) as one:
            assert one.read("/01_hello.py") == text.encode()
            assert {name.partition(".")[0] for name in one.files("/lib/msbot")} & OF_GENERIC_BOARDS == set()


def test_what_can_go_wrong_at_a_board_is_one_sentence(open_desk: Callable[..., Page], compiled: Path) -> None:
    page = open_desk("?name=01_hello.py")
    with plugged(page, lib=str(compiled), flash=160_000) as (_, cable):
        choose(page)
        expect_told(page, "The board does not know its way to the master yet")
        page.locator("#ms-board-link").fill("serial:1")
        cable.pull_after = 400
        choose(page)
        expect_told(page, "The board was unplugged.")
        cable.pull_after = None
        cable.can_open = False
        choose(page)
        expect_told(page, "The port cannot be opened: does another program use it? (Failed to open serial port.)")
        cable.can_open = True
        write(page, "#" * 120_000)
        choose(page)
        expect_told(page, "kB more are needed. Nothing was written.")
        page.evaluate("() => { navigator.serial.requestPort = async () => { throw new DOMException('none'); }; }")
        choose(page)
        expect_told(page, "No port was chosen.")


def test_what_is_no_board_or_says_nothing_is_one_sentence(open_desk: Callable[..., Page]) -> None:
    page = open_desk("?name=01_hello.py")
    page.evaluate("() => { const real = setTimeout; setTimeout = (run, ms) => real(run, ms >= 5000 ? 300 : ms); }")
    page.evaluate("() => { window.boardOpen = async () => true; window.says = []; window.waiting = []; }")
    page.evaluate("() => { window.boardWrite = async () => { waiting.push(...says); }; }")
    page.evaluate("() => { window.boardRead = async () => waiting.splice(0, 64); }")
    page.evaluate(SERIAL)
    press(page, "Put on a board")
    choose(page)
    expect_told(page, "The board does not answer, not even to Ctrl-C")
    page.evaluate("() => { says = Array.from(new TextEncoder().encode('Grbl 1.1h')); }")
    choose(page)
    expect_told(page, "What is at this port does not answer as MicroPython does: Grbl 1.1h")
    page.evaluate("() => { window.nap = () => new Promise((done) => setTimeout(done, 3)); }")
    page.evaluate("() => { window.boardRead = async () => (await nap(), Array(4096).fill(65)); }")  # without end
    choose(page)
    expect_told(page, "What is at this port does not answer as MicroPython does: AAA")


def test_a_browser_without_web_serial_is_shown_the_command(open_desk: Callable[..., Page]) -> None:
    page = open_desk("?name=01_hello.py")
    page.evaluate("delete Object.getPrototypeOf(navigator).serial")
    press(page, "Put on a board")
    expect(page.locator("#ms-board-none")).to_contain_text("msbot board run 01_hello.py --link ADDRESS")
    expect(page.locator("#ms-board-put")).to_be_hidden()
