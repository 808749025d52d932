"""Makes objects from definitions: what each kind of CREATE results in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from functools import lru_cache
from typing import ClassVar

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.endpoints import DataReader, DataWriter, Endpoint, Replier, Requester
from msbot_agent.agent.topic_attachment import EndpointHost
from msbot_agent.space import Owner, Qos, Topic
from msbot_xrce.identity_cache import IdentityCache
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import ObjectKind
from msbot_xrce.objects import Definition, ParticipantDef, ReaderDef, ReplierDef, RequesterDef, TopicDef, WriterDef

KEPT = 256
"""Definitions whose quality of service is worked out once, and topics that are made once."""

LONGEST_KEPT = 1024
"""Topics with longer names are made each time."""

_kept_topic = lru_cache(KEPT)(Topic)

_TOPIC = ObjectKind.TOPIC.value
_DOMAIN_OF_AGENT = 255
"""Domain id by which a participant leaves the choice to the agent (as in the genuine agent)."""


@dataclass(slots=True, eq=False)
class Participant:
    """A client's participant in one domain, and its topics with the number of users, by name."""

    domain: int
    owner: Owner
    topics: dict[str, tuple[Topic, int]] = field(default_factory=dict)

    def topic(self, name: str, type_name: str) -> Topic:
        """Make the topic or use the existing one of that name, whose type then counts."""
        known = self.topics.get(name)
        topic, users = (_topic(name, type_name, self.domain), 0) if known is None else known
        self.topics[name] = (topic, users + 1)
        return topic

    def release(self, name: str) -> None:
        """End one use; the topic goes with its last user."""
        topic, users = self.topics[name]
        if users > 1:
            self.topics[name] = (topic, users - 1)
        else:
            del self.topics[name]


@dataclass(slots=True, eq=False)
class ClientObject:
    """One object of a client."""

    definition: Definition
    """What it was made from; an equal one is the same object."""
    participant: Participant
    topic: Topic | None = None
    """The topic it is or uses; released when the object goes."""
    endpoint: Endpoint | None = None

    @property
    def topic_name(self) -> str | None:
        """The topic it is, writes or reads."""
        if self.endpoint is not None:
            return self.endpoint.topic
        return None if self.topic is None else self.topic.name

    @property
    def troubles(self) -> tuple[str, ...]:
        """Which endpoints should match it in the space and cannot."""
        return () if self.endpoint is None else self.endpoint.troubles()

    @property
    def is_attached(self) -> bool:
        """False while the gate keeps it out of the space."""
        return self.endpoint is None or self.endpoint.attached


class NoSuchTopic(Exception):
    """A writer or reader names a topic that its participant does not have."""


class Creator:
    """Makes the objects of clients."""

    __slots__ = ("_qos", "_settings", "unquestioned")

    def __init__(self, settings: AgentSettings) -> None:
        self._settings = settings
        self.unquestioned = min(settings.max_objects, settings.max_objects_unsettled)
        """So many objects any client may have, whatever the gate says of it."""
        # Parts of one kind describe their objects alike, and equal descriptions give the same definition.
        self._qos = IdentityCache(self._make_qos, KEPT)

    def make(
        self,
        host: EndpointHost,
        object_id: int,
        definition: Definition,
        parent: ClientObject | None,
        topics: dict[int, ClientObject],
    ) -> ClientObject:
        """Make the object of that id.

        Args:
            host: the client.
            object_id: id with the kind in its low four bits.
            definition: what it should be.
            parent: the object it belongs to; None for a participant.
            topics: the client's objects by id, to look up topics in.

        Raises:
            NoSuchTopic: it names a topic that its participant does not have.
        """
        if parent is None:
            assert isinstance(definition, ParticipantDef)
            owner = Owner(host.key, definition.name)
            return ClientObject(definition, Participant(self._domain(definition.domain_id), owner))
        make = self._MAKERS.get(type(definition))
        if make is None:
            return ClientObject(definition, parent.participant)
        return make(self, host, object_id, definition, parent.participant, topics)

    def _make_topic(
        self,
        host: EndpointHost,  # noqa: ARG002
        object_id: int,  # noqa: ARG002
        definition: TopicDef,
        participant: Participant,
        topics: dict[int, ClientObject],  # noqa: ARG002 - one signature for all
    ) -> ClientObject:
        return ClientObject(definition, participant, participant.topic(definition.name, definition.type_name))

    def _make_writer(
        self,
        host: EndpointHost,
        object_id: int,
        definition: WriterDef,
        participant: Participant,
        topics: dict[int, ClientObject],
    ) -> ClientObject:
        topic = self._topic_of(definition, participant, topics)
        endpoint = DataWriter(host, object_id, topic, self._qos(definition), participant.owner)
        return ClientObject(definition, participant, topic, endpoint)

    def _make_reader(
        self,
        host: EndpointHost,
        object_id: int,
        definition: ReaderDef,
        participant: Participant,
        topics: dict[int, ClientObject],
    ) -> ClientObject:
        topic = self._topic_of(definition, participant, topics)
        qos = self._qos(definition)
        if host.is_latched(topic.name) and not qos.transient_local:
            qos = replace(qos, transient_local=True)
        endpoint = DataReader(host, object_id, topic, qos, participant.owner, host.own_filter)
        return ClientObject(definition, participant, topic, endpoint)

    def _make_service(
        self,
        host: EndpointHost,
        object_id: int,
        definition: RequesterDef | ReplierDef,
        participant: Participant,
        topics: dict[int, ClientObject],  # noqa: ARG002 - they need no topic objects
    ) -> ClientObject:
        make = Requester if isinstance(definition, RequesterDef) else Replier
        request, reply = _service(definition, participant)
        endpoint = make(host, object_id, request, reply, self._service_qos(), participant.owner)
        return ClientObject(definition, participant, endpoint=endpoint)

    _MAKERS: ClassVar[dict[type[Definition], Callable[..., ClientObject]]] = {
        TopicDef: _make_topic,
        WriterDef: _make_writer,
        ReaderDef: _make_reader,
        RequesterDef: _make_service,
        ReplierDef: _make_service,
    }
    """What makes more than the object itself, by kind of definition."""

    def _domain(self, domain_id: int) -> int:
        return self._settings.domain_255 if domain_id == _DOMAIN_OF_AGENT else domain_id

    def _topic_of(
        self, definition: WriterDef | ReaderDef, participant: Participant, topics: dict[int, ClientObject]
    ) -> Topic:
        """Use the topic that an endpoint refers to, by id or (XML, reference) by name."""
        if definition.topic_id is not None:
            entity = topics.get((definition.topic_id & 0xFFF0) | _TOPIC)
            if entity is None or entity.topic is None or entity.participant is not participant:
                raise NoSuchTopic(f"topic {definition.topic_id:04X}")
            return participant.topic(entity.topic.name, entity.topic.type_name)
        name = definition.topic_name
        if name is None or name not in participant.topics:
            raise NoSuchTopic(f"topic {name!r}")
        return participant.topic(name, "")

    def _make_qos(self, definition: WriterDef | ReaderDef) -> Qos:
        settings = self._settings
        depth = settings.max_depth if definition.keep_all else definition.depth or settings.default_depth
        return Qos(
            reliable=definition.reliable,
            transient_local=definition.transient_local,
            keep_all=definition.keep_all,
            depth=min(depth, settings.max_depth),
            late_depth=None if definition.late_depth is None else min(definition.late_depth, settings.max_depth),
            partitions=definition.partitions,
            deadline_s=definition.deadline_s,
            lifespan_s=definition.lifespan_s,
            exclusive=definition.exclusive,
            strength=definition.strength,
            separation_s=definition.separation_s,
        )

    def _service_qos(self) -> Qos:
        return Qos(depth=min(self._settings.max_requests, self._settings.max_depth), service=True)


def _topic(name: str, type_name: str, domain: int) -> Topic:
    """The topic: the same object for clients that name the same one, so that it is found without comparing names."""
    make = _kept_topic if len(name) + len(type_name) <= LONGEST_KEPT else Topic
    return make(name, type_name, domain)


def _service(definition: RequesterDef | ReplierDef, participant: Participant) -> tuple[Topic, Topic]:
    """Request and reply topic; they need no topic objects."""
    return (
        _topic(definition.request_topic, definition.request_type, participant.domain),
        _topic(definition.reply_topic, definition.reply_type, participant.domain),
    )
