"""The one class that counts by name."""

from __future__ import annotations

import dataclasses

from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.counting import MOST_NAMES, OTHERS, Tally


def test_it_counts_by_name_and_is_a_dictionary() -> None:
    tally = Tally()
    tally.count("too long")
    tally.count("too long", 2)
    tally.count_all({"too late": 4})
    assert tally == {"too long": 3, "too late": 4}


def test_names_beyond_the_limit_are_counted_together() -> None:
    tally = Tally({"a": 1}, limit=2)
    for name in "abcd":
        tally.count(name)
    assert tally == {"a": 2, "b": 1, OTHERS: 2}
    tally.count("a", 5)
    assert tally["a"] == 7


@given(st.lists(st.text(max_size=2)))
def test_nothing_is_lost_and_the_names_stay_bounded(names: list[str]) -> None:
    tally = Tally(limit=8)
    for name in names:
        tally.count(name)
    assert sum(tally.values()) == len(names)
    assert len(tally) <= 8 + 1


def test_a_dataclass_that_holds_one_can_be_made_a_dictionary() -> None:
    @dataclasses.dataclass
    class Counters:
        dropped: Tally = dataclasses.field(default_factory=Tally)

    counters = Counters()
    counters.dropped.count("noise")
    assert dataclasses.asdict(counters) == {"dropped": {"noise": 1}}
    assert counters.dropped.limit == MOST_NAMES
