"""Counters stay bounded, whatever names come from the wire."""

from __future__ import annotations

from msbot.agent.stats import OTHERS, Tally, TopicTable


def test_tally_counts_by_name_and_the_rest_together() -> None:
    tally = Tally(limit=2)
    for name in ("a", "b", "a", "c", "d"):
        tally.add(name)
    assert tally.as_dict() == {"a": 2, "b": 1, OTHERS: 2}
    tally.add_all({"a": 5})
    assert tally.as_dict()["a"] == 7


def test_topics_are_counted_by_name_and_the_rest_together() -> None:
    table = TopicTable(limit=1)
    table.of("light").published += 1
    table.of("light").delivered += 2
    table.of("one too many").published += 3
    assert table.counts() == [(OTHERS, 3, 0), ("light", 1, 2)]
