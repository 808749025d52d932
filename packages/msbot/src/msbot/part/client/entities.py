"""What a client wants to exist at the agent, and how far the agent has got with it. Pure bookkeeping.

The table is the client's wish list: it outlives every session. After a reconnection all entities are requested again,
parents first, together with their reads; nobody else has to remember anything.
"""

from __future__ import annotations

from collections.abc import Iterator

from msbot_xrce import Status
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import DeliveryControl, ObjectKind, ObjectVariant, make_object_id

MAX_UNANSWERED = 12
"""CREATEs without a STATUS at once: an agent with 16 unacknowledged messages loses further ones (seen on the wire)."""

_LAST_NUMBER = 0xFFE


@dataclass(slots=True)
class RunningRead:
    """The running READ_DATA of a data reader, requester or replier."""

    stream_id: int
    """Stream on which the samples should come."""
    control: DeliveryControl | None
    request_id: int = 0
    """Request id in this session; 0 = not asked yet."""


@dataclass(slots=True, eq=False)
class Entity:
    """One object of this client at the agent; a handle for `Client` calls, never changed by its user."""

    object_id: int
    variant: ObjectVariant
    status: int | None = None
    """Status octet of its creation in this session, None = no answer yet."""
    request_id: int = 0
    """Request id of the CREATE in this session; 0 = not asked yet."""
    asked_at: float = 0.0
    reading: RunningRead | None = None

    @property
    def created(self) -> bool:
        """Whether the agent said that it exists, in this session."""
        return self.status is not None and self.status < Status.ERR_DDS_ERROR

    @property
    def refused(self) -> bool:
        """Whether the agent said that it cannot be created, in this session."""
        return self.status is not None and self.status >= Status.ERR_DDS_ERROR

    @property
    def describe(self) -> str:
        """What it is, for messages to a person: `datawriter 0x0015`."""
        return f"{ObjectKind(self.variant.kind).name.lower()} 0x{self.object_id:04X}"


class EntityTable:
    """All entities of one client, in the order in which they were made (parents first)."""

    def __init__(self, *, answer_s: float) -> None:
        """Make an empty table; a CREATE without a STATUS for `answer_s` seconds is asked again."""
        self._answer_s = answer_s
        self._entities: dict[int, Entity] = {}
        self._asked: dict[int, Entity] = {}
        self._next_number: dict[int, int] = {}
        self._settled = True

    def __iter__(self) -> Iterator[Entity]:
        return iter(list(self._entities.values()))

    def __len__(self) -> int:
        return len(self._entities)

    def get(self, object_id: int) -> Entity | None:
        """The entity with that object id, or None."""
        return self._entities.get(object_id)

    def add(self, variant: ObjectVariant, number: int | None = None) -> Entity:
        """Add an entity to the wish list; without a number it gets the next free one of its kind.

        Raises:
            LocalProtocolError: the number is taken, or not within 0 to 0xFFE; or no number is free.
        """
        if number is None:
            number = self._free_number(variant.kind)
        elif not 0 <= number <= _LAST_NUMBER:
            raise LocalProtocolError(f"object number {number} is out of range: choose 0 to {_LAST_NUMBER}")
        entity = Entity(make_object_id(number, variant.kind), variant)
        if entity.object_id in self._entities:
            raise LocalProtocolError(f"{entity.describe} exists already: delete it first or choose another number")
        self._entities[entity.object_id] = entity
        self._settled = False
        return entity

    def want_read(self, entity: Entity, reading: RunningRead) -> None:
        """Add a read of an entity; it replaces an earlier one."""
        entity.reading = reading
        self._settled = False

    def remove(self, entity: Entity) -> bool:
        """Take an entity off the wish list; False when it was not in the table."""
        if self._entities.get(entity.object_id) is not entity:
            return False
        del self._entities[entity.object_id]
        self._asked.pop(entity.request_id, None)
        return True

    def restart(self) -> None:
        """A new session has begun: nothing was asked for in it yet."""
        self._settled = False
        self._asked.clear()
        for entity in self._entities.values():
            entity.status = None
            entity.request_id = 0
            if entity.reading is not None:
                entity.reading.request_id = 0

    def next_to_ask(self, now: float) -> Entity | None:
        """The next entity for which a CREATE should be sent, or None for the moment."""
        if self._settled and not self._asked:
            return None
        overdue = self._overdue(now)
        if overdue is not None:
            return overdue
        if len(self._asked) >= MAX_UNANSWERED:
            return None
        return next((entity for entity in self._entities.values() if entity.request_id == 0), None)

    def next_to_read(self) -> tuple[Entity, RunningRead] | None:
        """The next entity whose READ_DATA should be sent, and that read; only entities whose CREATE is on its way."""
        if self._settled:
            return None
        for entity in self._entities.values():
            reading = entity.reading
            if reading is not None and reading.request_id == 0 and entity.request_id and not entity.refused:
                return entity, reading
        self._settled = all(entity.request_id for entity in self._entities.values())
        return None

    def asked(self, entity: Entity, request_id: int, now: float) -> None:
        """A CREATE for the entity is on its way."""
        self._asked.pop(entity.request_id, None)
        entity.request_id = request_id
        entity.asked_at = now
        self._asked[request_id] = entity

    def answered(self, request_id: int, status: int) -> Entity | None:
        """Record the status of a CREATE; None when it answers something else (a DELETE, a read, an old CREATE)."""
        entity = self._asked.pop(request_id, None)
        if entity is not None:
            entity.status = status
        return entity

    def timer(self) -> float | None:
        """When an unanswered CREATE is to be asked again, or None."""
        oldest = next(iter(self._asked.values()), None)
        return None if oldest is None else oldest.asked_at + self._answer_s

    @property
    def all_answered(self) -> bool:
        """Whether every entity has its status."""
        return all(entity.status is not None for entity in self._entities.values())

    def _overdue(self, now: float) -> Entity | None:
        oldest = next(iter(self._asked.values()), None)
        return oldest if oldest is not None and now >= oldest.asked_at + self._answer_s else None

    def _free_number(self, kind: int) -> int:
        number = self._next_number.get(kind, 1)
        for _ in range(_LAST_NUMBER):
            following = number % _LAST_NUMBER + 1
            if make_object_id(number, kind) not in self._entities:
                self._next_number[kind] = following
                return number
            number = following
        words = f"{ObjectKind(kind).name.lower()}s are there already: delete some first"
        raise LocalProtocolError(f"{_LAST_NUMBER} {words}")
