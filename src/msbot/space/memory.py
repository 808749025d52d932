"""The data space in this process' memory.

Theory of operation. All writers and readers of one topic stand in one meeting. It has two routes, tuples of the
`accept` functions of readers: one for reliable writers, one for the others; they are rebuilt only when a reader
comes or goes, so that a write is a loop of plain calls. Samples of one writer reach every reader in order and once,
also when a call-back writes, closes or makes endpoints in the middle of a delivery.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable

from msbot.errors import LocalProtocolError
from msbot.space import Deliver, Guid, Qos, Reader, Sample, Topic, Writer

FEEDBACK_LIMIT = 1000
"""Samples that call-backs may add to a topic while one sample is delivered; more is a loop that never ends."""

MAX_OCTETS = 256 << 20
"""Octets of samples that a space keeps unless told otherwise."""

FAIR_SHARE = 16 << 10
"""Octets that a reader or writer may keep even when the space is full, so that one hog cannot take it all."""

logger = logging.getLogger(__name__)


class MemorySpace:
    """Satisfies `Space` within one process; nothing is kept when it goes."""

    def __init__(self, max_octets: int = MAX_OCTETS) -> None:
        """Make an empty space.

        Args:
            max_octets: payloads that readers' histories and transient-local writers keep, all together; a sample in
                two histories counts twice. Beyond, everybody keeps no more than `FAIR_SHARE`.
        """
        self._meetings: dict[Topic, _Meeting] = {}
        self._types: dict[tuple[str, int], list[str]] = {}
        self._store = _Store(max_octets)

    @property
    def octets_kept(self) -> int:
        """Payloads that are kept now, in octets."""
        return self._store.used

    def writer(self, topic: Topic, qos: Qos, guid: Guid) -> Writer:
        """Make a writer and match it with every fitting reader."""
        meeting = self._meeting(topic)
        writer = MemoryWriter(topic, qos, guid, meeting.routes[qos.reliable], self._store, self._leave)
        meeting.writers[writer] = None
        return writer

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver) -> Reader:
        """Make a reader; it gets at once, writer by writer, what transient-local writers have kept.

        DEVIATION: DDS gives kept samples to transient-local readers only. Here every reader gets them, so that a
        part of the thesis, which asks for no durability, has the robot's profile at once.
        """
        meeting = self._meeting(topic)
        reader = MemoryReader(topic, qos, deliver, self._store, self._leave)
        meeting.readers[reader] = None
        meeting.reroute()
        reader.catch_up([sample for writer in meeting.writers if fit(writer.qos, qos) for sample in writer.kept])
        return reader

    def _meeting(self, topic: Topic) -> _Meeting:
        meeting = self._meetings.get(topic)
        if meeting is None:
            types = self._types.setdefault((topic.name, topic.domain), [])
            for other in types:
                logger.info("topic %s has two types, %s and %s: they do not meet", topic.name, other, topic.type_name)
            types.append(topic.type_name)
            meeting = self._meetings[topic] = _Meeting()
        return meeting

    def _leave(self, endpoint: MemoryWriter | MemoryReader) -> None:
        meeting = self._meetings[endpoint.topic]
        meeting.remove(endpoint)
        if not meeting.writers and not meeting.readers:
            topic = endpoint.topic
            del self._meetings[topic]
            types = self._types[topic.name, topic.domain]
            types.remove(topic.type_name)
            if not types:
                del self._types[topic.name, topic.domain]


def fit(offered: Qos, requested: Qos) -> bool:
    """Whether a reader takes what a writer offers: a reliable reader needs a reliable writer (DDS 1.4 §2.2.3.14)."""
    return offered.reliable or not requested.reliable


class _Store:
    """How many octets all histories of a space may keep together."""

    __slots__ = ("limit", "used")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.used = 0


class _History:
    """The last samples of one reader or writer, as many as its depth and the store allow."""

    __slots__ = ("_depth", "_octets", "_store", "samples")

    def __init__(self, depth: int, store: _Store) -> None:
        self.samples: deque[Sample] = deque()
        self._depth = depth
        self._store = store
        self._octets = 0

    def push(self, sample: Sample) -> int:
        """Keep a sample; returns how many were pushed out, possibly this one."""
        samples, store = self.samples, self._store
        samples.append(sample)
        size = len(sample.payload)
        self._octets += size
        store.used += size
        lost = 0
        while len(samples) > self._depth or (store.used > store.limit and self._octets > FAIR_SHARE):
            self.pop()
            lost += 1
        return lost

    def pop(self) -> Sample:
        """Take the oldest one."""
        sample = self.samples.popleft()
        size = len(sample.payload)
        self._octets -= size
        self._store.used -= size
        return sample

    def clear(self) -> None:
        """Forget all."""
        self.samples.clear()
        self._store.used -= self._octets
        self._octets = 0


class MemoryWriter:
    """Satisfies `Writer`; made by `MemorySpace.writer`."""

    __slots__ = ("_delivering", "_feedback", "_history", "_later", "_leave", "_open", "_route", "guid", "published",
                 "qos", "topic")  # fmt: skip

    def __init__(  # noqa: PLR0917 - made by MemorySpace only
        self, topic: Topic, qos: Qos, guid: Guid, route: _Route, store: _Store, leave: Callable[[MemoryWriter], None]
    ) -> None:
        self.guid = guid
        self.topic = topic
        self.qos = qos
        self.published = 0
        self._open = True
        self._history = _History(max(1, qos.depth), store) if qos.transient_local else None
        self._route = route
        self._leave = leave
        self._delivering = False
        self._later: deque[Sample] | None = None
        self._feedback = 0

    @property
    def kept(self) -> Iterable[Sample]:
        """Samples for readers that come later, oldest first."""
        return () if self._history is None else self._history.samples

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        """Give one sample to every matched reader; returns its sequence number.

        What is written from within a delivery of this writer follows after it: all readers see the same order.

        Raises:
            LocalProtocolError: the writer is closed, or its readers feed it without end.
        """
        if not self._open:
            raise LocalProtocolError(f"the writer of topic {self.topic.name} is closed")
        if self._delivering and self._feedback >= FEEDBACK_LIMIT:
            raise LocalProtocolError(f"topic {self.topic.name} feeds itself: its readers write to it without end")
        self.published = sequence_nr = self.published + 1
        sample = Sample(payload, self.guid, sequence_nr, related)
        if self._delivering:
            self._feedback += 1
            if self._later is None:
                self._later = deque()
            self._later.append(sample)
        else:
            self._publish(sample)
        return sequence_nr

    def close(self) -> None:
        """Leave the space; unmatches all readers and forgets what was kept. Closing twice does nothing."""
        if self._open:
            self._open = False
            if self._history is not None:
                self._history.clear()
            self._leave(self)

    def _publish(self, sample: Sample) -> None:
        self._delivering = True
        self._feedback = 0
        try:
            while True:
                if self._history is not None and self._open:
                    self._history.push(sample)
                for accept in self._route.accepts:
                    accept(sample)
                if not self._later:
                    return
                sample = self._later.popleft()
        finally:
            self._delivering = False
            self._later = None


class MemoryReader:
    """Satisfies `Reader`; made by `MemorySpace.reader`."""

    __slots__ = ("_backlog", "_deliver", "_history", "_leave", "_open", "_waiting", "delivered", "lost", "qos", "topic")

    def __init__(
        self, topic: Topic, qos: Qos, deliver: Deliver, store: _Store, leave: Callable[[MemoryReader], None]
    ) -> None:
        self.topic = topic
        self.qos = qos
        self.delivered = 0
        self.lost = 0
        self._open = True
        self._deliver = deliver
        self._history = _History(max(1, qos.depth), store)
        self._waiting = self._history.samples
        self._backlog: deque[Sample] | None = deque()
        self._leave = leave

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""
        if not self._waiting:
            return None
        self.delivered += 1
        return self._history.pop()

    def close(self) -> None:
        """Leave the space; unmatches all writers and forgets what was not taken. Closing twice does nothing."""
        if self._open:
            self._open = False
            self._history.clear()
            self._leave(self)

    def accept(self, sample: Sample) -> None:
        """Deliver a sample or keep it; samples that came earlier and were not taken go first."""
        if self._backlog is not None:
            self._backlog.append(sample)
        elif self._open:
            if not self._waiting and self._deliver(sample):
                self.delivered += 1
            else:
                self._keep(sample)

    def catch_up(self, kept: Iterable[Sample]) -> None:
        """Deliver what was written before the reader came; what is written meanwhile waits behind it."""
        self._backlog = backlog = deque(kept)
        while backlog and self._open:
            sample = backlog.popleft()
            if not self._waiting and self._deliver(sample):
                self.delivered += 1
            else:
                self._keep(sample)
        self._backlog = None

    def _keep(self, sample: Sample) -> None:
        if self._open:  # else closed by the call-back that has just refused it
            self.lost += self._history.push(sample)


class _Route:
    """Where the samples of some writers go; shared by all of them."""

    __slots__ = ("accepts",)

    def __init__(self) -> None:
        self.accepts: tuple[Callable[[Sample], None], ...] = ()


class _Meeting:
    """The writers and readers of one topic, in the order they came."""

    __slots__ = ("readers", "routes", "writers")

    def __init__(self) -> None:
        self.writers: dict[MemoryWriter, None] = {}
        self.readers: dict[MemoryReader, None] = {}
        self.routes = {True: _Route(), False: _Route()}
        """By what the writer offers: reliable or not."""

    def remove(self, endpoint: MemoryWriter | MemoryReader) -> None:
        """Take an endpoint out."""
        if isinstance(endpoint, MemoryWriter):
            del self.writers[endpoint]
        else:
            del self.readers[endpoint]
            self.reroute()

    def reroute(self) -> None:
        """Make the routes anew, after a reader came or went."""
        for reliable, route in self.routes.items():
            offered = Qos(reliable=reliable)
            route.accepts = tuple(reader.accept for reader in self.readers if fit(offered, reader.qos))
