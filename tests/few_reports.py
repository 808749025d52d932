"""Workers send one report of a test that passes, and not two notes and two more reports that nobody reads.

Each is packed, sent, unpacked and handed to every plugin; for ten thousand tests that is 5 s of processor time. Who
reads them gets them: the times of each phase (`--durations`), a file of results (`--junitxml`), and `tests.cost`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from _pytest.runner import runtestprotocol

if TYPE_CHECKING:
    from xdist.workermanage import WorkerController

WANTED = "wants few reports"
"""Told to each worker."""


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: WorkerController) -> None:
    """Tell a worker before it begins what is read."""
    config = node.config
    all_are_read = config.option.durations is not None or config.option.xmlpath is not None
    node.workerinput[WANTED] = not (all_are_read or config.pluginmanager.hasplugin("tests.cost"))


def pytest_configure(config: pytest.Config) -> None:
    """In a worker, report as it was told."""
    if getattr(config, "workerinput", {}).get(WANTED):
        config.pluginmanager.register(Worker())


class Worker:
    """Runs a test as pytest does."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> bool:
        """Report what has run, and whatever did not go well before and afterwards."""
        for report in runtestprotocol(item, log=False, nextitem=nextitem):
            if report.when == "call" or not report.passed:
                item.ihook.pytest_runtest_logreport(report=report)
        return True
