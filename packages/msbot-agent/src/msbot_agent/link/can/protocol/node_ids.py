"""Which part had which CAN address: the memory from which a master gives addresses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class NodeIds(Protocol):
    """Where a master remembers which part had which address; in the registry, it outlives the master."""

    def find(self, uid: bytes) -> int | None:
        """The address of that part, or None when it has none (any more)."""

    def oldest_first(self) -> Sequence[int]:
        """The addresses that belong to a part, the one given or confirmed longest ago first."""

    def keep(self, node_id: int, uid: bytes) -> None:
        """Give the address to that part from now on; a part that had it before has none."""


class MemoryNodeIds:
    """`NodeIds` that are forgotten with the process."""

    def __init__(self) -> None:
        """Start with all addresses free."""
        self._uids: dict[int, bytes] = {}
        self._node_ids: dict[bytes, int] = {}

    def find(self, uid: bytes) -> int | None:
        """See `NodeIds`."""
        return self._node_ids.get(uid)

    def oldest_first(self) -> Sequence[int]:
        """See `NodeIds`."""
        return tuple(self._uids)

    def keep(self, node_id: int, uid: bytes) -> None:
        """See `NodeIds`."""
        former = self._uids.pop(node_id, None)
        if former is not None:
            del self._node_ids[former]
        self._uids.pop(self._node_ids.get(uid, 0), None)
        self._uids[node_id] = uid
        self._node_ids[uid] = node_id
