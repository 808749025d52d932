"""Ctrl-C ends a command without a traceback, also while Python begins and while MsBOT is imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from msbot_agent.cli.exit_status import ExitStatus
from msbot_command import INTERRUPTED
from tools.set_up import BLOCKED, begin_quickly, can_block

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


MAKES_A_CLASS = """
import signal, sys, types

class Field:
    def __set_name__(self, owner, name):
        signal.raise_signal(signal.SIGINT)

def run():
    class Blueprint:
        timing = Field()

commands = types.ModuleType("msbot_agent.cli")
commands.main = run
sys.modules["msbot_agent.cli"] = commands
from msbot_command import main
main()
"""


def test_an_interrupt_of_which_python_makes_another_error_shows_no_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", MAKES_A_CLASS], capture_output=True, text=True, check=False)
    assert done.returncode == ExitStatus.INTERRUPTED, done.stderr
    assert done.stderr.count("\n") == 1


PROGRAM_WITH_A_CHILD = """
import signal, subprocess, sys, types

print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))
{interrupt}

def run():
    asks = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
    print(subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True).stdout, end="")

commands = types.ModuleType("msbot_agent.cli")
commands.main = run
sys.modules["msbot_agent.cli"] = commands
from msbot_command import main
main()
"""


@pytest.mark.skipif(not can_block(), reason="env of this computer starts no program with SIGINT blocked")
class TestStartedWithSigintBlocked:
    """As the script of `make` and that of Debian's package start Python."""

    def run(self, interrupt: str = "") -> subprocess.CompletedProcess[str]:
        code = PROGRAM_WITH_A_CHILD.format(interrupt=interrupt)
        command = [*BLOCKED, sys.executable, "-u", "-c", code]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    def test_what_the_command_starts_gets_it(self) -> None:
        assert self.run().stdout == "True\nFalse\n"

    def test_one_that_has_come_already_ends_the_command(self) -> None:
        done = self.run("import os; os.kill(os.getpid(), signal.SIGINT); print('goes on')")
        assert (done.returncode, done.stdout) == (ExitStatus.INTERRUPTED, "True\ngoes on\n")
        assert done.stderr == "msbot: broken off before it was done\n"

    @pytest.mark.promise(
        "Ctrl-C shows no traceback, not even while Python starts, where make or Debian made the command"
    )
    def test_the_script_begins_so(self, tmp_path: Path) -> None:
        script = tmp_path / "msbot"
        script.write_text(f"#!{sys.executable}\nimport sys\nfrom msbot_command import main\nsys.exit(main())\n")
        script.chmod(0o755)
        begin_quickly(script)
        # As long as Python is not further than reading `site`, whatever comes waits.
        (tmp_path / "sitecustomize.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGINT)")
        done = subprocess.run(
            [script, "library", "list"], env=path(tmp_path), capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout) == (ExitStatus.INTERRUPTED, "")
        assert done.stderr == "msbot: broken off before it was done\n"


def test_nothing_is_imported_before_the_hooks_are_there() -> None:
    code = "import sys; before = set(sys.modules); import msbot_command; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-S", "-c", code], capture_output=True, text=True, check=True, env=path())
    assert done.stdout.split() == ["__future__", "msbot_command"]


def path(*more: Path) -> dict[str, str]:
    """Where the module is, for a Python that reads no site-packages, behind other folders."""
    import msbot_command

    return {"PYTHONPATH": ":".join([*map(str, more), msbot_command.__file__.rpartition("/")[0]])}
