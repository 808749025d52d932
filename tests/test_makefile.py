"""Which Python the Makefile sets up .venv with."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parent.parent
TOOLS = ("make", "sh", "sed", "printf", "echo")

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """A folder with what the Makefile needs, and no Python."""
    folder = tmp_path / "tools"
    folder.mkdir()
    for name in TOOLS:
        (folder / name).symlink_to(shutil.which(name) or "")
    return folder


def python(folder: Path, *, pip: bool) -> Path:
    """A Python in a folder of its own, with or without pip."""
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "python3"
    refusal = 'case "$2" in *"import pip"*) exit 1 ;; esac' if not pip else 'set -- "$1" "$(echo "$2" | sed s/pip,//)"'
    program.write_text(f'#!/bin/sh\n{refusal}\nexec {sys.executable} "$@"\n')
    program.chmod(0o755)
    return program


def chosen(*path: Path, environment: Path | None = None, project: Path = PROJECT) -> str:
    """What the Makefile takes when these folders are searched and this environment is activated."""
    ask = "include Makefile\nshow-python:\n\t@echo '$(PYTHON)'\n"
    variables = {"PATH": ":".join(map(str, path))} | ({"VIRTUAL_ENV": str(environment)} if environment else {})
    done = subprocess.run(
        [shutil.which("make") or "make", "-s", "-f", "-", "show-python"],
        input=ask,
        env=variables,
        cwd=project,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_an_activated_environment_without_pip_does_not_hide_the_systems_python(tmp_path: Path, tools: Path) -> None:
    active = python(tmp_path / "env/bin", pip=False)
    system = python(tmp_path / "system", pip=True)
    assert chosen(active.parent, system.parent, tools, environment=tmp_path / "env") == str(system)


def test_the_systems_python_goes_before_that_of_an_activated_environment(tmp_path: Path, tools: Path) -> None:
    active = python(tmp_path / "env/bin", pip=True)
    system = python(tmp_path / "system", pip=True)
    assert chosen(active.parent, system.parent, tools, environment=tmp_path / "env") == str(system)


def test_the_python_of_an_activated_environment_is_better_than_none(tmp_path: Path, tools: Path) -> None:
    active = python(tmp_path / "env/bin", pip=True)
    assert chosen(active.parent, tools, environment=tmp_path / "env") == str(active)


def test_without_pip_anywhere_a_python_is_named_all_the_same(tmp_path: Path, tools: Path) -> None:
    system = python(tmp_path / "system", pip=False)
    assert chosen(system.parent, tools) == str(system)


def test_where_there_is_no_python_there_is_none(tools: Path) -> None:
    assert chosen(tools) == ""


@pytest.mark.parametrize("name", ["Meyer, Anna", "Kathe's", 'a "b" $(c) `d`', "50% & more; #1"])
def test_a_folder_may_have_any_name(name: str, tmp_path: Path, tools: Path) -> None:
    folder = tmp_path / name
    own = python(folder / ".venv/bin", pip=False)
    system = python(tmp_path / "system", pip=True)
    shutil.copy(PROJECT / "Makefile", folder)
    assert chosen(own.parent, system.parent, tools, environment=folder / ".venv", project=folder) == str(system)


def test_a_python_that_is_too_old_is_told_of(tmp_path: Path) -> None:
    shutil.copy(PROJECT / "Makefile", tmp_path)
    old = tmp_path / "python3.10"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    done = subprocess.run(
        ["make", "-s", f"PYTHON={old}", ".venv/bin/python"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode
    assert done.stderr.startswith(f"MsBOT needs Python 3.11 or newer, and {old} is older or does not run. Call: make ")
