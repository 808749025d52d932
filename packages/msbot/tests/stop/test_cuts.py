"""Nothing is heard after all have confirmed STOP: every kind of part behind a cable that is cut and mended."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.homes.world import Home
from tests.stop.cuts import AGENT, LINKS, RELAY, cut_stories, deeds_for
from tests.stop.test_kinds import KINDS


@pytest.mark.promise("Nothing is heard after all parts have confirmed STOP, whatever they are and whatever happens")
@pytest.mark.parametrize("way", [AGENT, RELAY])
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_heard_after_all_have_confirmed_behind_a_cable_that_is_cut(
    kind: str, way: str, home: Callable[[str], Home], record_property: Callable[[str, object], None]
) -> None:
    deeds = deeds_for(kind)
    verdicts = cut_stories(home(kind), kind, way, deeds, near=way == AGENT and kind not in LINKS)
    record_property("tried", len(verdicts))
    record_property("held", sum(verdict.is_right for verdict in verdicts.values()))
    assert len(verdicts) == len(deeds)
    assert {words: verdict for words, verdict in verdicts.items() if not verdict.is_right} == {}
