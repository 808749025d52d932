"""The topics of an agent's parts, carried to its master and back: one copy of each sample, however many read it.

What a part here writes goes to the master if the master has said that the part may write it; what a part here reads
comes from the master. Parts at the same agent hear each other directly, not by this way: the master sends an agent
nothing that came from it, and what came from the master is not sent back.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import partial
from typing import Final, NamedTuple

from msbot.part import Client, Entity
from msbot.pnp.fed_agents.messages import OpenTopic
from msbot_agent.space import Qos, Reader, Sample, Space, Topic, Writer
from msbot_xrce.common.tally import Tally
from msbot_xrce.errors import LinkFull, LocalProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from msbot_xrce.objects import EndpointQos

_GUID_OCTETS: Final = 16


class _Way(NamedTuple):
    topic: str
    type_name: str
    reliable: bool
    up: bool
    """Whether it leads to the master."""

    @property
    def stream_id(self) -> int:
        return STREAM_RELIABLE if self.reliable else STREAM_BEST_EFFORT


class TopicBridge:
    """Carries topics between an agent's space and the master.

    Args:
        space: where the agent acts for its parts.
        client: the agent's own client at the master, which gets none of its own samples back.
    """

    def __init__(self, space: Space, client: Client) -> None:
        self.lost = Tally()
        """Samples that could not be passed on to the master, by topic."""
        self._space = space
        self._client = client
        self._participant = client.create_participant("msbot_agent")
        self._publisher = client.create_publisher(self._participant)
        self._subscriber = client.create_subscriber(self._participant)
        self._up: dict[_Way, tuple[Reader, tuple[Entity, Entity]]] = {}
        self._down: dict[_Way, tuple[Writer, tuple[Entity, Entity]]] = {}
        self._into: dict[int, Writer] = {}
        """Object id of a reader at the master -> the writer here that gets its samples."""
        self._own: set[bytes] = set()
        """GUIDs of these writers."""
        self._next_guid = int.from_bytes(os.urandom(_GUID_OCTETS - 1), "big")

    def use(self, topics: Iterable[OpenTopic]) -> None:
        """Carry these topics from now on, each in the direction in which parts here use it, and no others."""
        wanted = {
            _Way(topic.topic, topic.topic_type, bool(topic.reliable), bool(topic.publishes)): None for topic in topics
        }
        for way in [*self._up, *self._down]:
            if way not in wanted:
                self._end(way)
        for way in wanted:
            if way not in self._up and way not in self._down:
                self._begin(way)

    def arrived(self, object_id: int, payload: bytes) -> None:
        """The master has sent a sample."""
        writer = self._into.get(object_id)
        if writer is not None:
            writer.write(payload)

    def room_gained(self) -> None:
        """The client has room again: what waits goes on."""
        for way, (reader, (writer, _)) in self._up.items():
            while (sample := reader.take()) is not None:
                self._pass_on(way, writer, sample)

    def _begin(self, way: _Way) -> None:
        topic, qos = Topic(way.topic, way.type_name), Qos(reliable=way.reliable)
        far_topic = self._client.create_topic(self._participant, way.topic, way.type_name)
        far_qos = EndpointQos(reliable=way.reliable)
        if way.up:
            entity = self._client.create_writer(self._publisher, far_topic, far_qos)
            self._up[way] = self._space.reader(topic, qos, partial(self._leaves, way, entity)), (entity, far_topic)
            return
        entity = self._client.create_reader(self._subscriber, far_topic, far_qos)
        self._client.read(entity, stream_id=way.stream_id)
        self._next_guid = (self._next_guid + 1) % (1 << 8 * _GUID_OCTETS)
        writer = self._space.writer(topic, qos, self._next_guid.to_bytes(_GUID_OCTETS, "big"))
        self._own.add(writer.guid)
        self._into[entity.object_id] = writer
        self._down[way] = writer, (entity, far_topic)

    def _end(self, way: _Way) -> None:
        entities: tuple[Entity, Entity]
        if way.up:
            reader, entities = self._up.pop(way)
            reader.close()
        else:
            writer, entities = self._down.pop(way)
            writer.close()
            self._own.discard(writer.guid)
            del self._into[entities[0].object_id]
        for entity in entities:
            self._client.delete(entity)

    def _leaves(self, way: _Way, entity: Entity, sample: Sample) -> bool:
        """A sample was written here; False: it waits until there is room."""
        if sample.writer in self._own:
            return True
        if way.reliable and not self._client.has_room(STREAM_RELIABLE):
            return False
        self._pass_on(way, entity, sample)
        return True

    def _pass_on(self, way: _Way, entity: Entity, sample: Sample) -> None:
        if sample.writer in self._own:
            return
        try:
            self._client.write(entity, sample.payload, stream_id=way.stream_id)
        except (LinkFull, LocalProtocolError):
            self.lost.count(way.topic)
