"""Nothing is heard after all have confirmed STOP: every kind of part, whatever happens meanwhile."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.homes.world import Home
from tests.stop.kinds import HAPPENINGS, stories

KINDS = ("cpython", "micropython-can", "micropython-serial", "c", "browser")


@pytest.mark.promise("Nothing is heard after all parts have confirmed STOP, whatever they are and whatever happens")
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_heard_after_all_have_confirmed(
    kind: str, home: Callable[[str], Home], record_property: Callable[[str, object], None]
) -> None:
    verdicts = stories(home(kind))
    record_property("tried", len(verdicts))
    record_property("held", sum(verdict.is_right for verdict in verdicts.values()))
    assert len(verdicts) == len(HAPPENINGS)
    assert {words: verdict for words, verdict in verdicts.items() if not verdict.is_right} == {}
