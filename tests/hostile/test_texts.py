"""Texts made to cost a reader its time or its memory: each is refused within what a small computer can spare.

The limits are those of the system for a process, not a clock: 3 s of processor time, and 250 MB of memory beyond what
the program itself takes.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from msbot.config import InvalidFileError, load_library, parse_blueprint
from tests.e2e.processes import run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="this system limits no other process")

CPU_S = 3
MEMORY = 250 << 20
MOST_TOLD = 40_000
"""Characters of all that is said about one text."""

ROBOT = '[robot]\nname = "R"\n[[slot]]\nname = "AA"\npart = "ABCD"\n'
SLOTS = "".join(f'[[slot]]\nname = "s{number:030}"\npart = "ABCD"\n' for number in range(3500))


TEXTS = {
    "a key of 20,000 steps": "a." * 20_000 + "a = 1",
    "a megabyte of dots": "a." * (512 * 1024) + "a = 1",
    "many long keys": "".join(f"{'k.' * 500}k{number} = 1\n" for number in range(200)),
    "many keys of eight steps": "".join(f"a{number}.b.c.d.e.f.g.h = 1\n" for number in range(9000)),
    "a header of many steps": f"[{'a.' * 60_000}a]",
    "lists in lists": "a = " + "[" * 100_000,
    "closed lists in lists": "a = " + "[" * 50_000 + "]" * 50_000,
    "tables in tables": "a = " + "{ b = " * 20_000,
    "a list of a hundred thousand": f"a = [{'1,' * 100_000}]",
    "a hundred thousand lines": "\n" * 100_000,
    "wrong slots": ROBOT + '[[slot]]\nname = ""\npart = "A"\n' * 4500,
    "slots of unknown parts": ROBOT + "".join(f'[[slot]]\nname = "s{n}"\npart = "ABCE{n}"\n' for n in range(6000)),
    "one slot many times": ROBOT + '[[slot]]\nname = "AA"\npart = "ABCD"\n' * 6000,
    "wires to slots that are almost there": SLOTS
    + "".join(f'[[binding]]\ntopic = "t{n}"\ntype = "Level"\nfrom = "t{n:030}.out"\nto = []\n' for n in range(500)),
    "one receiver many times": ROBOT
    + f'[[binding]]\ntopic = "t"\ntype = "HelloWorld"\nfrom = "AA.out"\nto = [{chr(34)}AA.in{chr(34)},'
    + '"AA.in",' * 15_000
    + "]\n",
    "unknown keys": ROBOT + "".join(f"k{number} = 1\n" for number in range(15_000)),
    "long unknown keys": ROBOT + "".join(f"{'k' * 4000}{number} = 1\n" for number in range(60)),
    "a text without end": f'{ROBOT}a = "{"x" * 200_000}',
    "quotes without end": '"""' * 80_000,
    "single quotes": "'" * 250_000,
    "backslashes": f'a = "{chr(92) * 200_001}"',
    "a number of 200,000 digits": f"a = {'9' * 200_000}",
    "a long name": ROBOT.replace('"R"', f'"{"R" * 200_000}"'),
    "orders to the terminal": ROBOT.replace('"R"', r'" \u001b[2J\u001b[31m\nmsbot: all is well"'),
    "orders in a key": ROBOT + r'"\u001b[2J" = 1',
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS.keys())
@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
def test_a_hostile_blueprint_is_refused_quickly_and_in_few_words(text: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    done = check(path)
    assert done.returncode == 2, done
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("msbot: ")
    assert len(done.stderr) < MOST_TOLD
    assert "\x1b" not in done.stderr
    assert "\nmsbot: all is well" not in done.stderr


@pytest.mark.parametrize("name", ["many keys of eight steps", "unknown keys", "quotes without end", "orders in a key"])
@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
def test_a_hostile_library_file_is_refused_quickly_and_in_few_words(name: str, tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/own.toml").write_text(TEXTS[name])
    (tmp_path / "robot.toml").write_text(ROBOT)
    done = check(tmp_path / "robot.toml", "--library", str(tmp_path / "parts"))
    assert done.returncode == 2, done
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < MOST_TOLD
    assert "\x1b" not in done.stderr


@pytest.mark.parametrize(
    "text",
    [
        "x" * 40_000_000,
        "(1.0) can0 123#" + "11" * 5_000_000,
        "\x1b[2J\x1b[31m\n" * 100_000,
        "(1.0) can\x1b[2J0 123#11\n" * 10,
        "\n" * 3_000_000,
    ],
    ids=["one long line", "one long frame", "orders to the terminal", "orders in a channel", "empty lines"],
)
@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
def test_a_hostile_log_is_read_line_by_line_and_its_orders_are_not_passed_on(text: str, tmp_path: Path) -> None:
    (tmp_path / "bus.log").write_text(text)
    done = run_limited("bus", "decode", str(tmp_path / "bus.log"))
    assert done.returncode in (0, 2), done
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < MOST_TOLD
    assert "\x1b" not in done.stdout + done.stderr


def test_at_most_fifty_mistakes_are_told() -> None:
    with pytest.raises(InvalidFileError) as caught:
        parse_blueprint(TEXTS["wrong slots"], load_library())
    assert len(caught.value.problems) == 50
    assert str(caught.value).startswith("50 problems were found, and perhaps more behind them:")


def check(path: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return run_limited("check", str(path), *options)


def run_limited(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command in a process that the system ends when it uses too much."""
    return run(*arguments, timeout_s=100, limits=(CPU_S, MEMORY))
