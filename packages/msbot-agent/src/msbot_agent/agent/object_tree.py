"""The objects of one client: created by CREATE, removed by DELETE, each request answered with a status.

Theory of operation: an object is known by its 16-bit id, whose low four bits are its kind. A child keeps its
participant alive by holding it, so deleting a parent does not touch the children: they stay known and go on working,
and only new children are refused (XRCE 1.0 §8.3.5.3 asks for a cascade; the genuine agent does not cascade, and a
client that deletes its objects in any order sees OK for each). Topics belong to the participant by name: a second topic
object of one name is the same topic, whatever type it states (seen on the wire).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.endpoints import Endpoint
from msbot_agent.agent.object_creation import ClientObject, Creator, NoSuchTopic
from msbot_agent.agent.topic_attachment import EndpointHost
from msbot_xrce import References, Status
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import ObjectKind, kind_of
from msbot_xrce.objects import Definition, named_by, parse_variant
from msbot_xrce.sessions import CreateRequested

logger = logging.getLogger(__name__)

_NO_PARENT = 0
_PARENTS: dict[int, int] = {
    ObjectKind.PARTICIPANT.value: _NO_PARENT,
    ObjectKind.TOPIC.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.PUBLISHER.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.SUBSCRIBER.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.DATAWRITER.value: ObjectKind.PUBLISHER.value,
    ObjectKind.DATAREADER.value: ObjectKind.SUBSCRIBER.value,
    ObjectKind.REQUESTER.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.REPLIER.value: ObjectKind.PARTICIPANT.value,
}
"""What can be made, and the kind of its parent, whatever the low four bits of the parent id say (seen on the wire)."""

# To read the member of an IntEnum from its class takes ten times as long as to read a name of the module.
_OK = Status.OK
_UNKNOWN = Status.ERR_UNKNOWN_REFERENCE

_LAST_RESERVED_KIND = 9
"""Kinds above this (types, profiles, applications ...) are answered OK, and nothing is made (seen on the wire)."""


LONGEST_WORDS = 240
"""Of the reason for a refusal in the log: a client may name what it likes."""


class ObjectBudget:
    """How many objects all clients of an agent may still create; the last half is reserved for settled ones."""

    __slots__ = ("_free", "_reserved")

    def __init__(self, limit: int) -> None:
        self._free = limit
        self._reserved = limit // 2

    def take(self, *, settled: bool) -> bool:
        """Reserve one object; False when none is left for such a client."""
        if self._free <= (0 if settled else self._reserved):
            return False
        self._free -= 1
        return True

    def give(self, count: int = 1) -> None:
        """Return objects."""
        self._free += count


def _refuse(host: EndpointHost, object_id: int, status: Status, reason: str, detail: object = "") -> Status:
    """Refuse an object; the client is told no reason, so people are: by a line of the log, and a count for the client.

    What only the agent's user can change is a warning. Of the rest a client's first is said at `-v 4`: some clients
    create everything twice, and take the refusals for an answer.
    """
    if reason in host.dropped:
        level = logging.DEBUG
    else:
        level = logging.WARNING if status is Status.ERR_RESOURCES else logging.INFO
    words = f"{reason} ({detail})"[:LONGEST_WORDS] if detail else reason
    logger.log(level, "client %08X: object %04X is refused: %s", host.key, object_id, words)
    host.dropped.count(reason)
    return status


def _named(object_id: int, entity: ClientObject) -> str:
    topic = entity.topic_name
    name = f"{ObjectKind(kind_of(object_id)).name.lower()} {object_id:04X}"
    return name if topic is None else f"{name}: {topic}"


class ObjectTree:
    """The objects of one client (see the module docstring)."""

    __slots__ = ("_budget", "_creator", "_entities", "_references", "_settings", "endpoints")

    def __init__(
        self,
        settings: AgentSettings,
        budget: ObjectBudget,
        references: References | None = None,
        creator: Creator | None = None,
    ) -> None:
        """`creator`: makes the objects, for several clients; absent: one of its own."""
        self._settings = settings
        self._budget = budget
        self._references = references
        self._creator = creator or Creator(settings)
        self._entities: dict[int, ClientObject] = {}
        self.endpoints: dict[int, Endpoint] = {}
        """The endpoints by object id; looked up for every WRITE_DATA."""

    def __len__(self) -> int:
        return len(self._entities)

    def items(self) -> Iterator[tuple[int, ClientObject]]:
        """The objects by id."""
        return iter(sorted(self._entities.items()))

    def create(self, host: EndpointHost, request: CreateRequested) -> Status:
        """Create, compare or replace an object, as the two flags say; returns the status for the client, `host`."""
        variant = request.variant
        kind = variant.kind
        parent_kind = _PARENTS.get(kind)
        if parent_kind is None:
            if kind > _LAST_RESERVED_KIND:
                return _OK
            return _refuse(host, request.object_id, Status.ERR_DDS_ERROR, "CREATE of a kind that cannot be created")
        object_id = (request.object_id & 0xFFF0) | kind
        entities = self._entities
        old = entities.get(object_id)
        if old is not None:
            if not request.reuse and not request.replace:
                return _refuse(host, object_id, Status.ERR_ALREADY_EXISTS, "CREATE of an object that is there already")
            if request.reuse and self._define(host, request) == old.definition:
                return Status.OK_MATCHED
            if not request.replace:
                return _refuse(host, object_id, Status.ERR_MISMATCH, "CREATE of an object that is there, but differs")
            self.delete(host, object_id)
        parent = None
        if parent_kind and (parent := entities.get((variant.parent_id & 0xFFF0) | parent_kind)) is None:
            return _refuse(host, object_id, _UNKNOWN, "CREATE without its parent", f"{variant.parent_id:04X}")
        definition = self._define(host, request)
        if definition is None:
            return Status.ERR_DDS_ERROR
        if len(entities) >= self._creator.unquestioned or not self._budget.take(settled=False):
            # Only here does it matter what the gate says.
            settled = host.is_settled()
            limit = self._settings.max_objects if settled else self._settings.max_objects_unsettled
            if len(entities) >= limit:
                return _refuse(host, object_id, Status.ERR_RESOURCES, f"object beyond {limit} of one client")
            if not self._budget.take(settled=settled):
                reason = "object beyond what all clients together may have"
                return _refuse(host, object_id, Status.ERR_RESOURCES, reason)
        try:
            entity = self._creator.make(host, object_id, definition, parent, entities)
        except NoSuchTopic as error:
            self._budget.give()
            reason = "CREATE for a topic that its participant does not have"
            return _refuse(host, object_id, Status.ERR_DDS_ERROR, reason, error)
        entities[object_id] = entity
        if logger.isEnabledFor(logging.DEBUG):
            logger.debug("client %08X created %s", host.key, _named(object_id, entity))
        if entity.endpoint is not None:
            self.endpoints[object_id] = entity.endpoint
        return _OK

    def delete(self, host: EndpointHost, object_id: int) -> Status:
        """Remove exactly that object of the client, `host`."""
        entity = self._entities.pop(object_id, None)
        if entity is None:
            return _UNKNOWN
        if logger.isEnabledFor(logging.DEBUG):
            logger.debug("client %08X deleted %s", host.key, _named(object_id, entity))
        self._budget.give()
        if entity.endpoint is not None:
            del self.endpoints[object_id]
            entity.endpoint.close()
        if entity.topic is not None:
            entity.participant.release(entity.topic.name)
        return _OK

    def clear(self) -> None:
        """Remove everything."""
        if not self._entities:
            return
        entities = list(self._entities.values())
        self._entities.clear()
        self.endpoints.clear()
        self._budget.give(len(entities))
        for entity in entities:
            if entity.endpoint is not None:
                entity.endpoint.close()

    def _define(self, host: EndpointHost, request: CreateRequested) -> Definition | None:
        """What the client wants; None (counted) when that cannot be understood."""
        variant = request.variant
        try:
            try:
                return parse_variant(variant, self._references, little_endian=request.little_endian)
            except RemoteProtocolError:
                if not self._settings.any_text_is_a_name:
                    raise
                return named_by(variant)
        except RemoteProtocolError as error:
            reason = "CREATE with a representation that cannot be used"
            _refuse(host, request.object_id, Status.ERR_DDS_ERROR, reason, error)
            return None
