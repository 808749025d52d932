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

logger = logging.getLogger(__name__)


class MemorySpace:
    """Satisfies `Space` within one process; nothing is kept when it goes."""

    def __init__(self) -> None:
        self._meetings: dict[Topic, _Meeting] = {}

    def writer(self, topic: Topic, qos: Qos, guid: Guid) -> Writer:
        """Make a writer and match it with every fitting reader."""
        meeting = self._meeting(topic)
        writer = MemoryWriter(topic, qos, guid, meeting.routes[qos.reliable], self._leave)
        meeting.writers[writer] = None
        return writer

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver) -> Reader:
        """Make a reader; it gets at once, writer by writer, what transient-local writers have kept.

        DEVIATION: DDS gives kept samples to transient-local readers only. Here every reader gets them, so that a
        part of the thesis, which asks for no durability, has the robot's profile at once.
        """
        meeting = self._meeting(topic)
        reader = MemoryReader(topic, qos, deliver, self._leave)
        meeting.readers[reader] = None
        meeting.reroute()
        reader.catch_up([sample for writer in meeting.writers if fit(writer.qos, qos) for sample in writer.kept])
        return reader

    def _meeting(self, topic: Topic) -> _Meeting:
        meeting = self._meetings.get(topic)
        if meeting is None:
            for other in self._meetings:
                if (other.name, other.domain) == (topic.name, topic.domain):
                    logger.info(
                        "topic %s has two types, %s and %s: they do not meet",
                        topic.name,
                        other.type_name,
                        topic.type_name,
                    )
            meeting = self._meetings[topic] = _Meeting()
        return meeting

    def _leave(self, endpoint: MemoryWriter | MemoryReader) -> None:
        meeting = self._meetings[endpoint.topic]
        meeting.remove(endpoint)
        if not meeting.writers and not meeting.readers:
            del self._meetings[endpoint.topic]


def fit(offered: Qos, requested: Qos) -> bool:
    """Whether a reader takes what a writer offers: a reliable reader needs a reliable writer (DDS 1.4 §2.2.3.14)."""
    return offered.reliable or not requested.reliable


class MemoryWriter:
    """Satisfies `Writer`; made by `MemorySpace.writer`."""

    __slots__ = ("_delivering", "_feedback", "_later", "_leave", "_open", "_route", "guid", "kept", "published", "qos",
                 "topic")  # fmt: skip

    def __init__(
        self, topic: Topic, qos: Qos, guid: Guid, route: _Route, leave: Callable[[MemoryWriter], None]
    ) -> None:
        self.guid = guid
        self.topic = topic
        self.qos = qos
        self.published = 0
        self.kept: deque[Sample] = deque(maxlen=max(1, qos.depth) if qos.transient_local else 0)
        """Samples for readers that come later, oldest first."""
        self._open = True
        self._route = route
        self._leave = leave
        self._delivering = False
        self._later: deque[Sample] | None = None
        self._feedback = 0

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
            self.kept.clear()
            self._leave(self)

    def _publish(self, sample: Sample) -> None:
        self._delivering = True
        self._feedback = 0
        try:
            while True:
                self.kept.append(sample)
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

    __slots__ = ("_backlog", "_deliver", "_depth", "_history", "_leave", "_open", "delivered", "lost", "qos", "topic")

    def __init__(self, topic: Topic, qos: Qos, deliver: Deliver, leave: Callable[[MemoryReader], None]) -> None:
        self.topic = topic
        self.qos = qos
        self.delivered = 0
        self.lost = 0
        self._open = True
        self._deliver = deliver
        self._depth = max(1, qos.depth)
        self._history: deque[Sample] = deque()
        self._backlog: deque[Sample] | None = deque()
        self._leave = leave

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""
        if not self._history:
            return None
        self.delivered += 1
        return self._history.popleft()

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
            if not self._history and self._deliver(sample):
                self.delivered += 1
            else:
                self._keep(sample)

    def catch_up(self, kept: Iterable[Sample]) -> None:
        """Deliver what was written before the reader came; what is written meanwhile waits behind it."""
        self._backlog = backlog = deque(kept)
        while backlog and self._open:
            sample = backlog.popleft()
            if not self._history and self._deliver(sample):
                self.delivered += 1
            else:
                self._keep(sample)
        self._backlog = None

    def _keep(self, sample: Sample) -> None:
        if not self._open:  # closed by the call-back that has just refused it
            return
        history = self._history
        if len(history) >= self._depth:
            history.popleft()
            self.lost += 1
        history.append(sample)


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
