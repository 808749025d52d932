"""Hands every reply to the one requester that asked.

All requesters of a service read one reply topic. If each had a reader of its own in the space, every reply would be
offered to all of them: with a thousand parts that beat once a second, a million calls a second. So the agent has one
reader for each reply topic, and looks up whose request a reply answers.
"""

from __future__ import annotations

from msbot_agent.space import Deliver, Guid, Qos, Reader, Sample, Space, Topic

_TAKE_ALL = Qos(reliable=False, depth=1, service=True)
"""Fits every writer; nothing ever waits in the history."""


class ReplyExchange:
    """The reply topics that requesters of this agent read."""

    def __init__(self, space: Space) -> None:
        self._space = space
        self._desks: dict[Topic, _Desk] = {}

    def reader(self, topic: Topic, guid: Guid, deliver: Deliver) -> Reader:
        """A reader of the replies to the requests of one writer; a reply that `deliver` does not take is lost."""
        desk = self._desks.get(topic)
        if desk is None:
            desk = self._desks[topic] = _Desk(self._space, topic)
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


class _Desk:
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
