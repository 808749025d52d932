"""The data space in this process' memory.

Theory of operation. All writers and readers of one topic belong to one meeting. Writers with the same offer share a
route, a tuple of the `accept` functions of the compatible readers; routes are rebuilt only when a reader comes or goes,
so that a write is a loop of plain calls. Samples of one writer reach every reader in order and once, even when a
call-back writes, closes or makes endpoints in the middle of a delivery.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache

from msbot_agent.space.contract import THIS_PROGRAM, Deliver, Guid, Owner, Qos, Sample, Topic
from msbot_agent.space.qos_matching import mismatch
from msbot_agent.space.readers import Clock, History, MemoryReader, SelectiveReader, Store, is_selective
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.identity_cache import IdentityCache

FEEDBACK_LIMIT = 1000
"""Samples that call-backs may add to a topic while one sample is delivered; more means an endless loop."""

MAX_OCTETS = 256 << 20
"""Octets of samples that a space keeps by default."""

MAX_TROUBLES = 8
"""Sentences about one endpoint; more would not help."""

logger = logging.getLogger(__name__)


class MemorySpace:
    """Satisfies `Space` within one process; nothing outlives it."""

    def __init__(self, max_octets: int = MAX_OCTETS, clock: Clock = time.monotonic) -> None:
        """Make an empty space.

        Args:
            max_octets: limit for the payloads in readers' histories and in transient-local writers, all together; a
                sample in two histories counts twice. When it is reached, each keeps no more than `FAIR_SHARE`.
            clock: seconds, for lifespans, deadlines and time-based filters.
        """
        self.words: str | None = None
        self._meetings: dict[Topic, _TopicEndpoints] = {}
        self._by_name: dict[tuple[str, int], list[_TopicEndpoints]] = {}
        self._store = Store(max_octets)
        self._clock = clock

    @property
    def octets_kept(self) -> int:
        """Size of the payloads kept now, in octets."""
        return self._store.used

    def writer(self, topic: Topic, qos: Qos, guid: Guid, owner: Owner = THIS_PROGRAM) -> MemoryWriter:  # noqa: ARG002
        """Make a writer and match it with every compatible reader."""
        meeting = self._meeting(topic)
        writer = MemoryWriter(topic, qos, guid, meeting, self._store, self._clock)
        meeting.enter(writer)
        return writer

    def reader(
        self,
        topic: Topic,
        qos: Qos,
        deliver: Deliver,
        owner: Owner = THIS_PROGRAM,  # noqa: ARG002
    ) -> MemoryReader:
        """Make a reader; a transient-local one gets at once, writer by writer, the samples such writers have kept."""
        meeting = self._meeting(topic)
        make = SelectiveReader if is_selective(qos) else MemoryReader
        reader = make(topic, qos, deliver, self._store, meeting, self._clock)
        meeting.join(reader)
        reader.catch_up(meeting.kept_for(reader))
        return reader

    def _meeting(self, topic: Topic) -> _TopicEndpoints:
        meeting = self._meetings.get(topic)
        if meeting is None:
            namesakes = self._by_name.setdefault((topic.name, topic.domain), [])
            for other in namesakes:
                logger.info(
                    "topic %s has two types, %s and %s: they do not meet",
                    topic.name,
                    other.topic.type_name,
                    topic.type_name,
                )
            meeting = self._meetings[topic] = _TopicEndpoints(topic, namesakes, self._close)
            namesakes.append(meeting)
        return meeting

    def _close(self, meeting: _TopicEndpoints) -> None:
        topic = meeting.topic
        del self._meetings[topic]
        namesakes = self._by_name[topic.name, topic.domain]
        namesakes.remove(meeting)
        if not namesakes:
            del self._by_name[topic.name, topic.domain]


class MemoryWriter:
    """Satisfies `Writer`; made by `MemorySpace.writer`."""

    __slots__ = (
        "_clock",
        "_delivering",
        "_feedback",
        "_history",
        "_later",
        "_meeting",
        "_open",
        "guid",
        "published",
        "qos",
        "route",
        "topic",
    )

    def __init__(  # noqa: PLR0917 - made by MemorySpace only
        self, topic: Topic, qos: Qos, guid: Guid, meeting: _TopicEndpoints, store: Store, clock: Clock
    ) -> None:
        self.guid = guid
        self.topic = topic
        self.qos = qos
        self.published = 0
        self._open = True
        self._history = History(max(1, qos.late_depth or qos.depth), store) if qos.transient_local else None
        self._meeting = meeting
        self._clock = clock
        self.route = meeting.route(qos)
        """Where its samples go; kept by the meeting."""
        self._delivering = False
        self._later: deque[Sample] | None = None
        self._feedback = 0

    @property
    def history(self) -> Iterable[Sample]:
        """Samples for readers that come later, oldest first."""
        return () if self._history is None else self._history.samples

    @property
    def readers(self) -> int:
        """Readers that match it now."""
        return len(self.route.accepts)

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        """Give one sample to every matched reader; returns its sequence number.

        A sample written during a delivery of this writer follows after it: all readers see the same order.

        Raises:
            LocalProtocolError: the writer is closed, or its readers feed it without end.
        """
        if not self._open:
            raise LocalProtocolError(f"the writer of topic {self.topic.name} is closed")
        if self._delivering and self._feedback >= FEEDBACK_LIMIT:
            raise LocalProtocolError(f"topic {self.topic.name} feeds itself: its readers write to it without end")
        self.published = sequence_nr = self.published + 1
        sample = Sample(payload, self.guid, sequence_nr, related)
        if self.qos.lifespan_s is not None:
            sample.expires_at = self._clock() + self.qos.lifespan_s
        if self._delivering:
            self._feedback += 1
            if self._later is None:
                self._later = deque()
            self._later.append(sample)
            return sequence_nr
        # Not in a function of its own: this is done for every sample.
        self._delivering = True
        self._feedback = 0
        try:
            while True:
                if self._history is not None and self._open:
                    self._history.push(sample)
                for accept in self.route.accepts:
                    accept(sample)
                if not self._later:
                    break
                sample = self._later.popleft()
        finally:
            self._delivering = False
            self._later = None
        return sequence_nr

    def troubles(self) -> tuple[str, ...]:
        """The readers of the topic that cannot hear it, by policy."""
        return self._meeting.troubles_of_writer(self)

    def close(self) -> None:
        """Leave the space; unmatches all readers and forgets what was kept. Closing twice does nothing."""
        if self._open:
            self._open = False
            if self._history is not None:
                self._history.clear()
            self._meeting.leave(self)


class _Route:
    """Where the samples of writers with the same offer go."""

    __slots__ = ("_readers", "accepts", "offered", "users")

    def __init__(self, offered: Qos, readers: Iterable[MemoryReader]) -> None:
        self.offered = offered
        self.users = 0
        self._readers = {reader: reader.accept for reader in readers if fit(offered, reader.qos)}
        self.accepts = tuple(self._readers.values())

    def join(self, reader: MemoryReader) -> None:
        """A reader has come; only this one is checked, since thousands may come one by one."""
        if fit(self.offered, reader.qos):
            self._readers[reader] = reader.accept
            self.accepts = tuple(self._readers.values())

    def leave(self, reader: MemoryReader) -> None:
        """A reader has gone."""
        if self._readers.pop(reader, None) is not None:
            self.accepts = tuple(self._readers.values())


class _TopicEndpoints:
    """The writers and readers of one topic, in the order they came."""

    __slots__ = ("_close", "_namesakes", "_routes", "readers", "topic", "writers")

    def __init__(
        self, topic: Topic, namesakes: list[_TopicEndpoints], close: Callable[[_TopicEndpoints], None]
    ) -> None:
        self.topic = topic
        self.writers: dict[MemoryWriter, None] = {}
        self.readers: dict[MemoryReader, None] = {}
        self._namesakes = namesakes
        self._routes: dict[int, _Route] = {}
        """By the `id` of what is offered: equal offers are one object (but for very many different ones)."""
        self._close = close

    def route(self, qos: Qos) -> _Route:
        """The route of writers with that offer; counts one more user."""
        offered = _offer(qos)
        route = self._routes.get(id(offered))
        if route is None:
            route = self._routes[id(offered)] = _Route(offered, self.readers)
        route.users += 1
        return route

    def enter(self, writer: MemoryWriter) -> None:
        """Take a writer in."""
        self.writers[writer] = None
        if writer.qos.exclusive:
            for reader in self.readers:
                if isinstance(reader, SelectiveReader):
                    reader.strengths[writer.guid] = writer.qos.strength

    def join(self, reader: MemoryReader) -> None:
        """Take a reader in."""
        self.readers[reader] = None
        if isinstance(reader, SelectiveReader):
            reader.strengths.update({writer.guid: writer.qos.strength for writer in self.writers})
        for route in self._routes.values():
            route.join(reader)

    def leave(self, endpoint: MemoryWriter | MemoryReader) -> None:
        """Take an endpoint out; the last one closes the meeting."""
        if isinstance(endpoint, MemoryWriter):
            del self.writers[endpoint]
            route = endpoint.route
            route.users -= 1
            if not route.users:
                del self._routes[id(route.offered)]
            for reader in self.readers:
                if isinstance(reader, SelectiveReader):
                    reader.forget(endpoint.guid)
        else:
            del self.readers[endpoint]
            for route in self._routes.values():
                route.leave(endpoint)
        if not self.writers and not self.readers:
            self._close(self)

    def kept_for(self, reader: MemoryReader) -> list[Sample]:
        """The samples that compatible writers have kept, for a reader that asks for them (DDS 1.4 §2.2.3.4)."""
        if not reader.qos.transient_local:
            return []
        return [sample for writer in self.writers if fit(writer.qos, reader.qos) for sample in writer.history]

    def troubles_of_reader(self, reader: MemoryReader) -> tuple[str, ...]:
        """The incompatible writers, by policy, and the topics of the same name with another type."""
        reasons = [mismatch(writer.qos, reader.qos) for writer in self.writers]
        return self._sentences(reasons, (len(meeting.writers) for meeting in self._others()), "written")

    def troubles_of_writer(self, writer: MemoryWriter) -> tuple[str, ...]:
        """The incompatible readers, by policy, and the topics of the same name with another type."""
        reasons = [mismatch(writer.qos, reader.qos) for reader in self.readers]
        return self._sentences(reasons, (len(meeting.readers) for meeting in self._others()), "read")

    def _others(self) -> list[_TopicEndpoints]:
        return [meeting for meeting in self._namesakes if meeting is not self]

    def _sentences(self, reasons: Iterable[str | None], others: Iterator[int], verb: str) -> tuple[str, ...]:
        name = self.topic.name
        found = dict.fromkeys(f"{name}: {reason}" for reason in reasons if reason is not None)
        for meeting, count in zip(self._others(), others, strict=True):
            if count:
                there, here = meeting.topic.type_name, self.topic.type_name
                found[f"{name}: TYPE: it is {verb} as {there} elsewhere, here it is {here}"] = None
        return tuple(found)[:MAX_TROUBLES]


def _offered(qos: Qos) -> Qos:
    """The part of a writer's QoS that decides which readers it fits; of equal ones the first."""
    return _first_of_equal(
        replace(
            qos, depth=1, late_depth=None, keep_all=False, lifespan_s=None, strength=0, separation_s=0.0, service=False
        )
    )


@lru_cache(256)
def _first_of_equal(qos: Qos) -> Qos:
    return qos


_offer = IdentityCache(_offered, 256)
"""Writers of one kind have the same QoS."""


def fit(offered: Qos, requested: Qos) -> bool:
    """Whether a reader accepts what a writer offers."""
    return mismatch(offered, requested) is None
