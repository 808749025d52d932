"""Readers in this process' memory: those that take every matching sample, and those that are selective."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from msbot_agent.space.contract import Deliver, Guid, Qos, Sample, Topic
from msbot_xrce.counting import amount

# Bounded histories: samples that a reader has not taken yet, and samples that a writer keeps for later readers.


FAIR_SHARE = 16 << 10
"""Octets that a reader or writer may keep even when the space is full, so that no single one can take it all."""


class Store:
    """How many octets all histories of a space may keep together."""

    __slots__ = ("limit", "used")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.used = 0


class History:
    """The last samples of one reader or writer, as many as its depth and the store allow."""

    __slots__ = ("_depth", "_octets", "_store", "samples")

    def __init__(self, depth: int, store: Store) -> None:
        self.samples: list[Sample] = []
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
        sample = self.samples.pop(0)
        size = len(sample.payload)
        self._octets -= size
        self._store.used -= size
        return sample

    def clear(self) -> None:
        """Forget all samples."""
        self.samples.clear()
        self._store.used -= self._octets
        self._octets = 0


Clock = Callable[[], float]


class TopicEndpoints(Protocol):
    """What a reader needs from the place where it meets writers."""

    def leave(self, endpoint: MemoryReader) -> None:
        """Take it out."""

    def troubles_of_reader(self, reader: MemoryReader) -> tuple[str, ...]:
        """The incompatible writers, one sentence each."""


def is_selective(qos: Qos) -> bool:
    """Whether a reader with that quality of service must be a `SelectiveReader`."""
    return qos.exclusive or qos.separation_s > 0 or qos.deadline_s is not None


class MemoryReader:
    """Satisfies `Reader`; made by `MemorySpace.reader`."""

    __slots__ = (
        "_backlog",
        "_clock",
        "_deliver",
        "_history",
        "_meeting",
        "_open",
        "_waiting",
        "delivered",
        "lost",
        "qos",
        "topic",
    )

    def __init__(  # noqa: PLR0917 - made by MemorySpace only
        self, topic: Topic, qos: Qos, deliver: Deliver, store: Store, meeting: TopicEndpoints, clock: Clock
    ) -> None:
        self.topic = topic
        self.qos = qos
        self.delivered = 0
        self.lost = 0
        self._open = True
        self._deliver = deliver
        self._history = History(max(1, qos.depth), store)
        self._waiting = self._history.samples
        self._backlog: list[Sample] | None = []
        self._meeting = meeting
        self._clock = clock

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""
        while self._waiting:
            sample = self._history.pop()
            if not self._is_over(sample):
                self.delivered += 1
                return sample
        return None

    @property
    def waiting(self) -> int:
        """Samples not taken yet."""
        return len(self._waiting)

    def troubles(self) -> tuple[str, ...]:
        """The writers of the topic that it cannot hear, by policy."""
        return self._meeting.troubles_of_reader(self)

    def close(self) -> None:
        """Leave the space; unmatches all writers and forgets what was not taken. Closing twice does nothing."""
        if self._open:
            self._open = False
            self._history.clear()
            self._meeting.leave(self)

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
        """Deliver the samples written before the reader came; those written during this call wait behind them."""
        self._backlog = backlog = [sample for sample in kept if not self._is_over(sample)]
        while backlog and self._open:
            sample = backlog.pop(0)
            if not self._waiting and self._deliver(sample):
                self.delivered += 1
            else:
                self._keep(sample)
        self._backlog = None

    def _keep(self, sample: Sample) -> None:
        if self._open:  # otherwise the call-back that just refused the sample has closed it
            self.lost += self._history.push(sample)

    def _is_over(self, sample: Sample) -> bool:
        return sample.expires_at is not None and sample.expires_at <= self._clock()


class SelectiveReader(MemoryReader):
    """A reader that does not want everything: one owner, a time between samples, a deadline to watch."""

    __slots__ = ("_last_at", "_owner", "missed", "strengths")

    def __init__(  # noqa: PLR0917 - made by MemorySpace only
        self, topic: Topic, qos: Qos, deliver: Deliver, store: Store, meeting: TopicEndpoints, clock: Clock
    ) -> None:
        super().__init__(topic, qos, deliver, store, meeting, clock)
        self.strengths: dict[Guid, int] = {}
        """Strengths of the writers that compete to be heard."""
        self.missed = 0
        """How often a deadline was missed."""
        self._owner: Guid | None = None
        self._last_at: float | None = None

    def accept(self, sample: Sample) -> None:
        """Take the sample if it is wanted; any other is treated as if it had never been written."""
        now = self._clock()
        if self.qos.exclusive and not self._is_from_owner(sample.writer, now):
            return
        last = self._last_at
        if last is not None:
            if now - last < self.qos.separation_s:
                return
            self.missed += self._missed_since(last, now)
        self._last_at = now
        super().accept(sample)

    def catch_up(self, kept: Iterable[Sample]) -> None:
        """As above; of the samples written before it came, the newest is enough if there is a time-based filter."""
        samples = list(kept)
        if samples:
            self._last_at = self._clock()
        super().catch_up(samples[-1:] if self.qos.separation_s else samples)

    def forget(self, writer: Guid) -> None:
        """A writer has gone: the next one that writes may be heard."""
        self.strengths.pop(writer, None)
        if self._owner == writer:
            self._owner = None

    def troubles(self) -> tuple[str, ...]:
        """The writers that it cannot hear, and the deadlines that were missed."""
        missed = self.missed
        if self._last_at is not None:
            missed += self._missed_since(self._last_at, self._clock())
        found = super().troubles()
        if missed:
            words = f"DEADLINE: samples are expected every {self.qos.deadline_s:g} s; that was missed "
            words += amount(missed, "time")
            found = (*found, f"{self.topic.name}: {words}")
        return found

    def _missed_since(self, last: float, now: float) -> int:
        deadline = self.qos.deadline_s
        return 0 if not deadline else int((now - last) / deadline)

    def _is_from_owner(self, writer: Guid, now: float) -> bool:
        owner = self._owner
        if owner is None or owner == writer:
            self._owner = writer
            return True
        late = self._last_at is not None and self._missed_since(self._last_at, now) > 0
        if late or self.strengths.get(writer, 0) > self.strengths.get(owner, 0):
            self._owner = writer
            return True
        return False
