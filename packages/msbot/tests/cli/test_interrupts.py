"""Ctrl-C ends a command without a traceback, also while MsBOT is imported."""

from __future__ import annotations

import subprocess
import sys

import pytest

from msbot_agent.cli.exit_status import ExitStatus
from msbot_command import INTERRUPTED

PROGRAM = """
import signal, sys
sys.argv = ["msbot", "library", "list"]
left = {left}

def count(event, _):
    global left
    if event == "import":
        left -= 1
        if left == 0:
            signal.raise_signal(signal.SIGINT)

from msbot_command import main
sys.addaudithook(count)
main()
"""
"""Interrupts itself at one of its imports."""


def test_the_status_is_that_of_the_table() -> None:
    assert INTERRUPTED == ExitStatus.INTERRUPTED


@pytest.mark.parametrize("left", [1, 2, 7, 30, 90, 150, 210])
def test_an_interrupt_in_an_import_shows_no_traceback(left: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(left=left)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode in (ExitStatus.INTERRUPTED, -2), done.stderr
    assert "Traceback" not in done.stderr
    assert "ignored" not in done.stderr


def test_nothing_is_imported_before_the_hooks_are_there() -> None:
    code = "import sys; before = set(sys.modules); import msbot_command; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-S", "-c", code], capture_output=True, text=True, check=True, env=path())
    assert done.stdout.split() == ["__future__", "msbot_command"]


def path() -> dict[str, str]:
    """Where the module is, for a Python that reads no site-packages."""
    import msbot_command

    return {"PYTHONPATH": msbot_command.__file__.rpartition("/")[0]}
