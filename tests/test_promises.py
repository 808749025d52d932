"""Tries of promises are counted as they went: what failed did not hold, what was skipped was not tried."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

TESTS = """
import pytest

@pytest.mark.promise("holds")
def test_holds():
    pass

@pytest.mark.promise("holds")
def test_holds_many_times(record_property):
    record_property("tried", 15)
    record_property("held", 15)

@pytest.mark.promise("breaks")
def test_breaks():
    assert False

@pytest.mark.promise("breaks")
def test_breaks_sometimes(record_property):
    record_property("tried", 4)
    record_property("held", 3)

@pytest.mark.promise("cannot begin")
def test_cannot_begin(no_such_fixture):
    pass

@pytest.mark.promise("not here")
@pytest.mark.skipif(True, reason="no moon")
def test_not_here():
    pass

def test_of_nothing():
    assert False
"""


def test_tries_are_counted(tmp_path: Path) -> None:
    (tmp_path / "test_tried.py").write_text(TESTS)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = promise(sentence): tries a promise\n")
    root = Path(__file__).parent.parent
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-m",
        "promise",
        "-p",
        "tests.promises",
        "-p",
        "no:cacheprovider",
        "--promises",
        "counted.json",
        "--rootdir",
        ".",
        "test_tried.py",
    ]
    done = subprocess.run(
        command, cwd=tmp_path, env={"PYTHONPATH": str(root)}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stdout
    counted = json.loads((tmp_path / "counted.json").read_text())
    assert {promise: (tally["tried"], tally["held"], tally["skipped"]) for promise, tally in counted.items()} == {
        "holds": (16, 16, []),
        "breaks": (5, 3, []),
        "cannot begin": (1, 0, []),
        "not here": (0, 0, ["Skipped: no moon"]),
    }
