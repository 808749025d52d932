"""A test's time stands still while its failure is described: an alarm in there would end the whole run.

Of every run, those inside virtual machines too (`-p tests.time_of_a_test`).
"""

from __future__ import annotations

import signal
from collections.abc import Generator

import pytest

set_timer = getattr(signal, "setitimer", None)
"""The system's own, also while a test has put something in its place; None: this system has no such alarm."""


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Stop the alarm, and let it go on with what was left."""
    if set_timer is None:
        return (yield)
    left, _ = set_timer(signal.ITIMER_REAL, 0)
    try:
        return (yield)
    finally:
        set_timer(signal.ITIMER_REAL, left)
