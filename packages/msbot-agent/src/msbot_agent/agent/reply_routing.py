"""Hands every reply to the one requester that asked.

All requesters of a service read one reply topic. If each had a reader of its own in the space, every reply would be
offered to all of them: with a thousand parts that beat once a second, a million calls a second. So the agent has one
reader for each reply topic, and looks up whose request a reply answers.
"""

from __future__ import annotations

from struct import Struct

from msbot_agent.space import Deliver, Guid, Qos, Reader, Sample, Space, Topic

_TAKE_ALL = Qos(reliable=False, depth=1, service=True)
"""Fits every writer; nothing ever waits in the history."""


class ReplyExchange:
    """The reply topics that requesters of this agent read."""

    def __init__(self, space: Space) -> None:
        self._space = space
        self._desks: dict[Topic, _ReplyTopic] = {}

    def reader(self, topic: Topic, guid: Guid, deliver: Deliver) -> Reader:
        """A reader of the replies to the requests of one writer; a reply that `deliver` does not take is lost."""
        desk = self._desks.get(topic)
        if desk is None:
            desk = self._desks[topic] = _ReplyTopic(self._space, topic)
        reader = desk.askers[guid] = _ReplyReader(self, topic, guid, deliver)
        return reader

    def troubles(self, topic: Topic) -> tuple[str, ...]:
        """Why replies on a topic do not arrive, one sentence each."""
        return self._desks[topic].reader.troubles()

    def leave(self, topic: Topic, guid: Guid) -> None:
        """End one reader; with the last one, the reader in the space ends, too."""
        desk = self._desks[topic]
        del desk.askers[guid]
        if not desk.askers:
            del self._desks[topic]
            desk.reader.close()


class _ReplyTopic:
    """One reply topic."""

    __slots__ = ("askers", "reader")

    def __init__(self, space: Space, topic: Topic) -> None:
        self.askers: dict[Guid, _ReplyReader] = {}
        """The readers of replies, by the GUID of the writer of the requests."""
        self.reader = space.reader(topic, _TAKE_ALL, self._take)

    def _take(self, sample: Sample) -> bool:
        asker = self.askers.get(sample.related[0]) if sample.related is not None else None
        if asker is not None:
            asker.offer(sample)
        return True


class _ReplyReader:
    """Satisfies `Reader`."""

    __slots__ = ("_deliver", "_exchange", "_guid", "delivered", "lost", "topic")

    def __init__(self, exchange: ReplyExchange, topic: Topic, guid: Guid, deliver: Deliver) -> None:
        self.topic = topic
        self.delivered = 0
        self.lost = 0
        self._exchange: ReplyExchange | None = exchange
        self._guid = guid
        self._deliver = deliver

    def offer(self, sample: Sample) -> None:
        """Offer a reply to the requester, which takes it or loses it."""
        if self._deliver(sample):
            self.delivered += 1
        else:
            self.lost += 1

    def take(self) -> Sample | None:
        """Always None: nothing waits here."""
        return None

    def troubles(self) -> tuple[str, ...]:
        """The troubles of the one reader of the topic."""
        return () if self._exchange is None else self._exchange.troubles(self.topic)

    def close(self) -> None:
        """Leave the topic. Closing twice does nothing."""
        if self._exchange is not None:
            self._exchange.leave(self.topic, self._guid)
            self._exchange = None


# Requests and replies: who asked, and which request a reply answers.
#
# A requester writes its request into the request topic. The replier sees it with the request's identity in front
# (24 octets: the writer's GUID and its sequence number) and puts the same identity in front of its reply; the agent
# takes it off and writes the reply with the identity beside it. Every requester then sees every reply of the service
# and takes those that answer a request of its own that is still open (XRCE of eProsima; `SampleIdentity` of DDS-RPC).


IDENTITY_SIZE = 24
"""Octets of a sample identity: 16 GUID, int32 high and uint32 low part of the sequence number."""

UNASKED = 0
"""Not the number of any request: a reply with it goes to the requester although it answers nothing."""

_IDENTITY = Struct("<16siI")
_GUID = Struct(">8sIHH")
_KEY = Struct(">I")


def make_guid(agent_id: bytes, client_key: int, object_id: int, incarnation: int) -> Guid:
    """The GUID of a client's writer: 8 octets of the agent, 4 client key, 2 object id, 2 incarnation.

    The incarnation distinguishes a writer from its predecessor with the same object id, so that a late reply to a
    request of the old one never answers a request of the new one.
    """
    return _GUID.pack(agent_id, client_key, object_id, incarnation & 0xFFFF)


def client_key_of(guid: Guid) -> int:
    """The key of the client that owns the writer; meaningful only for writers that an agent made."""
    key: int = _KEY.unpack_from(guid, 8)[0]
    return key


def encode_identity(guid: Guid, sequence_nr: int) -> bytes:
    """The 24 octets that precede a request for a replier."""
    return _IDENTITY.pack(guid, sequence_nr >> 32, sequence_nr & 0xFFFFFFFF)


def decode_identity(data: bytes) -> tuple[Guid, int] | None:
    """The writer and sequence number in front of a reply, or None when there are fewer than 24 octets."""
    if len(data) < IDENTITY_SIZE:
        return None
    guid, high, low = _IDENTITY.unpack_from(data)
    return guid, (high << 32) | low


class PendingRequests:
    """The requests of one requester that have no reply yet: at most `limit`, each answered once."""

    __slots__ = ("_limit", "_open", "forgotten")

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._open: dict[int, int] = {}
        self.forgotten = 0
        """Requests given up because `limit` newer ones came."""

    def __len__(self) -> int:
        return len(self._open)

    def add(self, sequence_nr: int, request_id: int) -> None:
        """Remember that the sample with this number carried the client's request."""
        if len(self._open) >= self._limit:
            del self._open[next(iter(self._open))]
            self.forgotten += 1
        self._open[sequence_nr] = request_id

    def request_id(self, sequence_nr: int) -> int | None:
        """The client's request id of an open request, or None."""
        return self._open.get(sequence_nr)

    def answered(self, sequence_nr: int) -> None:
        """Close a request: later replies to it are dropped."""
        self._open.pop(sequence_nr, None)

    def clear(self) -> None:
        """Forget all requests; their replies are dropped."""
        self._open.clear()
