"""The two sides an endpoint may have: one among the writers of a topic, one among its readers.

The gate is asked once per side; while it says no, the side is not in the space, so that nothing reaches the topic or
the client. `recheck` asks again and attaches or detaches. The path of a sample consists of plain calls only:
`WriteSide.write` of one client, the space, `ReadSide.deliver` of the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from msbot_agent.agent.gate import ReplyIfUnserved
from msbot_agent.agent.reply_routing import ReplyExchange
from msbot_agent.agent.statistics import PUSHED_OUT, TimestampedPayload, TopicTraffic, Transit
from msbot_agent.pace import TokenBucket
from msbot_agent.space import Deliver, Guid, Owner, Qos, Reader, Sample, Space, Topic, Writer
from msbot_xrce.counting import Tally
from msbot_xrce.messages import DeliveryControl

# How a READ_DATA limits the samples sent to the client: how many, for how long, how fast.
#
# All four limits of the delivery control are obeyed (XRCE 1.0 §7.7.9; the genuine agent ignores the pace). A sample
# that may not go yet stays in the reader's history.


UNLIMITED_SAMPLES = 0xFFFF
"""The `max_samples` that means no limit."""

NEVER = math.inf
"""A time that never comes."""

_ROUNDING = 1e-3
"""Octets by which rounding may fall short after exactly the time that was waited."""


class ReadTask:
    """One running READ_DATA of a reader, requester or replier.

    The byte rate is a token bucket that holds one second's worth. A sample larger than that may go when the bucket is
    full; the debt then delays the next one. DEVIATION: the genuine agent never sends a sample larger than the rate and
    gets stuck behind it.
    """

    __slots__ = (
        "_bucket",
        "_bytes_per_s",
        "_next_at",
        "_pace_s",
        "_remaining",
        "_until",
        "limited",
        "request_id",
        "stream_id",
    )

    def __init__(self, request_id: int, stream_id: int, control: DeliveryControl | None, now: float) -> None:
        """Start a read; no control means exactly one sample (seen on the wire)."""
        self.request_id = request_id
        self.stream_id = stream_id
        samples = 1 if control is None else control.max_samples
        self._remaining = None if samples == UNLIMITED_SAMPLES else samples
        self._until = now + control.max_elapsed_s if control is not None and control.max_elapsed_s else NEVER
        self._bytes_per_s = control.max_bytes_per_second if control is not None else 0
        self._pace_s = control.min_pace_ms / 1000 if control is not None else 0.0
        self._bucket = TokenBucket(self._bytes_per_s, self._bytes_per_s, now) if self._bytes_per_s else None
        self._next_at = now
        self.limited = bool(self._remaining is not None or self._until < NEVER or self._bytes_per_s or self._pace_s)
        """False when every sample may go at once: `ready_at` and `sent` need not be called."""

    @property
    def finished(self) -> bool:
        """Whether the number of samples is used up."""
        return self._remaining == 0

    def ready_at(self, size: int, now: float) -> float:
        """When a sample of that many octets may go: `now` = at once, `NEVER` = not in this read."""
        if self._remaining == 0 or now >= self._until:
            return NEVER
        ready_at = self._next_at
        if self._bucket is not None:
            missing = self._bucket.missing(now, min(size, self._bytes_per_s))
            ready_at = max(ready_at, now if missing <= _ROUNDING else now + missing / self._bytes_per_s)
        if ready_at <= now:
            return now
        return ready_at if ready_at < self._until else NEVER

    def sent(self, size: int, now: float) -> None:
        """Account for a sample that was sent."""
        if self._remaining is not None:
            self._remaining -= 1
        if self._bucket is not None:
            self._bucket.spend(now, size)
        self._next_at = now + self._pace_s


OpenReader = Callable[[Topic, Qos, Deliver, Owner], Reader]


class EndpointHost(Protocol):
    """What an endpoint needs of the client it belongs to."""

    key: int
    """The agent's key of the client."""
    space: Space
    replies: ReplyExchange
    """Hands replies to the requester that asked."""
    max_requests: int
    """How many open requests a requester may have."""
    transit: Transit
    """Measures how long samples take."""
    own_filter: Shape | None
    """For data readers of a client that does not want its own samples back."""
    dropped: Tally
    """What was not done for the client, by reason in words."""
    refused: Tally
    """Samples that the gate kept out, by topic."""

    def clock(self) -> float:
        """Monotonic time in seconds; asked only for reads with limits and when a read begins."""

    def traffic_of(self, topic: str) -> TopicTraffic:
        """The counters of that topic."""

    def is_settled(self) -> bool:
        """Whether the gate says that this client has a place of its own."""

    def is_latched(self, topic: str) -> bool:
        """Whether readers get the topic's last sample at once, even if they ask for no durability."""

    def may_write(self, topic: str) -> bool:
        """The gate's verdict for this client."""

    def may_read(self, topic: str) -> bool:
        """The gate's verdict for this client."""

    def reply_if_unserved(self, topic: str) -> ReplyIfUnserved | None:
        """The gate's replies to requests that reach nobody."""

    def new_guid(self, object_id: int) -> Guid:
        """A GUID for a writer of that object, never used before."""

    def send_data(self, request_id: int, object_id: int, payload: bytes, stream_id: int) -> bool:
        """Book a DATA; False = no room now: the host calls `ReadSide.pull` when there is."""

    def call_at(self, side: ReadSide, when: float) -> None:
        """Call `ReadSide.pull` at that time."""


class WriteSide:
    """The place of an endpoint among the writers of a topic; outside the space until `recheck`."""

    __slots__ = ("_host", "_object_id", "_owner", "_qos", "_topic", "_traffic", "_transit", "published", "writer")

    def __init__(self, host: EndpointHost, object_id: int, topic: Topic, qos: Qos, owner: Owner) -> None:
        self._host = host
        self._object_id = object_id
        self._topic = topic
        self._qos = qos
        self._owner = owner
        self._traffic = host.traffic_of(topic.name)
        self._transit = host.transit
        self.writer: Writer | None = None
        """The writer in the space; None while the gate keeps it out."""
        self.published = 0

    @property
    def topic(self) -> str:
        """Name of the topic."""
        return self._topic.name

    def recheck(self) -> None:
        """Ask the gate and enter or leave the space accordingly."""
        if not self._host.may_write(self._topic.name):
            self.close()
        elif self.writer is None:
            guid = self._host.new_guid(self._object_id)
            self.writer = self._host.space.writer(self._topic, self._qos, guid, self._owner)

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> None:
        """Give a sample to the space, or refuse and count it while the gate says no."""
        writer = self.writer
        if writer is None:
            self._traffic.refused += 1
            self._host.refused.count(self._topic.name)
            return
        self._traffic.published += 1
        self.published += 1
        if self._transit.is_due:
            payload = self._transit.mark(payload)
        writer.write(payload, related)

    def close(self) -> None:
        """Leave the space."""
        if self.writer is not None:
            self.writer.close()
            self.writer = None


class ReadSide:
    """The place of an endpoint among the readers of a topic, and the read that the client started.

    Samples go to the client in the order of the space. As soon as one has to wait (no read, a limit of the read, a
    full window or link), all later ones wait behind it in the reader's bounded history until `pull` gets through.
    """

    __slots__ = (
        "_host",
        "_object_id",
        "_on_hand",
        "_open_reader",
        "_owner",
        "_qos",
        "_shape",
        "_since",
        "_topic",
        "_traffic",
        "delivered",
        "is_waiting",
        "read",
        "reader",
    )

    def __init__(
        self,
        host: EndpointHost,
        object_id: int,
        topic: Topic,
        qos: Qos,
        owner: Owner,
        *,
        shape: Shape | None = None,
        open_reader: OpenReader | None = None,
    ) -> None:
        """Stay outside the space until `recheck`.

        Args:
            host: the client.
            object_id: its object, for the DATA.
            topic: what to read.
            qos: how to read it.
            owner: whose it is.
            shape: selects the samples for the client, and their form; if absent, all samples as they are.
            open_reader: makes the reader; the space's own if absent.
        """
        self._host = host
        self._open_reader = open_reader or host.space.reader
        self._object_id = object_id
        self._topic = topic
        self._qos = qos
        self._owner = owner
        self._traffic = host.traffic_of(topic.name)
        self._shape = shape
        self._on_hand: list[Sample] = []
        self._since = 0.0  # when it entered the space
        self.is_waiting = False
        """Whether samples may be waiting, in the history or here."""
        self.read: ReadTask | None = None
        """The running READ_DATA; it survives detaching and attaching again."""
        self.reader: Reader | None = None
        """The reader in the space; None while the gate keeps it out."""
        self.delivered = 0

    @property
    def topic(self) -> str:
        """Name of the topic."""
        return self._topic.name

    def recheck(self) -> None:
        """Ask the gate and enter or leave the space accordingly; samples that still waited when it leaves are
        forgotten."""
        if self._host.may_read(self._topic.name):
            self.enter()
        else:
            self.close()

    def enter(self) -> None:
        """Enter the space without asking the gate: the caller knows that the client may read what gets through."""
        if self.reader is None:
            self._since = self._host.clock()
            self.reader = self._open_reader(self._topic, self._qos, self.deliver, self._owner)

    def start(self, request_id: int, stream_id: int, control: DeliveryControl | None) -> None:
        """Begin a READ_DATA in place of the running one; a control with no samples only ends that one."""
        task = ReadTask(request_id, stream_id, control, self._host.clock())
        self.read = None if task.finished else task
        self.pull()

    def deliver(self, sample: Sample) -> bool:
        """Take a sample from the space (True) or leave it in the reader's history (False)."""
        shape = self._shape
        if not self.is_waiting:
            if self._offer(sample):
                return True
        elif shape is not None and not shape.accepts(sample):
            return True
        self.is_waiting = True
        if shape is None or not shape.is_filter:
            return False
        self._keep(sample)
        return True

    def say(self, payload: bytes) -> bool:
        """Send something that is no sample of the space; False: the client reads nothing, or it may not go now."""
        read = self.read
        if read is None or (read.limited and not self._in_time(read, len(payload))):
            return False
        if not self._host.send_data(read.request_id, self._object_id, payload, read.stream_id):
            return False
        if read.limited:
            self._account(read, len(payload))
        return True

    def pull(self) -> None:
        """Send what waits, as far as it may go now."""
        while self.is_waiting and self.pull_one():
            pass

    def pull_one(self) -> bool:
        """Send one sample that waits; False when there is none or it may not go now."""
        if self.reader is None or self.read is None:
            return False
        sample = self._on_hand.pop(0) if self._on_hand else self.reader.take()
        if sample is None:
            self.is_waiting = False
            return False
        went = self._offer(sample)
        if not went:
            self._on_hand.insert(0, sample)
        return went

    def close(self) -> None:
        """Leave the space."""
        self._on_hand.clear()
        self.is_waiting = False
        if self.reader is not None:
            self.reader.close()
            self.reader = None

    def _keep(self, sample: Sample) -> None:
        # Left in the space's history, samples for others would push out those for this client.
        if len(self._on_hand) >= self._qos.depth:
            del self._on_hand[0]
            self._host.dropped.count(PUSHED_OUT)
        self._on_hand.append(sample)

    def _offer(self, sample: Sample) -> bool:
        """Book the sample for the client, or drop it if it is not for this client; False = it may not go now."""
        payload = sample.payload
        shape = self._shape
        if shape is not None:
            if not shape.accepts(sample):
                return True
            payload = shape.payload(sample)
        read = self.read
        if read is None or (read.limited and not self._in_time(read, len(payload))):
            return False
        if not self._host.send_data(read.request_id, self._object_id, payload, read.stream_id):
            return False
        if shape is not None:
            shape.sent(sample)
        if type(sample.payload) is TimestampedPayload:
            self._host.transit.mark_queued(sample.payload, self._since)
        if read.limited:
            self._account(read, len(payload))
        self.delivered += 1
        self._traffic.delivered += 1
        return True

    def _in_time(self, read: ReadTask, size: int) -> bool:
        now = self._host.clock()
        ready_at = read.ready_at(size, now)
        if ready_at <= now:
            return True
        if ready_at == NEVER:
            self.read = None
        else:
            self._host.call_at(self, ready_at)
        return False

    def _account(self, read: ReadTask, size: int) -> None:
        read.sent(size, self._host.clock())
        if read.finished:
            self.read = None


class Shape(Protocol):
    """Which samples of a topic concern a reading side, and in what form they go to the client."""

    is_filter: bool
    """Whether some samples do not concern it."""

    def accepts(self, sample: Sample) -> bool:
        """Whether the sample is for this client; if not, it is silently consumed."""

    def payload(self, sample: Sample) -> bytes:
        """The payload of the DATA."""

    def sent(self, sample: Sample) -> None:
        """The sample was booked for the client."""
