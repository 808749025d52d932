"""The services of an agent's parts, carried to its master and back: requests one way, replies the other.

For a part here that calls, the agent is a requester at the master, and the number of its request there leads back to
the request here. For a part here that serves, it is a replier at the master, and the number of the request that it
writes here leads back to the identity there. A service has one part that serves: if that is here, requests of parts
here reach it directly, and do not go to the master.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import partial
from typing import Final, NamedTuple, TypeVar

from msbot.part import Client, Entity, ServiceNames
from msbot.part.calls import ReplyStatus, encode_reply
from msbot.pnp.remote_agents.agent_messages import OpenTopic
from msbot.service_types import ServiceType, reply_topic, request_topic, service_type
from msbot_agent.space import Guid, Qos, Reader, Sample, Space, Topic, Writer
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LinkFull, LocalProtocolError
from msbot_xrce.lazy import dataclass

MOST_OPEN: Final = 1024
"""Requests of one service that wait for their replies; beyond, the oldest is given up."""
_SERVICE: Final = Qos(service=True)
_GUID_OCTETS: Final = 16
_V = TypeVar("_V")


class _ServiceWay(NamedTuple):
    topic: str
    kind: ServiceType
    serves: bool
    """Whether a part here serves; else one calls."""

    @property
    def requests(self) -> Topic:
        return Topic(request_topic(self.topic), self.kind.request)

    @property
    def replies(self) -> Topic:
        return Topic(reply_topic(self.topic), self.kind.reply)


@dataclass(slots=True, eq=False)
class _Carried:
    """One service in one direction."""

    way: _ServiceWay
    entity: Entity
    """The agent's requester or replier at the master."""
    writer: Writer
    """Writes replies here for those who call, requests for the one who serves."""
    reader: Reader
    """Reads the other."""
    asked: dict[int, tuple[Guid, int]]
    """Number of a request at the master -> who asked here, and its number there."""
    taken: dict[int, bytes]
    """Number of a request here -> its identity at the master."""


class ServiceBridge:
    """See the module's docstring.

    Args:
        space: where the agent acts for its parts.
        client: the agent's own client at the master.
        participant: parent of what it creates there.
    """

    def __init__(self, space: Space, client: Client, participant: Entity) -> None:
        self.lost = Tally()
        """Requests and replies that could not be passed on, by service."""
        self._space = space
        self._client = client
        self._participant = participant
        self._carried: dict[_ServiceWay, _Carried] = {}
        self._by_object: dict[int, _Carried] = {}

    def set_services(self, topics: Iterable[OpenTopic]) -> None:
        """Carry these services from now on, and no others."""
        wanted: dict[_ServiceWay, None] = {}
        for one in topics:
            kind = service_type(one.topic_type)
            if kind is not None:
                wanted[_ServiceWay(one.topic, kind, bool(one.publishes))] = None
        for way in [way for way in self._carried if way not in wanted]:
            self._end(self._carried.pop(way))
        for way in wanted:
            if way not in self._carried:
                self._begin(way)

    def session_lost(self) -> None:
        """The session with the master is over: what was asked in it gets no reply."""
        for one in self._carried.values():
            for asker in one.asked.values():
                _refuse(one, asker, "the way to the robot's master broke")
            one.asked.clear()
            one.taken.clear()

    def requested(self, object_id: int, identity: bytes, payload: bytes) -> None:
        """The master passes on a request for a part here."""
        one = self._by_object.get(object_id)
        if one is not None and one.way.serves:
            _remember(one.taken, one.writer.published + 1, identity)  # before the write: the reply may come within it
            one.writer.write(payload)

    def replied(self, object_id: int, number: int, payload: bytes) -> None:
        """The master passes on a reply to a part here."""
        one = self._by_object.get(object_id)
        asker = None if one is None else one.asked.pop(number, None)
        if one is not None and asker is not None:
            one.writer.write(payload, asker)

    def _begin(self, way: _ServiceWay) -> None:
        names = ServiceNames(way.topic, way.kind.request, way.kind.reply)
        make = self._client.create_replier if way.serves else self._client.create_requester
        entity = make(self._participant, names)
        self._client.read(entity)
        heard, said = (way.replies, way.requests) if way.serves else (way.requests, way.replies)
        writer = self._space.writer(said, _SERVICE, os.urandom(_GUID_OCTETS))
        deliver = partial(self._leaves, way)
        self._carried[way] = one = _Carried(way, entity, writer, self._space.reader(heard, _SERVICE, deliver), {}, {})
        self._by_object[entity.object_id] = one

    def _end(self, one: _Carried) -> None:
        one.reader.close()
        one.writer.close()
        del self._by_object[one.entity.object_id]
        self._client.delete(one.entity)

    def _leaves(self, way: _ServiceWay, sample: Sample) -> bool:
        one = self._carried.get(way)
        if one is None:
            return True
        if way.serves:
            self._reply(one, sample)
        elif way._replace(serves=True) not in self._carried:
            self._ask(one, sample)
        return True

    def _ask(self, one: _Carried, sample: Sample) -> None:
        asker = sample.writer, sample.sequence_nr
        try:
            number = self._client.write(one.entity, sample.payload)
        except (LinkFull, LocalProtocolError):
            self.lost.count(one.way.topic)
            _refuse(one, asker, "there is no room on the way to the robot's master now: call again later")
        else:
            _remember(one.asked, number, asker)

    def _reply(self, one: _Carried, sample: Sample) -> None:
        if sample.related is None or sample.related[0] != one.writer.guid:
            return  # to a part here
        identity = one.taken.pop(sample.related[1], None)
        if identity is None:
            return  # a second reply
        try:
            self._client.reply(one.entity, identity, sample.payload)
        except (LinkFull, LocalProtocolError):
            self.lost.count(one.way.topic)


def _remember(open_requests: dict[int, _V], key: int, value: _V) -> None:
    while len(open_requests) >= MOST_OPEN:
        del open_requests[next(iter(open_requests))]
    open_requests[key] = value


def _refuse(one: _Carried, asker: tuple[Guid, int], why: str) -> None:
    one.writer.write(encode_reply(ReplyStatus.NOT_PASSED, why), asker)
