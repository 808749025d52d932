"""A stand-in for the client that endpoints belong to."""

from __future__ import annotations

from itertools import count

from msbot_agent.agent.gate import ReplyIfUnserved
from msbot_agent.agent.reply_routing import ReplyExchange, make_guid
from msbot_agent.agent.statistics import TopicTraffic, Transit
from msbot_agent.agent.topic_attachment import ReadSide, Shape
from msbot_agent.space import Guid, MemorySpace, Space
from msbot_xrce.counting import Tally


class FakeHost:
    """Fits `EndpointHost`; everything it is told can be looked at."""

    def __init__(self, space: Space | None = None, key: int = 1, replies: ReplyExchange | None = None) -> None:
        self.space: Space = space or MemorySpace()
        self.replies = replies or ReplyExchange(self.space)
        self.key = key
        self.now = 0.0
        self.transit = Transit(self.clock)
        self.max_requests = 4
        self.own_filter: Shape | None = None
        self.barred: set[str] = set()
        """Topics that the gate keeps this client away from."""
        self.for_nobody: dict[str, ReplyIfUnserved] = {}
        """Topic -> what the gate replies to requests that reach nobody."""
        self.has_room = True
        self.sent: list[tuple[int, int, bytes, int]] = []
        """`(request id, object id, payload, stream id)` of every DATA."""
        self.calls: dict[ReadSide, float] = {}
        self.dropped = Tally()
        self.settled = True
        self.latched: set[str] = set()
        self.refused = Tally()
        self.traffic: dict[str, TopicTraffic] = {}
        self._incarnations = count(1)

    def clock(self) -> float:
        return self.now

    def traffic_of(self, topic: str) -> TopicTraffic:
        return self.traffic.setdefault(topic, TopicTraffic(topic))

    def is_latched(self, topic: str) -> bool:
        return topic in self.latched

    def is_settled(self) -> bool:
        return self.settled

    def may_write(self, topic: str) -> bool:
        return topic not in self.barred

    def reply_if_unserved(self, topic: str) -> ReplyIfUnserved | None:
        return self.for_nobody.get(topic)

    def may_read(self, topic: str) -> bool:
        return topic not in self.barred

    def new_guid(self, object_id: int) -> Guid:
        return make_guid(b"AGENT-ID", self.key, object_id, next(self._incarnations))

    def send_data(self, request_id: int, object_id: int, payload: bytes, stream_id: int) -> bool:
        if self.has_room:
            self.sent.append((request_id, object_id, payload, stream_id))
        return self.has_room

    def call_at(self, side: ReadSide, when: float) -> None:
        self.calls[side] = when

    def pass_time_until(self, when: float) -> None:
        """Serve the calls that are due up to that time."""
        while self.calls and min(self.calls.values()) <= when:
            side = min(self.calls, key=self.calls.__getitem__)
            self.now = self.calls.pop(side)
            side.pull()
        self.now = when

    def payloads(self) -> list[bytes]:
        """What went to the client since the last call."""
        payloads = [payload for _, _, payload, _ in self.sent]
        self.sent.clear()
        return payloads
