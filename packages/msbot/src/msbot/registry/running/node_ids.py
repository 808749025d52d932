"""The CAN addresses of one bus, kept in the database: `msbot_agent.link.NodeIds` on top of the writer."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msbot.registry.database import statements as store
from msbot.registry.database.writer import Writer
from msbot_agent.link.can.protocol import MemoryNodeIds


class StoredNodeIds:
    """Addresses are looked up in memory and stored by the writer thread.

    Args:
        writer: the thread that writes.
        robot_id: the robot of the bus.
        link: the bus, as in the link's address.
        rows: (node id, UID as text, kept_ns) from the database, oldest first.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self,
        writer: Writer,
        robot_id: int,
        link: str,
        *,
        rows: Sequence[tuple[int, str, int]],
        epoch_ns: Callable[[], int],
    ) -> None:
        self._writer = writer
        self._robot_id = robot_id
        self._link = link
        self._epoch_ns = epoch_ns
        self._memory = MemoryNodeIds()
        self._kept_ns = 0
        for node_id, uid, kept_ns in rows:
            self._memory.keep(node_id, bytes.fromhex(uid))
            self._kept_ns = kept_ns

    def find(self, uid: bytes) -> int | None:
        """See `NodeIds.find`."""
        return self._memory.find(uid)

    def oldest_first(self) -> Sequence[int]:
        """See `NodeIds.oldest_first`."""
        return self._memory.oldest_first()

    def keep(self, node_id: int, uid: bytes) -> None:
        """See `NodeIds.keep`."""
        self._memory.keep(node_id, uid)
        # A wall clock may jump back; the order of the addresses must not.
        kept_ns = self._kept_ns = max(self._epoch_ns(), self._kept_ns + 1)
        self._writer.put(
            lambda connection: store.keep_node_id(
                connection, self._robot_id, self._link, node_id=node_id, uid=uid.hex(), kept_ns=kept_ns
            )
        )
