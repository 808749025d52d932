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

from msbot.agent.agent_settings import AgentSettings
from msbot.agent.endpoints import Endpoint
from msbot.agent.object_creation import ClientObject, Creator, NoSuchTopic
from msbot.agent.topic_attachment import EndpointHost
from msbot.errors import RemoteProtocolError
from msbot.xrce import References, Status
from msbot.xrce.messages import ObjectKind, ObjectVariant
from msbot.xrce.objects import Definition, named_by, parse_variant
from msbot.xrce.sessions import CreateRequested

logger = logging.getLogger(__name__)

_PARENTS: dict[int, int | None] = {
    ObjectKind.PARTICIPANT.value: None,
    ObjectKind.TOPIC.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.PUBLISHER.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.SUBSCRIBER.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.DATAWRITER.value: ObjectKind.PUBLISHER.value,
    ObjectKind.DATAREADER.value: ObjectKind.SUBSCRIBER.value,
    ObjectKind.REQUESTER.value: ObjectKind.PARTICIPANT.value,
    ObjectKind.REPLIER.value: ObjectKind.PARTICIPANT.value,
}
"""What can be made, and the kind of its parent, whatever the low four bits of the parent id say (seen on the wire)."""

_LAST_RESERVED_KIND = 9
"""Kinds above this (types, profiles, applications ...) are answered OK, and nothing is made (seen on the wire)."""


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


class _Refused(Exception):
    def __init__(self, status: Status) -> None:
        super().__init__(status)
        self.status = status


class ObjectTree:
    """The objects of one client (see the module docstring)."""

    __slots__ = ("_budget", "_creator", "_entities", "_references", "_settings", "endpoints")

    def __init__(
        self, settings: AgentSettings, budget: ObjectBudget, references: References | None = None,
        creator: Creator | None = None,
    ) -> None:  # fmt: skip
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
        if variant.kind > _LAST_RESERVED_KIND:
            return Status.OK
        if variant.kind not in _PARENTS:
            return Status.ERR_DDS_ERROR
        object_id = (request.object_id & 0xFFF0) | variant.kind
        old = self._entities.get(object_id)
        if old is not None:
            if not request.reuse and not request.replace:
                return Status.ERR_ALREADY_EXISTS
            if request.reuse and self._is_same(host, old, variant, little_endian=request.little_endian):
                return Status.OK_MATCHED
            if not request.replace:
                return Status.ERR_MISMATCH
            self.delete(object_id)
        try:
            self._make(host, object_id, variant, little_endian=request.little_endian)
        except _Refused as refusal:
            return refusal.status
        return Status.OK

    def delete(self, object_id: int) -> Status:
        """Remove exactly that object."""
        entity = self._entities.pop(object_id, None)
        if entity is None:
            return Status.ERR_UNKNOWN_REFERENCE
        self._budget.give()
        if entity.endpoint is not None:
            del self.endpoints[object_id]
            entity.endpoint.close()
        if entity.topic is not None:
            entity.participant.release(entity.topic.name)
        return Status.OK

    def clear(self) -> None:
        """Remove everything."""
        for object_id in list(self._entities):
            self.delete(object_id)

    def _is_same(self, host: EndpointHost, old: ClientObject, variant: ObjectVariant, *, little_endian: bool) -> bool:
        try:
            return self._define(host, variant, little_endian=little_endian) == old.definition
        except _Refused:
            return False

    def _make(self, host: EndpointHost, object_id: int, variant: ObjectVariant, *, little_endian: bool) -> None:
        parent = self._parent_of(variant)
        definition = self._define(host, variant, little_endian=little_endian)
        settled = host.is_settled()
        limit = self._settings.max_objects if settled else self._settings.max_objects_unsettled
        if len(self._entities) >= limit or not self._budget.take(settled=settled):
            raise _Refused(Status.ERR_RESOURCES)
        try:
            entity = self._creator.make(host, object_id, definition, parent, self._entities)
        except NoSuchTopic as error:
            self._budget.give()
            logger.debug("object %04X: there is no %s", object_id, error)
            raise _Refused(Status.ERR_DDS_ERROR) from error
        self._entities[object_id] = entity
        if entity.endpoint is not None:
            self.endpoints[object_id] = entity.endpoint

    def _parent_of(self, variant: ObjectVariant) -> ClientObject | None:
        kind = _PARENTS[variant.kind]
        if kind is None:
            return None
        parent = self._entities.get((variant.parent_id & 0xFFF0) | kind)
        if parent is None:
            raise _Refused(Status.ERR_UNKNOWN_REFERENCE)
        return parent

    def _define(self, host: EndpointHost, variant: ObjectVariant, *, little_endian: bool) -> Definition:
        try:
            try:
                return parse_variant(variant, self._references, little_endian=little_endian)
            except RemoteProtocolError:
                if not self._settings.any_text_is_a_name:
                    raise
                return named_by(variant)
        except RemoteProtocolError as error:
            logger.debug("CREATE refused: %s", error)
            host.dropped.count("CREATE with a representation that cannot be used")
            raise _Refused(Status.ERR_DDS_ERROR) from error
