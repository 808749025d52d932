"""STOP that no master has heard or stored holds from the moment on that one serves: every kind of part."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.homes.world import Home
from tests.stop.gap import EVERYWHERE, ON_A_BUS, gap_stories
from tests.stop.test_kinds import KINDS

WITHOUT_A_BUS = ("micropython-serial", "browser")


@pytest.mark.promise("A STOP that was said while no master served holds as soon as one does")
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_part_has_heard_of_stop_the_next_master_learns(
    kind: str, home: Callable[[str], Home], record_property: Callable[[str, object], None]
) -> None:
    verdicts = gap_stories(home(kind), has_bus=kind not in WITHOUT_A_BUS)
    record_property("tried", len(verdicts))
    record_property("held", sum(verdict.is_right for verdict in verdicts.values()))
    assert len(verdicts) == len(EVERYWHERE) + (0 if kind in WITHOUT_A_BUS else len(ON_A_BUS))
    assert {words: verdict for words, verdict in verdicts.items() if not verdict.is_right} == {}
