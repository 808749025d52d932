"""Tests in this folder run in a virtual machine; here their results are taken over as if they had run here.

Inside a machine (`MSBOT_VM` is set) they run as all tests do, and their reports are kept for the session outside.
"""

from __future__ import annotations

import os
import pickle
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.socketcan.bus import add_vcan
from tests.socketcan.machine import PATIENCE_S, REPORT, MachineRun, why_not
from tests.socketcan.machine_state import state_of_machine

HERE = Path(__file__).parent
INSIDE = "MSBOT_VM" in os.environ
WAIT_S = 5 * PATIENCE_S
"""All machines, one after the other."""

RUN = pytest.StashKey[MachineRun]()
REASONS = pytest.StashKey[dict[str, str | None]]()
TOLD = pytest.StashKey[set[str]]()
"""Machines whose output was shown."""


def machine_of(item: pytest.Item) -> str:
    """The machine that a test wants."""
    return "qemu" if item.get_closest_marker("controllers") else "uml"


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker; inside a machine, keep the reports."""
    words = "controllers: wants emulated CAN controllers with their drivers, or modules of a stock kernel"
    config.addinivalue_line("markers", words)
    if INSIDE and REPORT in os.environ:
        config.pluginmanager.register(Recorder(config, Path(os.environ[REPORT])))


@pytest.fixture
def vcan0() -> Iterator[None]:
    """vcan0 for a test that may do with it what it likes: afterwards there is a new one."""
    yield
    subprocess.run(["ip", "link", "delete", "vcan0"], check=False, stderr=subprocess.DEVNULL)
    add_vcan("vcan0")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put these tests behind all others, which run while the machines do."""
    items.sort(key=lambda item: item.path.is_relative_to(HERE))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Start the machines."""
    config = session.config
    ours = [item for item in session.items if item.path.is_relative_to(HERE)]
    if INSIDE or not ours or config.option.collectonly:
        return
    reasons = config.stash[REASONS] = {name: why_not(name) for name in {*map(machine_of, ours)}}
    config.stash[TOLD] = set()
    tests: dict[str, list[str]] = {}
    for item in ours:
        item.add_marker(pytest.mark.timeout(WAIT_S), append=False)  # before its own, which holds inside a machine
        if reasons[machine_of(item)] is None:
            tests.setdefault(machine_of(item), []).append(item.nodeid)
    if tests:
        base = config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]  # as the fixture tmp_path_factory
        run = config.stash[RUN] = MachineRun((base.parent if hasattr(config, "workerinput") else base) / "machines")
        run.start(tests)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Leave nothing behind that runs."""
    run = session.config.stash.get(RUN, None)
    if run is not None:
        run.finish()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> bool | None:
    """Take over what the machine has reported of a test."""
    if INSIDE or not item.path.is_relative_to(HERE):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in _reports(item):
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _reports(item: pytest.Item) -> list[pytest.TestReport]:
    machine = machine_of(item)
    reason = item.config.stash[REASONS][machine]
    if reason is not None:
        return [_skipped(item, reason)]
    run = item.config.stash[RUN]
    found = run.reports(item.nodeid)
    if found:
        hook = item.config.hook.pytest_report_from_serializable
        return [hook(config=item.config, data=data) for data in found]
    not_started, words = run.failure(machine)
    if not_started:
        return [_skipped(item, f"the virtual machine does not start here: {' / '.join(words.splitlines()[-2:])}")]
    text = "the virtual machine did not report this test"
    if machine not in item.config.stash[TOLD]:
        item.config.stash[TOLD].add(machine)
        text = f"{text}; its output was:\n{words}"
    return [pytest.TestReport(item.nodeid, item.location, {}, "failed", text, "call")]


def _skipped(item: pytest.Item, reason: str) -> pytest.TestReport:
    where = (str(item.path), (item.location[1] or 0) + 1, f"Skipped: {reason}")
    return pytest.TestReport(item.nodeid, item.location, {}, "skipped", where, "setup")


class Recorder:
    """Keeps each report of a machine for the session outside."""

    def __init__(self, config: pytest.Config, path: Path) -> None:
        self._config = config
        self._path = path

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            report.sections.append(("The machine", state_of_machine()))
        data = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        with open(self._path, "ab") as file:
            pickle.dump(data, file)
