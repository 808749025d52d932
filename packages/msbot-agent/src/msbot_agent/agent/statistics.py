"""Counters and the views that `Agent.clients` and `Agent.topics` give to people."""

from __future__ import annotations

from dataclasses import field

from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.common.tally import OTHERS


@dataclass(slots=True)
class TopicTraffic:
    """Traffic of clients on one topic, over all domains and since the agent was made."""

    name: str
    published: int = 0
    """Samples that clients wrote and the gate let through."""
    delivered: int = 0
    """Samples handed to clients, counted once per reader."""
    refused: int = 0
    """Samples that clients wrote but the gate kept out."""


class TopicTable:
    """The traffic by topic name, for at most `limit` names."""

    __slots__ = ("_limit", "_topics")

    def __init__(self, limit: int) -> None:
        self._topics: dict[str, TopicTraffic] = {}
        self._limit = limit

    def of(self, name: str) -> TopicTraffic:
        """The counters of that topic; shared ones when the table is full."""
        known = self._topics.get(name)
        if known is not None:
            return known
        if len(self._topics) >= self._limit:
            name = OTHERS
        return self._topics.setdefault(name, TopicTraffic(name))

    def counts(self) -> list[tuple[str, int, int]]:
        """`(name, published, delivered)` of every topic, by name."""
        return sorted((topic.name, topic.published, topic.delivered) for topic in self._topics.values())


@dataclass(frozen=True, slots=True)
class ObjectView:
    """One object of a client, for people."""

    object_id: int
    kind: str
    """`participant`, `topic`, `publisher`, ... in words."""
    topic: str | None
    """Topic of an endpoint (of a requester or replier: the request topic)."""
    attached: bool
    """False for an endpoint that the gate keeps out of the space."""
    troubles: tuple[str, ...] = ()
    """Which endpoints should match it now and cannot, one sentence each, with the policy's name."""


@dataclass(frozen=True, slots=True)
class StreamView:
    """One stream of a client in one direction, for people."""

    stream_id: int
    outgoing: bool
    """True = from the agent to the client."""
    last: int | None
    """Number of the newest message; None = none yet."""
    unacked: int
    """Reliable and outgoing: messages on their way or missing."""
    waiting: int
    """Reliable: messages that wait for the window, or that came early and wait for a gap to be filled."""


@dataclass(frozen=True, slots=True)
class ClientView:
    """One session as the agent sees it now."""

    key: int
    session_id: int
    link: str
    address: str
    mtu: int
    """Largest message in octets that is sent to the client."""
    age_s: float
    """Time since the session was opened or opened again."""
    silent_s: float
    """Time since the client was last heard."""
    objects: tuple[ObjectView, ...]
    packets_in: int
    packets_out: int
    bytes_in: int
    bytes_out: int
    published: int
    """Samples the client wrote and the gate let through."""
    delivered: int
    """Samples handed to the client."""
    waiting: int
    """Packets that wait for room on the link."""
    streams: tuple[StreamView, ...] = ()
    resent: int = 0
    """Reliable messages sent to the client again."""
    repeated: int = 0
    """Messages of the client that came again or too late; they are harmless and ignored."""
    gone: str | None = None
    """Why the client has gone, in the link's words, while its objects wait for its return; None = it is there."""
    dropped: dict[str, int] = field(default_factory=dict)
    """What was not done for this client, by reason in words."""
    refused: dict[str, int] = field(default_factory=dict)
    """Samples the client wrote but the gate kept out, by topic."""


PUSHED_OUT = "sample pushed out before the client read it"
"""A client that reads more slowly than others write loses the oldest of what waits for it."""


@dataclass(frozen=True, slots=True)
class SessionWear:
    """What went wrong between agent and client since its session was opened."""

    repeated: int = 0
    """Messages of the client that came twice, or too late."""
    resent: int = 0
    """Messages that were sent to the client again."""
    unread: int = 0
    """Samples that were thrown away because the client did not take them in time."""
