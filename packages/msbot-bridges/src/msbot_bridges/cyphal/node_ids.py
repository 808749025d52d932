"""Node ids for nodes that ask for one: the plug-and-play protocol of Cyphal on classic CAN. Pure.

The allocator of the library never forgets a node: where nodes are replaced often, it has no ids left one day. This one
forgets nodes that are gone when it needs their ids. A node that is only unplugged keeps its id as long as there are
others, so that it comes back as it was.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

FIRST, LAST = 1, 124
"""The bridge has 125; 126 and 127 are left to programs that watch the bus."""
HASH_BITS: Final = 48


class GivenNodeIds:
    """Who has which id.

    Args:
        first: the lowest id that is given.
        last: the highest.
    """

    def __init__(self, first: int = FIRST, last: int = LAST) -> None:
        self._range = range(last, first - 1, -1)
        self._given: dict[int, int] = {}
        """Hash of the unique id, by node id; the newest last."""

    def seen(self, node_id: int, unique_hash: int) -> None:
        """A node that is there says who it is."""
        self._forget(unique_hash)
        self._given.pop(node_id, None)
        self._given[node_id] = unique_hash

    def give(self, unique_hash: int, present: Collection[int]) -> int | None:
        """The id for a node that asks; None: all are in use.

        Args:
            unique_hash: what it says of its unique id.
            present: the ids of nodes that are on the bus.
        """
        for node_id, known in self._given.items():
            if known == unique_hash and node_id in self._range:
                return node_id
        free = next((one for one in self._range if one not in self._given and one not in present), None)
        if free is None:
            free = next((one for one in self._given if one in self._range and one not in present), None)
        if free is not None:
            self.seen(free, unique_hash)
        return free

    def _forget(self, unique_hash: int) -> None:
        for node_id in [node_id for node_id, known in self._given.items() if known == unique_hash]:
            del self._given[node_id]


def hash_of(unique_id: bytes) -> int:
    """What a node that asks says of its unique id: the last 48 bits of its CRC-64/WE."""
    crc = (1 << 64) - 1
    for octet in unique_id:
        crc ^= octet << 56
        for _ in range(8):
            crc = (crc << 1 ^ (0x42F0E1EBA9EA3693 if crc >> 63 else 0)) & (1 << 64) - 1
    return (crc ^ (1 << 64) - 1) & (1 << HASH_BITS) - 1
