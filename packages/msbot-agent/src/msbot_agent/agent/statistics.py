"""Counters and the views that `Agent.clients` and `Agent.topics` give to people."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator
from dataclasses import field
from typing import Final, Protocol

from msbot_agent.process.timer_grid import until_step
from msbot_xrce import AgentSession
from msbot_xrce.counting import OTHERS
from msbot_xrce.lazy import dataclass


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
class SessionFaultCounts:
    """What went wrong between agent and client since its session was opened."""

    repeated: int = 0
    """Messages of the client that came twice, or too late."""
    resent: int = 0
    """Messages that were sent to the client again."""
    unread: int = 0
    """Samples that were thrown away because the client did not take them in time."""


# How long messages take: through the agent, and from the agent to a client and back; both are measured now and then.
#
# Through the agent. The next sample, request or reply that a client writes is marked, at most once in `EVERY_S`,
# however many come: its octets become `TimestampedPayload`, which know when the agent took them up. The mark travels
# with them through this process' data space, and through the history of a reader that cannot take them yet. The time
# ends when the agent has given the packet to the reader's link; what the link has no room for at once, a CAN bus that
# is busy for instance, has waited in the reader's history until then. Samples from other programs have no mark, and
# what a writer had kept for a reader that came later does not count. While nobody listens, nothing is marked.
#
# To a client and back. A reliable stream measures, for its own use, how long its latest message took from the link's
# taking it to the client's acknowledgement (one message at a time; not one that was sent twice). `Acknowledgements`
# looks at what was measured last.


EVERY_S: Final = 0.1
MOST_READERS: Final = 64
"""Of a marked sample with more readers than this, the first ones are measured."""

Heard = Callable[[float], object]
"""Takes seconds."""


class TimestampedPayload(bytes):
    """A marked payload."""

    began: float
    """When the agent took it up, by its clock."""


class Transit:
    """Measures how long samples take through one agent."""

    __slots__ = ("_clock", "_listeners", "booked", "is_due")

    def __init__(self, clock: Callable[[], float]) -> None:
        self.is_due = False
        """Whether the next sample is to be marked."""
        self.booked: list[float] = []
        """When those were taken up that are on their way to a link in this turn of the loop."""
        self._clock = clock
        self._listeners: list[Heard] = []

    def on_delivery(self, listener: Heard) -> None:
        """Measure from now on, and tell the listener each time."""
        if not self._listeners:
            self.is_due = True
        self._listeners.append(listener)

    def mark(self, payload: bytes) -> bytes:
        """The payload, marked; the next one is due in a while."""
        self.is_due = False
        loop = asyncio.get_running_loop()
        loop.call_later(until_step(loop.time(), EVERY_S), self._be_due)
        timed = TimestampedPayload(payload)
        timed.began = self._clock()
        return timed

    def mark_queued(self, payload: TimestampedPayload, reader_since: float) -> None:
        """A marked sample was booked for a reader's link."""
        if payload.began >= reader_since and len(self.booked) < MOST_READERS:
            self.booked.append(payload.began)

    def mark_sent(self) -> None:
        """What was booked has been given to the links."""
        now = self._clock()
        booked, self.booked = self.booked, []
        for began in booked:
            for listener in self._listeners:
                listener(now - began)

    def _be_due(self) -> None:
        self.is_due = True


class ServedClient(Protocol):
    """A client, as far as it is looked at here."""

    key: int
    session: AgentSession


class Latency:
    """What an agent has measured.

    Args:
        clock: the agent's.
        clients: those that it serves.
    """

    def __init__(self, clock: Callable[[], float], clients: Iterable[ServedClient]) -> None:
        self.transit = Transit(clock)
        self._clients = clients

    def on_delivery(self, listener: Heard) -> None:
        """Measure now and then how long a sample takes through the agent, and tell the listener the seconds."""
        self.transit.on_delivery(listener)

    def acknowledgements(self) -> Iterator[tuple[int, int, float]]:
        """`(client key, how often it was measured, seconds)`: how long the latest reliable message that was measured
        took to each client, and its acknowledgement back; clients without one are left out."""
        for client in self._clients:
            count, seconds = client.session.acknowledged
            if count:
                yield client.key, count, seconds


class Maximum:
    """The greatest of what it is told."""

    def __init__(self) -> None:
        self._worst_s: float | None = None

    def add(self, seconds: float) -> None:
        """One more value."""
        self._worst_s = seconds if self._worst_s is None else max(seconds, self._worst_s)

    def take_ms(self) -> float | None:
        """The greatest since the last call, milliseconds; None: there was none."""
        worst_s, self._worst_s = self._worst_s, None
        return None if worst_s is None else worst_s * 1e3


class Acknowledgements:
    """Finds what was measured of clients since the last look."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}

    def newest(self, measured: Iterable[tuple[int, int, float]]) -> Iterator[tuple[int, float]]:
        """`(client key, seconds)` for each client with news: the latest of what was measured since.

        Args:
            measured: what `Latency.acknowledgements` gives.
        """
        seen: dict[int, int] = {}
        for key, count, seconds in measured:
            if count != self._counts.get(key, 0):
                yield key, seconds
            seen[key] = count
        self._counts = seen
