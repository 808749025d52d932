"""A plugin of pytest that notes which functions of `msbot` each test calls, and what it costs.

    PYTHONPATH=. python -m pytest -p bench.mutating.called --called FILE.json PATHS

Only calls are looked at, not lines, so that the tests take little longer than usual. What other processes call is not
seen. A test that fails or is skipped is not noted.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Generator
from pathlib import Path
from types import CodeType, FrameType

import pytest
from hypothesis import settings

EXAMPLES = 8
"""Random cases of a property: which functions are called is seen soon."""


class Called:
    """What has been noted so far."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._codes: dict[int, CodeType] = {}
        self.tests: dict[str, tuple[float, list[str]]] = {}
        """By test: processor seconds, and the functions as `msbot/xrce/....py Class.method`."""

    def _trace(self, frame: FrameType, _event: str, _argument: object) -> None:
        self._codes[id(frame.f_code)] = frame.f_code

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Note what one test calls, its fixtures included."""
        self._codes.clear()
        began = time.process_time()
        self._passed = False
        threading.settrace(self._trace)
        sys.settrace(self._trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)
            if self._passed:
                named = {_name(code) for code in self._codes.values() if "/src/msbot/" in code.co_filename}
                self.tests[item.nodeid] = (time.process_time() - began, sorted(named))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Whether it passed."""
        if report.when == "call":
            self._passed = report.passed

    def pytest_sessionfinish(self) -> None:
        """Write it down."""
        self._file.write_text(json.dumps(self.tests))


def _name(code: CodeType) -> str:
    path = "msbot" + code.co_filename.partition("/src/msbot")[2]
    return f"{path} {code.co_qualname}"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where to write it."""
    parser.addoption("--called", type=Path, required=True)


def pytest_configure(config: pytest.Config) -> None:
    """Begin, with few random cases."""
    settings.register_profile("called", deadline=None, max_examples=EXAMPLES)
    config.pluginmanager.register(Called(config.getoption("called")))


def pytest_sessionstart() -> None:
    """After the project's own profile."""
    settings.load_profile("called")
