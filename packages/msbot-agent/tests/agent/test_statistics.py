"""Counters stay bounded, whatever names come from the wire."""

from __future__ import annotations

from msbot_agent.agent.statistics import TopicTable
from msbot_xrce.counting import OTHERS


def test_topics_are_counted_by_name_and_the_rest_together() -> None:
    table = TopicTable(limit=1)
    table.of("light").published += 1
    table.of("light").delivered += 2
    table.of("one too many").published += 3
    assert table.counts() == [(OTHERS, 3, 0), ("light", 1, 2)]
