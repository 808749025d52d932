"""Counters and the memory of a session."""

from __future__ import annotations

from msbot.xrce.counters import Memory, SessionCounters


def test_drops_are_counted_by_reason() -> None:
    counters = SessionCounters()
    counters.drop("late")
    counters.drop("late")
    counters.drop("broken")
    assert counters.dropped == {"late": 2, "broken": 1}


def test_memory_gives_only_what_it_has() -> None:
    memory = Memory(10)
    assert memory.take(4)
    assert memory.take(6)
    assert not memory.take(1)
    memory.give(4)
    assert memory.take(4)
    assert memory.used == 10
