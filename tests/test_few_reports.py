"""What workers tell of their tests: whatever did not go well, and of the rest as much as is read."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests import few_reports

NOTES = """
import os

def pytest_runtest_logreport(report):
    if "PYTEST_XDIST_WORKER" not in os.environ:
        print(report.nodeid.rpartition("::")[2], report.when, file=open(__file__ + ".heard", "a"))
"""
TESTS = """
import pytest

@pytest.fixture
def broken():
    raise OSError("before")

@pytest.fixture
def breaking():
    yield
    raise OSError("afterwards")

def test_good(): pass
def test_bad(): assert not "bad"
def test_broken(broken): pass
def test_breaking(breaking): pass
@pytest.mark.skip("for want of time")
def test_skipped(): pass
@pytest.mark.xfail
def test_known(): assert not "known"
"""


def test_a_pass_is_one_report_and_whatever_did_not_go_well_is_told(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(NOTES)
    (tmp_path / "test_some.py").write_text(TESTS)
    words = ["-m", "pytest", "-n", "1", "-rA", "-p", "no:cacheprovider", "-p", "tests.few_reports"]
    here = ["-W", "ignore", "--rootdir", str(tmp_path), "-c", "/dev/null", str(tmp_path / "test_some.py")]
    root = Path(__file__).parents[1]
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}  # of this run
    command = [sys.executable, *words, *here]
    done = subprocess.run(command, cwd=root, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 failed, 2 passed, 1 skipped, 1 xfailed, 2 errors" in done.stdout
    for said in (
        "ERROR at setup of test_broken",
        "OSError: before",
        "ERROR at teardown of test_breaking",
        "OSError: afterwards",
        "for want of time",
        "::test_good",
    ):
        assert said in done.stdout
    assert (tmp_path / "conftest.py.heard").read_text().splitlines() == [
        "test_good call",
        "test_bad call",
        "test_broken setup",
        "test_breaking call",
        "test_breaking teardown",
        "test_skipped setup",
        "test_known call",
    ]


@pytest.mark.parametrize(
    ("durations", "xmlpath", "plugins", "wanted"),
    [
        (None, None, {"xdist"}, True),
        (0, None, {"xdist"}, False),
        (None, "results.xml", {"xdist"}, False),
        (None, None, {"xdist", "tests.cost"}, False),
    ],
)
def test_who_reads_all_gets_all(durations: int | None, xmlpath: str | None, plugins: set[str], wanted: bool) -> None:
    manager = SimpleNamespace(hasplugin=plugins.__contains__)
    option = SimpleNamespace(durations=durations, xmlpath=xmlpath)
    node: Any = SimpleNamespace(workerinput={}, config=SimpleNamespace(option=option, pluginmanager=manager))
    few_reports.pytest_configure_node(node)
    assert node.workerinput == {few_reports.WANTED: wanted}
