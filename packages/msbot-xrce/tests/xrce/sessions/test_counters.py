"""Counters and the memory of a session."""

from __future__ import annotations

from msbot_xrce.streams.settings import Memory, SessionCounters


def test_drops_are_counted_by_reason() -> None:
    counters = SessionCounters()
    counters.dropped.count("late")
    counters.dropped.count("late")
    counters.dropped.count("broken")
    assert counters.dropped == {"late": 2, "broken": 1}


def test_memory_gives_only_what_it_has() -> None:
    memory = Memory(10)
    assert memory.take(4)
    assert memory.take(6)
    assert not memory.take(1)
    memory.give(4)
    assert memory.take(4)
    assert memory.used == 10


def test_memories_that_share_are_bounded_together() -> None:
    shared = Memory(10)
    one, other = Memory(8, shared), Memory(8, shared)
    assert one.take(6)
    assert not one.take(3)
    assert not other.take(5)
    assert (one.used, other.used, shared.used) == (6, 0, 6)
    assert other.take(4)
    one.give(6)
    assert other.take(4)
    assert (one.used, other.used, shared.used) == (0, 8, 8)
