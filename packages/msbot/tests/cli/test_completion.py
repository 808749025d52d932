"""`msbot completion`: what the shells are given works."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from msbot_agent.cli import COMMANDS

MSBOT = str(Path(sys.executable).with_name("msbot"))


def run(*arguments: str, **variables: str) -> str:
    environment = os.environ | variables
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("msbot se", {"set", "service"}),
        ("msbot ", set(COMMANDS)),
        ("msbot library s", {"search", "show"}),
        ("msbot parts --js", {"--json"}),
    ],
)
def test_commands_and_options_are_completed(words: str, wanted: set[str]) -> None:
    number = str(words.count(" "))
    lines = run(MSBOT, _MSBOT_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD=number).splitlines()
    assert {line.partition(",")[2] for line in lines} == wanted


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_takes_its_script(shell: str, tmp_path: Path) -> None:
    script = run(MSBOT, "completion", shell)
    assert script.startswith(("# Put into", "# Once"))
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (tmp_path / "script").write_text(script)
    run(shell, "-n", str(tmp_path / "script"))
