"""What each test costs: `python -m pytest -p tests.cost PATHS` ends with processor seconds by folder, file and test.

Counted are user and system time of the test's process and of everything below it, its fixtures included; a fixture
that several tests share is paid by the first of them. Waiting costs nothing, so the figures hold on a busy machine too.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections import defaultdict
from collections.abc import Generator
from glob import glob
from pathlib import PurePosixPath
from time import monotonic

import pytest

CHILD_SUBREAPER = 36
"""PR_SET_CHILD_SUBREAPER of prctl(2)."""
LONGEST = 40
"""Rows of the tables of files and of tests."""
TICK_S = 1 / os.sysconf("SC_CLK_TCK")


def cpu_s() -> float:
    """Processor time of this process and its ended children, and of its children that still run."""
    spent = os.times()
    return sum(spent[:4]) + sum(map(_tree_s, _children(os.getpid())))


def _tree_s(pid: int) -> float:
    fields = _read(f"/proc/{pid}/stat").rpartition(")")[2].split()
    if not fields:  # it has ended meanwhile: its parent has its time now
        return 0.0
    return sum(map(int, fields[11:15])) * TICK_S + sum(map(_tree_s, _children(pid)))


def _children(pid: int) -> list[int]:
    return [int(child) for task in glob(f"/proc/{pid}/task/*/children") for child in _read(task).split()]


def _read(path: str) -> str:
    """A file of /proc; nothing when its process has ended."""
    try:
        with open(path) as file:
            return file.read()
    except (FileNotFoundError, ProcessLookupError):
        return ""


class Cost:
    """Measures where the tests run, and adds up where the summary is written."""

    def __init__(self) -> None:
        self._began = (0.0, 0.0)
        self._tests: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        self._began = (cpu_s(), monotonic())
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        now = (cpu_s(), monotonic())
        vars(report).update(cost=[end - began for began, end in zip(self._began, now, strict=True)])
        self._began = now
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        spent = getattr(report, "cost", (0.0, report.duration))  # in a virtual machine: only its duration is known
        row = self._tests[report.nodeid]
        row[:] = [a + b for a, b in zip(row, spent, strict=True)]

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        files: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
        folders: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
        for name, spent in self._tests.items():
            path = PurePosixPath(name.partition("::")[0])
            for row in (files[str(path)], *(folders[f"{folder}/"] for folder in path.parents)):
                row[:] = [a + b for a, b in zip(row, spent, strict=True)]
        for title, rows in (("folder", folders), ("file", files), ("test", self._tests)):
            terminalreporter.section(f"cost by {title}: processor s, real s")
            dearest = sorted(rows.items(), key=lambda row: -row[1][0])
            for name, (processor, real) in dearest if title == "folder" else dearest[:LONGEST]:
                terminalreporter.write_line(f"{processor:8.2f} {real:8.2f}  {name}")


def pytest_configure(config: pytest.Config) -> None:
    """Count in this session."""
    if sys.platform == "linux":  # what outlives its parent, as parts of a browser do, stays below this process
        ctypes.CDLL(None).prctl(CHILD_SUBREAPER, 1, 0, 0, 0)
    config.pluginmanager.register(Cost())
