"""Joining the pieces of a large submessage."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.streams.receiving_in_order import TOO_LARGE, FragmentJoiner
from msbot_xrce.streams.settings import Memory, SessionCounters


def make_joiner(limit: int = 100) -> tuple[FragmentJoiner, Memory, SessionCounters]:
    memory, counters = Memory(limit), SessionCounters()
    return FragmentJoiner(memory, counters), memory, counters


def test_pieces_are_joined_at_the_last_one() -> None:
    joiner, memory, _ = make_joiner()
    assert joiner.add(b"abc", last=False) is None
    assert joiner.add(b"", last=False) is None
    assert joiner.add(b"d", last=True) == b"abcd"
    assert memory.used == 0


def test_cleared_pieces_do_not_spoil_the_next_message() -> None:
    joiner, memory, _ = make_joiner()
    joiner.add(b"half", last=False)
    joiner.clear()
    assert memory.used == 0
    assert joiner.add(b"whole", last=True) == b"whole"


def test_a_message_that_outgrows_the_memory_is_dropped_up_to_its_last_piece() -> None:
    joiner, memory, counters = make_joiner(limit=10)
    assert joiner.add(b"12345678", last=False) is None
    assert joiner.add(b"9abc", last=False) is None
    assert memory.used == 0
    assert joiner.add(b"small", last=True) is None
    assert counters.dropped == {TOO_LARGE: 1}
    assert joiner.add(b"next", last=True) == b"next"


@given(st.lists(st.binary(max_size=20), min_size=1, max_size=20))
def test_any_cut_is_joined_again(pieces: list[bytes]) -> None:
    joiner, memory, _ = make_joiner(limit=400)
    results = [joiner.add(piece, last=index == len(pieces) - 1) for index, piece in enumerate(pieces)]
    assert results == [None] * (len(pieces) - 1) + [b"".join(pieces)]
    assert memory.used == 0
