"""A test's time is over at any moment, but not while pytest describes why it has failed."""

from __future__ import annotations

import signal

import pytest

from tests import time_of_a_test
from tests.effort import THOROUGH


@pytest.mark.skipif(THOROUGH, reason="no test has a time limit")
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no alarm ends a test on this system")
def test_a_test_s_time_stands_still_while_its_failure_is_described() -> None:
    before, _ = signal.getitimer(signal.ITIMER_REAL)
    assert before > 0, "this test has no time limit"
    report = object()
    describing = time_of_a_test.pytest_runtest_makereport()
    next(describing)
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)
    with pytest.raises(StopIteration) as end:
        describing.send(report)  # type: ignore[arg-type]
    assert end.value.value is report
    after, _ = signal.getitimer(signal.ITIMER_REAL)
    assert 0 < after <= before
