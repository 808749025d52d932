"""A robot goes on, and a command ends in one sentence, where nothing can be printed: a full disk, a closed stream."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

DEMO = "demo --robot thesis --no-page --rec off --seconds 0.5"


def shell(line: str, folder: Path) -> tuple[int, str]:
    """The status of a line of a shell, in which MSBOT is the command, and what it said on standard error."""
    done = subprocess.run(
        ["sh", "-c", "exec " + line.replace("MSBOT", f"{sys.executable} -m msbot")],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("where", "said"),
    [
        (">/dev/full", "standard output takes nothing any more (No space left on device): its lines are lost\n"),
        (">/dev/full 2>&1", ""),
        (">&-", ""),
        ("<&- >&- 2>&-", ""),
    ],
    ids=["full disk", "both on a full disk", "output closed", "all closed"],
)
def test_a_robot_goes_on(where: str, said: str, tmp_path: Path) -> None:
    assert shell(f"MSBOT {DEMO} {where}", tmp_path) == (0, said)


@pytest.mark.parametrize("what", ["library list", "--help", "init --help"])
def test_a_command_says_in_one_sentence_that_its_answer_had_no_room(what: str, tmp_path: Path) -> None:
    status, errors = shell(f"MSBOT {what} >/dev/full", tmp_path)
    assert status == 2
    assert errors.startswith("msbot: ")
    assert errors.endswith(": No space left on device\n")
    assert errors.count("\n") == 1


def test_a_stream_that_is_closed_does_not_lend_its_number(tmp_path: Path) -> None:
    program = (
        "import os, socket, sys; from msbot_agent.process.nonblocking_output import fill_closed_streams;"
        "fill_closed_streams(); print('lost'); print('lost', file=sys.stderr);"
        "one = socket.socket(); null = os.stat(os.devnull).st_rdev;"
        "open('seen', 'w').write(repr((one.fileno() > 2, [os.fstat(n).st_rdev == null for n in range(3)],"
        "sys.stdin.read())))"
    )
    done = subprocess.run(
        ["sh", "-c", 'exec "$0" -c "$1" <&- >&- 2>&-', sys.executable, program], cwd=tmp_path, timeout=60, check=False
    )
    assert done.returncode == 0
    assert (tmp_path / "seen").read_text() == "(True, [True, True, True], '')"
