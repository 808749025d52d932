"""The memory of addresses."""

from __future__ import annotations

from msbot_agent.link.can.protocol.ids import MemoryNodeIds

A, B, C = (bytes([letter]) * 8 for letter in b"ABC")


def test_an_address_belongs_to_one_part_and_a_part_has_one_address() -> None:
    ids = MemoryNodeIds()
    assert ids.find(A) is None
    ids.assign(1, A)
    ids.assign(2, B)
    assert (ids.find(A), ids.find(B)) == (1, 2)
    ids.assign(1, C)
    assert (ids.find(A), ids.find(C)) == (None, 1)
    ids.assign(3, C)
    assert ids.find(C) == 3
    assert sorted(ids.oldest_first()) == [2, 3]


def test_the_oldest_comes_first_and_confirming_makes_young() -> None:
    ids = MemoryNodeIds()
    for node_id, uid in enumerate((A, B, C), 1):
        ids.assign(node_id, uid)
    assert list(ids.oldest_first()) == [1, 2, 3]
    ids.assign(1, A)
    assert list(ids.oldest_first()) == [2, 3, 1]
