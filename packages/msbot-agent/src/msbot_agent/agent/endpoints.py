"""A client's data writers, data readers, requesters and repliers: what each does with WRITE_DATA and READ_DATA."""

from __future__ import annotations

from collections.abc import Callable

from msbot_agent.agent.gate import ReplyIfUnserved
from msbot_agent.agent.reply_routing import IDENTITY_SIZE, UNASKED, PendingRequests, decode_identity, encode_identity
from msbot_agent.agent.topic_attachment import EndpointHost, ReadSide, Shape, WriteSide
from msbot_agent.space import Deliver, Guid, Owner, Qos, Reader, Sample, Topic

# Which of a topic's samples concern a client, and what precedes them (eProsima's `SampleIdentity`).


class RequestShape:
    """For repliers: the request's identity in front of its body."""

    is_filter = False

    def accepts(self, sample: Sample) -> bool:  # noqa: ARG002 - the protocol's signature
        """Every request."""
        return True

    def payload(self, sample: Sample) -> bytes:
        """24 octets identity, then the body."""
        return encode_identity(sample.writer, sample.sequence_nr) + sample.payload

    def sent(self, sample: Sample) -> None:
        """Nothing to remember: the replier gives the identity back."""


class ReplyShape:
    """For requesters: replies to own open requests only, with the client's request id in front.

    A replier may also speak unasked to a requester it knows (the inventory tells a part that its configuration has
    changed); such a message has request id 0, which no request has.
    """

    is_filter = True

    def __init__(self, object_id: int, pending: PendingRequests) -> None:
        self._object_octets = object_id.to_bytes(2, "big")
        self._pending = pending
        self.guid: Guid | None = None
        """GUID of the writer that carries the requests now."""

    def accepts(self, sample: Sample) -> bool:
        """Whether the sample answers an open request of this requester, or is an unsolicited message to it."""
        related = sample.related
        if related is None or related[0] != self.guid:
            return False
        return related[1] == UNASKED or self._pending.request_id(related[1]) is not None

    def payload(self, sample: Sample) -> bytes:
        """Request id and object id (a BaseObjectRequest), then the body; only for a wanted sample."""
        request_id = self._pending.request_id(sample.related[1]) if sample.related is not None else None
        return (request_id or 0).to_bytes(2, "big") + self._object_octets + sample.payload

    def sent(self, sample: Sample) -> None:
        """Close the request."""
        if sample.related is not None:
            self._pending.answered(sample.related[1])


class NoEchoShape:
    """For clients that see their own samples by other means (`uxr_sm`): only the samples of others."""

    is_filter = True

    def __init__(self, is_own: Callable[[Guid], bool]) -> None:
        self._is_own = is_own

    def accepts(self, sample: Sample) -> bool:
        """Whether somebody else wrote it."""
        return not self._is_own(sample.writer)

    def payload(self, sample: Sample) -> bytes:
        """The payload as it is."""
        return sample.payload

    def sent(self, sample: Sample) -> None:
        """Nothing to remember."""


class Endpoint:
    """An object of a client that has a place in the data space: at most one side that writes and one that reads."""

    __slots__ = ("_host", "incoming", "outgoing")

    def __init__(self, host: EndpointHost, outgoing: WriteSide | None, incoming: ReadSide | None) -> None:
        self._host = host
        self.outgoing = outgoing
        self.incoming = incoming
        self.recheck()

    @property
    def topic(self) -> str:
        """The topic it writes; for a data reader, the topic it reads."""
        side = self.outgoing or self.incoming
        return side.topic if side is not None else ""

    @property
    def attached(self) -> bool:
        """Whether the gate lets every side of it into the space."""
        barred = self.outgoing is not None and self.outgoing.writer is None
        return not barred and not (self.incoming is not None and self.incoming.reader is None)

    def write(self, request_id: int, payload: bytes) -> None:  # noqa: ARG002 - overridden by all that can write
        """Take a WRITE_DATA of the client."""
        self._host.dropped.count("WRITE_DATA for an object that cannot write")

    def recheck(self) -> None:
        """Ask the gate again and enter or leave the space accordingly."""
        if self.outgoing is not None:
            self.outgoing.recheck()
        if self.incoming is not None:
            self.incoming.recheck()

    def troubles(self) -> tuple[str, ...]:
        """Which endpoints should match it in the space now and cannot, one sentence each."""
        writer = None if self.outgoing is None else self.outgoing.writer
        reader = None if self.incoming is None else self.incoming.reader
        return (*(() if writer is None else writer.troubles()), *(() if reader is None else reader.troubles()))

    def close(self) -> None:
        """Leave the space for good."""
        if self.outgoing is not None:
            self.outgoing.close()
        if self.incoming is not None:
            self.incoming.close()


class DataWriter(Endpoint):
    """WRITE_DATA goes into the topic as it is."""

    __slots__ = ("_samples",)

    def __init__(self, host: EndpointHost, object_id: int, topic: Topic, qos: Qos, owner: Owner) -> None:
        self._samples = WriteSide(host, object_id, topic, qos, owner)
        super().__init__(host, self._samples, None)

    def write(self, request_id: int, payload: bytes) -> None:  # noqa: ARG002 - nobody answers a sample
        """Give the sample to the space."""
        self._samples.write(payload)


class DataReader(Endpoint):
    """Samples of the topic go to the client as they are."""

    __slots__ = ()

    def __init__(  # noqa: PLR0917 - what a definition says
        self, host: EndpointHost, object_id: int, topic: Topic, qos: Qos, owner: Owner, shape: Shape | None
    ) -> None:
        super().__init__(host, None, ReadSide(host, object_id, topic, qos, owner, shape=shape))


class Requester(Endpoint):
    """WRITE_DATA is a request; its reply comes back with its request id in front; only the first reply to each request
    counts."""

    __slots__ = ("_answers", "_for_nobody", "_object_octets", "_pending", "_requests", "_shape")

    def __init__(  # noqa: PLR0917 - what a definition says
        self, host: EndpointHost, object_id: int, request: Topic, reply: Topic, qos: Qos, owner: Owner
    ) -> None:
        self._pending = PendingRequests(host.max_requests)
        self._object_octets = object_id.to_bytes(2, "big")
        self._for_nobody: ReplyIfUnserved | None = None
        self._shape = ReplyShape(object_id, self._pending)
        self._requests = WriteSide(host, object_id, request, qos, owner)
        self._answers = ReadSide(host, object_id, reply, qos, owner, shape=self._shape, open_reader=self._open_reader)
        super().__init__(host, self._requests, self._answers)

    @property
    def forgotten(self) -> int:
        """Requests given up, so that a reply to them is ignored, because too many newer ones are open."""
        return self._pending.forgotten

    def write(self, request_id: int, payload: bytes) -> None:
        """Send a request; the reply will carry `request_id`. One that would reach nobody may be answered at once."""
        writer = self._requests.writer
        instead = None if self._for_nobody is None else self._for_nobody(None if writer is None else writer.readers)
        if instead is not None and self._answers.say(request_id.to_bytes(2, "big") + self._object_octets + instead):
            return
        if writer is not None:
            # Before the write: a replier in this process may answer within it.
            self._pending.add(writer.published + 1, request_id)
        self._requests.write(payload)

    def recheck(self) -> None:
        """Ask the gate again; open requests end when the writer has changed.

        A client that may send requests may receive the answers to them, so the gate is not asked about the reply topic.
        Reading that whole topic, including answers to others, is a separate right (`DataReader`).
        """
        self._for_nobody = self._host.reply_if_unserved(self._requests.topic)
        self._requests.recheck()
        writer = self._requests.writer
        guid = None if writer is None else writer.guid
        if guid != self._shape.guid:
            self._answers.close()
            self._pending.clear()
            self._shape.guid = guid
        if guid is not None:
            self._answers.enter()

    def _open_reader(
        self,
        topic: Topic,
        qos: Qos,  # noqa: ARG002
        deliver: Deliver,
        owner: Owner,  # noqa: ARG002 - one for all requesters
    ) -> Reader:
        assert self._shape.guid is not None
        return self._host.replies.reader(topic, self._shape.guid, deliver)


class Replier(Endpoint):
    """Requests come with their identity in front; WRITE_DATA is a reply and starts with the identity it answers."""

    __slots__ = ("_replies",)

    def __init__(  # noqa: PLR0917 - what a definition says
        self, host: EndpointHost, object_id: int, request: Topic, reply: Topic, qos: Qos, owner: Owner
    ) -> None:
        self._replies = WriteSide(host, object_id, reply, qos, owner)
        super().__init__(host, self._replies, ReadSide(host, object_id, request, qos, owner, shape=RequestShape()))

    def write(self, request_id: int, payload: bytes) -> None:  # noqa: ARG002 - a reply has no answer
        """Send a reply; one that is too short to name its request is dropped and counted."""
        identity = decode_identity(payload)
        if identity is None:
            self._host.dropped.count("reply without the identity of its request")
            return
        self._replies.write(payload[IDENTITY_SIZE:], identity)
