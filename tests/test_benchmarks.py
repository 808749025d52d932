"""How the tables of figures say they are made: a command that starts in the project's folder."""

from __future__ import annotations

import re
import subprocess

from tests import ROOT

COMMAND = re.compile(r"python3? (?:-u )?(?:-m bench\.(\w+)|(bench/\S+))")


def test_every_benchmark_that_is_named_is_started_as_a_module() -> None:
    named = subprocess.run(
        ["git", "grep", "-hE", "python3? (-u )?(-m )?bench[./]", "--", ".", ":!tests"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    found = [match for line in named.stdout.splitlines() for match in COMMAND.findall(line)]
    assert len(found) > 50
    assert [path for _, path in found if path] == []
    there = {
        path.stem for path in (ROOT / "bench").iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    assert {name for name, _ in found} <= there


def test_a_benchmark_starts_its_own_processes_as_modules_too() -> None:
    """By its path it would not find the other modules of `bench`."""
    texts = {path.name: path.read_text("utf-8") for path in (ROOT / "bench").glob("*.py")}
    assert [name for name, text in texts.items() if re.search(r"sys\.executable, (str\(Path\()?__file__", text)] == []
