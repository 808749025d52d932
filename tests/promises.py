"""How often each promise was tried and held: `python -m pytest -m promise -p tests.promises --promises FILE`.

A test that tries a promise of the docs carries its sentence, `@pytest.mark.promise("STOP holds after kill -9")`. One
run of the test is one try, and it held if the test passed; a test that tries more often in one run says so with
`record_property("tried", 15)` and `record_property("held", 15)`. `bench/promises.py` makes the table.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import pytest

PROPERTY = "promise"


@dataclass(slots=True)
class Tally:
    """What the tests of one promise have shown."""

    tried: int = 0
    held: int = 0
    tests: list[str] = field(default_factory=list)
    """The files of the tests, each once."""
    skipped: list[str] = field(default_factory=list)
    """Why tests could not be run here, each reason once."""


class Promises:
    """Adds up the reports of all workers by promise."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._tallies: dict[str, Tally] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count a test that ran, and one that could not even begin; a skipped one is named."""
        properties: Mapping[str, object] = dict(report.user_properties)
        promise = properties.get(PROPERTY)
        if promise is None or (report.when != "call" and report.passed):
            return
        tally = self._tallies.setdefault(str(promise), Tally())
        file = report.nodeid.partition("::")[0]
        if report.skipped:
            reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
            if reason not in tally.skipped:
                tally.skipped.append(reason)
            return
        if file not in tally.tests:
            tally.tests.append(file)
        tried = int(str(properties.get("tried", 1)))
        tally.tried += tried
        if report.passed:
            tally.held += int(str(properties.get("held", tried)))

    def pytest_sessionfinish(self) -> None:
        """Write what was counted."""
        self._path.write_text(json.dumps({promise: asdict(tally) for promise, tally in self._tallies.items()}))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where the counts go."""
    parser.addoption("--promises", type=Path, metavar="FILE", help="write how often each promise was tried and held")


def pytest_configure(config: pytest.Config) -> None:
    """Count where the summary is written, not in the workers."""
    path = config.getoption("--promises")
    if path is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Promises(path))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let each report carry the promise of its test."""
    for item in items:
        if (mark := item.get_closest_marker(PROPERTY)) is not None:
            item.user_properties.append((PROPERTY, mark.args[0]))
