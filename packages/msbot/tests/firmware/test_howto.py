"""The page "Set up an STM32", followed to the letter as far as a computer without a board can."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests import ROOT
from tests.e2e.processes import run, running
from tests.e2e.test_processes import free_port
from tests.firmware.building import SOURCES, need

PAGE = (ROOT / "docs" / "howto" / "stm32.md").read_text()
PATIENCE_S = 60.0


def commands(heading: str) -> list[str]:
    """The lines of the code blocks below a heading, without comments."""
    section = PAGE.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    blocks = re.findall(r"```\n(.*?)```", section, re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [re.sub(r"\s+# .*", "", line) for line in lines]


def only(lines: list[str], words: str) -> str:
    """The one line that has these words."""
    (found,) = [line for line in lines if words in line]
    return found


def copy(folder: Path) -> Path:
    """The firmware in a folder of the test's own."""
    shutil.copytree(SOURCES, folder / "c")
    return folder / "c"


def shell(line: str, folder: Path) -> None:
    """Do a line of the page."""
    result = subprocess.run(
        line, shell=True, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (result.returncode, result.stderr) == (0, ""), line


class Terminal:
    """A program in a terminal of its own."""

    def __init__(self, line: str, folder: Path) -> None:
        self._process = subprocess.Popen(
            shlex.split(line), cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        self._said = ""
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while octets := self._process.stdout.read1(1000):  # type: ignore[attr-defined]  # of BufferedReader
            with self._news:
                self._said += octets.decode()
                self._news.notify_all()

    def wait_for(self, pattern: str) -> str:
        """Wait until it shows this; what it has shown before counts no more."""
        with self._news:
            assert self._news.wait_for(lambda: re.search(pattern, self._said), PATIENCE_S), (pattern, self._said)
            found = re.search(pattern, self._said)
            assert found is not None
            self._said = self._said[found.end() :]
            return found[0]

    def type(self, text: str) -> None:
        """Type something."""
        assert self._process.stdin is not None
        self._process.stdin.write(text.encode())
        self._process.stdin.flush()

    def end(self) -> None:
        """Close it."""
        self._process.kill()
        self._process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()


@contextmanager
def terminal(line: str, folder: Path) -> Iterator[Terminal]:
    """A program that is ended with the block."""
    found = Terminal(line, folder)
    try:
        yield found
    finally:
        found.end()


def test_the_board_is_built(tmp_path: Path) -> None:
    need("arm-none-eabi-gcc")
    folder = copy(tmp_path)
    lines = commands("3. Build and flash")
    for line in (only(lines, "gcc"), only(lines, "objcopy")):
        shell(line, folder)
    assert 10_000 < (folder / "board.bin").stat().st_size < 30_000
    assert " board.bin 0x08000000" in only(lines, "st-flash write")


def test_without_a_board_the_emulated_one_joins_and_is_driven_by_the_commands_of_the_page(tmp_path: Path) -> None:
    need("arm-none-eabi-gcc", "qemu-system-arm")
    folder = copy(tmp_path)
    lines = commands("Without a board")
    shell(only(lines, "arm-none-eabi-gcc"), folder)
    shell(only(lines, "linux_socketcan"), folder)
    at = folder / "examples"
    udp = f"udp:127.0.0.1:{free_port()}"

    def words(line: str) -> list[str]:
        return shlex.split(line.replace("/dev/pts/5", bus).replace("udp:127.0.0.1:8888", udp))[1:]

    with ExitStack() as stack:
        board = stack.enter_context(terminal(only(lines, "qemu-system-arm -M"), folder))
        bus = board.wait_for(r"/dev/pts/\d+")
        master = stack.enter_context(running(*words(only(lines, "msbot master")), "--no-page", cwd=at))
        master.wait_for("board: checking -> active")
        relay = stack.enter_context(running(*words(only(lines, "msbot part RELAY-1")), "--link", udp, cwd=at))
        relay.wait_for("is active")
        # Not on the page: on a busy computer a part may be out for a moment, and what it says then is said again.
        assert run("set", "board", "repeat_s", "0.2", cwd=at).returncode == 0
        board.type("1")
        relay.wait_for("coil true")
        assert run(*words(only(lines, "msbot set")), cwd=at).returncode == 0
        board.wait_for("1")
        relay.wait_for("coil false")
