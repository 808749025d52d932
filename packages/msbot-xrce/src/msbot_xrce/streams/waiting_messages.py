"""Messages ready to go, in the order they were booked, until the link pulls them.

Reliable messages are bounded by their window. Everything else goes through a `Lane`, which keeps the newest messages:
when a lane is full, its oldest message is dropped and counted, because on a slow link a fresh sample or ACKNACK is
worth more than a stale one.
"""

from __future__ import annotations

from collections import deque

from msbot_xrce.sessions.counters import SessionCounters


class Lane:
    """The waiting messages of one unacknowledged stream, at most `limit` of them."""

    __slots__ = ("name", "packets")

    def __init__(self, name: str) -> None:
        self.name = name
        self.packets: deque[bytes] = deque()


class Outbox:
    """One queue for everything a session sends."""

    __slots__ = ("_counters", "items", "limit")

    def __init__(self, limit: int, counters: SessionCounters) -> None:
        self.items: deque[bytes | Lane] = deque()
        """What waits, oldest first: messages, or for each message of a lane its lane; read-only."""
        self._counters = counters
        self.limit = limit
        """Messages per lane."""

    def __len__(self) -> int:
        return len(self.items)

    def put(self, packet: bytes) -> None:
        """Book a message whose number the caller bounds."""
        self.items.append(packet)

    def put_newest(self, packet: bytes, lane: Lane) -> None:
        """Book a message in its lane; the oldest of a full lane makes room."""
        lane.packets.append(packet)
        if len(lane.packets) > self.limit:
            # The oldest message goes, but its place in the queue stays: the lane keeps its turn among the others.
            lane.packets.popleft()
            self._counters.dropped.count(lane.name)
        else:
            self.items.append(lane)

    def holds(self, packet: bytes) -> bool:
        """Whether this message, booked with `put`, still waits."""
        return any(item is packet for item in self.items)

    def pull(self, limit: int | None = None) -> list[bytes]:
        """Take messages out, oldest first, all of them or at most `limit`."""
        items = self.items
        if limit is None or limit >= len(items):
            packets = [item if type(item) is bytes else item.packets.popleft() for item in items]  # type: ignore[union-attr]
            items.clear()
            return packets
        packets = []
        for _ in range(limit):
            item = items.popleft()
            packets.append(item.packets.popleft() if isinstance(item, Lane) else item)
        return packets

    def clear(self) -> None:
        """Forget everything that waits."""
        for item in self.items:
            if isinstance(item, Lane):
                item.packets.clear()
        self.items.clear()
