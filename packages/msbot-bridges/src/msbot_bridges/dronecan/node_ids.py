"""The allocator of node ids: the library's, which forgets nodes that are gone when it needs their ids.

The library's allocator never forgets a node: where nodes are replaced often, it has no ids left one day. A node that is
only unplugged keeps its id as long as there are others, so that it comes back as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from dronecan.app.dynamic_node_id import CentralizedServer
from dronecan.app.node_monitor import NodeMonitor

FIRST, LAST = 1, 125
ROOM: Final = 2
"""Ids that are free whenever a node asks for one."""


class NodeIdAllocator(CentralizedServer):  # type: ignore[misc]  # the library has no types
    """See the module's docstring.

    Args:
        node: the bridge's own.
        monitor: knows which nodes are there.
        other: called with the node id of another allocator whenever that gives an id.
        first: the lowest id that is given.
        last: the highest.
    """

    def __init__(
        self,
        node: Any,  # noqa: ANN401
        monitor: NodeMonitor,
        first: int = FIRST,
        last: int = LAST,
        *,
        other: Callable[[int], None] = lambda _: None,
    ) -> None:
        self._other = other
        self._range = range(first, last + 1)
        self._monitor = monitor
        super().__init__(node, monitor, dynamic_node_id_range=(first, last))

    def make_room(self) -> list[int]:
        """Forget nodes that are not there, the ones first that got their ids first, until there are free ids."""
        table = self._allocation_table
        known = [node_id for _, node_id in reversed(table.get_entries()) if node_id in self._range]
        present = {entry.node_id for entry in self._monitor.find_all(lambda _: True)}
        gone = [node_id for node_id in known if node_id not in present]
        # The library does not give the lowest id of its range.
        forgotten = gone[: max(0, ROOM + 1 - (len(self._range) - len(known)))]
        for node_id in forgotten:
            table._modify("delete from allocation where node_id = ?;", node_id)  # noqa: SLF001 - it has no other way
        return forgotten

    def _on_allocation_message(self, e: Any) -> None:  # noqa: ANN401
        if e.transfer.source_node_id:
            self._other(e.transfer.source_node_id)
            return
        self.make_room()
        super()._on_allocation_message(e)
