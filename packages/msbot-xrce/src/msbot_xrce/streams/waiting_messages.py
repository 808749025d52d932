"""Messages ready to go, in the order they were booked, until the link pulls them.

Reliable messages are bounded by their window. Everything else goes through a `StreamQueue`, which keeps the newest
messages: when it is full, its oldest message is dropped and counted, because on a slow link a fresh sample or ACKNACK
is worth more than a stale one.

Queues that are short and mostly empty are lists here and in the other files of a session: an empty deque takes 0.75 kB,
so those of a session took half of its memory.
"""

from __future__ import annotations

from msbot_xrce.messages.ids import ObjectKind, SubmessageId
from msbot_xrce.streams.settings import SessionCounters


class StreamQueue:
    """The waiting messages of one unacknowledged stream, at most `limit` of them."""

    __slots__ = ("name", "packets")

    def __init__(self, name: str) -> None:
        self.name = name
        self.packets: list[bytes] = []


class Outbox:
    """One queue for everything a session sends."""

    __slots__ = ("_counters", "items", "limit")

    def __init__(self, limit: int, counters: SessionCounters) -> None:
        self.items: list[bytes | StreamQueue] = []
        """What waits, oldest first: messages, or for each message of a lane its lane; read-only."""
        self._counters = counters
        self.limit = limit
        """Messages per lane."""

    def __len__(self) -> int:
        return len(self.items)

    def put(self, packet: bytes) -> None:
        """Book a message whose number the caller bounds."""
        self.items.append(packet)

    def put_newest(self, packet: bytes, lane: StreamQueue) -> None:
        """Book a message in its lane; the oldest of a full lane makes room."""
        lane.packets.append(packet)
        if len(lane.packets) > self.limit:
            # The oldest message goes, but its place in the queue stays: the lane keeps its turn among the others.
            del lane.packets[0]
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
            packets = [item if type(item) is bytes else item.packets.pop(0) for item in items]  # type: ignore[union-attr]
            items.clear()
            return packets
        packets = [item.packets.pop(0) if isinstance(item, StreamQueue) else item for item in items[:limit]]
        del items[:limit]
        return packets

    def clear(self) -> None:
        """Forget everything that waits."""
        for item in self.items:
            if isinstance(item, StreamQueue):
                item.packets.clear()
        self.items.clear()


# What may share a message, so that a stock C client takes all of it.
#
# A stock client (2.0.0 to 3.0.1) takes a whole message before its application sees any of it, and has two manners that
# bound what an agent may put into one (both seen on the wire):
#
# * After a DATA for a requester it moves on by twice the length. Whatever follows is skipped or misread, and
#   acknowledged all the same. So such a DATA ends its message.
# * Applications await the answers to their requests one by one. While one awaits the first STATUS, a second one in
#   the same message goes by unseen, and is then awaited in vain: that is how `rmw_microxrcedds` ends a publisher. So
#   a STATUS has a message of its own, and where messages are lost or overtaken, nothing follows it before the client
#   has it.
#
# The two streams that send ask this of each submessage and spell it out, because a call costs a twentieth of a sample:
# `kind == STATUS` must not follow another submessage; nothing follows it, nor a DATA with
# `body[OBJECT_AT] & KIND_MASK == REQUESTER`.


PACKED_MAX = 1400
"""Octets of the largest message that is made of several submessages: one frame on Ethernet and Wi-Fi, headers included.
Beyond, a datagram would go in several, and be lost with any of them."""
PADDING = (b"", bytes(3), bytes(2), bytes(1))
"""What fills a message up to a multiple of 4, by what is over."""

# Plain ints: comparing with a member of an IntEnum costs several times as much, for every sample.
DATA = SubmessageId.DATA.value
STATUS = SubmessageId.STATUS.value
REQUESTER = ObjectKind.REQUESTER.value
OBJECT_AT = 7
"""Where the last octet of the object id is, in a DATA with its header; its low bits are the kind."""
