"""Nothing is heard after all have confirmed STOP, whichever of two masters has the lease of the robot."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.registry.postgres import MISSING, NEEDED, find_server
from tests.stop.leases import lease_lost, lease_stories, said_by_nobody

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="`msbot stop` has its socket on Linux")


@pytest.mark.promise("Nothing is heard after all parts have confirmed STOP, whatever they are and whatever happens")
def test_nothing_is_heard_after_all_have_confirmed_while_a_lease_goes_over(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """The other deeds take longer, and are for the bench."""
    programs = find_server()
    if programs is None:
        assert NEEDED not in os.environ, MISSING
        pytest.skip(MISSING)
    verdicts = lease_stories(tmp_path, programs, (lease_lost, said_by_nobody))
    record_property("tried", len(verdicts))
    record_property("held", sum(verdict.is_right for verdict in verdicts.values()))
    assert {words: verdict for words, verdict in verdicts.items() if not verdict.is_right} == {}
