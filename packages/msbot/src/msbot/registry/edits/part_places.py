"""Where parts belong: people's changes to the memory of which UID is in which slot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple, Self

from sqlalchemy import Connection, delete, or_, select, update

from msbot.registry.database.tables import library, parts, slots
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.edits.slot_values import find_slot
from msbot.registry.records import EditKind, EditRecord, uid_text
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


class SlotMemory(NamedTuple):
    """Where a part belongs: two names of slots."""

    last: str | None = None
    """The slot it was in last."""
    by_hand: str | None = None
    """The slot that a person has put it into."""


NOWHERE = SlotMemory()


@dataclass(frozen=True, slots=True)
class UndoablePlace:
    """Where some parts belong."""

    parts: Mapping[str, SlotMemory]
    """UID -> place."""

    def as_json(self) -> dict[str, object]:
        """See `UndoableChange.as_json`."""
        return {"of": "place", "parts": {uid: list(place) for uid, place in self.parts.items()}}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:
        """See `UndoableChange.as_it_is`."""
        return replace(self, parts=read(connection, robot_id, self.parts))

    def write(self, connection: Connection, author: Author) -> None:
        """See `UndoableChange.write`."""
        for uid, place in self.parts.items():
            last, by_hand = (None if slot is None else find_slot(connection, author.robot, slot)[0] for slot in place)
            this = (parts.c.robot_id == author.robot, parts.c.identity == uid)
            values = {"slot_id": last, "placed_slot_id": by_hand, "changed_ns": author.now_ns}
            connection.execute(update(parts).where(*this).values(values))


def put(
    connection: Connection,
    author: Author,
    uid: bytes,
    slot: str | None,
    *,
    words: str = "",
    by_hand: bool = True,
    before: Mapping[bytes, str | None] | None = None,
) -> EditRecord:
    """Make a part belong in a slot, or in none; others that belonged in that slot now belong nowhere.

    Args:
        connection: an open transaction.
        author: who does it.
        uid: the part; it must have been seen before.
        slot: where it belongs from now on; None: nowhere.
        words: what happened, for people; if empty, composed from the rest.
        by_hand: the part goes into that slot regardless of the rules and the library.
        before: where parts belonged before, if that differs from what is stored now; an undo restores it.

    Raises:
        ConfigError: the part was never seen, has no UID, or there is no such slot.
    """
    identity = check_known(connection, author.robot, uid)
    there = [] if slot is None else read_slot(connection, author.robot, slot)
    after = dict.fromkeys(there, NOWHERE) | {identity: SlotMemory(slot, slot if by_hand else None)}
    name = name_of(connection, author.robot, identity)
    words = words or (
        said("{name} belongs in no slot", name=name)
        if slot is None
        else said("{name} belongs in slot {slot}", name=name, slot=slot)
    )
    return _move(connection, author, after, slot=slot or "", words=words, told=before)


def swap(connection: Connection, author: Author, uid: bytes, slot: str, *, other: bytes = b"") -> EditRecord:
    """Make a part belong in a slot, and `other`, which was there, in the slot the part came from (or nowhere).

    Raises:
        ConfigError: a part was never seen, has no UID, or there is no such slot.
    """
    identity = check_known(connection, author.robot, uid)
    came_from = read(connection, author.robot, [identity])[identity].last
    after = dict.fromkeys(read_slot(connection, author.robot, slot), NOWHERE)
    name, whose = name_of(connection, author.robot, identity), ""
    if other:
        identity_there = check_known(connection, author.robot, other)
        goes_to = None if came_from == slot else came_from
        after[identity_there] = SlotMemory(goes_to, goes_to)
        whose = said(" in place of {name_of}", name_of=name_of(connection, author.robot, identity_there))
    after[identity] = SlotMemory(slot, slot)
    return _move(
        connection,
        author,
        after,
        slot=slot,
        words=said("{name} is swapped into slot {slot}{whose}", name=name, slot=slot, whose=whose),
    )


def _move(
    connection: Connection,
    author: Author,
    places: Mapping[str, SlotMemory],
    *,
    slot: str,
    words: str,
    told: Mapping[bytes, str | None] | None = None,
) -> EditRecord:
    after = UndoablePlace(places)
    before = after.as_it_is(connection, author.robot)
    if told:
        before = UndoablePlace({**before.parts, **{uid.hex(): SlotMemory(where, where) for uid, where in told.items()}})
    after.write(connection, author)
    return record(connection, author, EditKind.PLACE, words, slot=slot, before=before, after=after)


def read(connection: Connection, robot_id: int, uids: Iterable[str] | None = None) -> dict[str, SlotMemory]:
    """Where these parts belong, by UID (None: all that belong anywhere); only slots of the blueprint."""
    last, placed = slots.alias("last"), slots.alias("placed")
    query = (
        select(parts.c.identity, last.c.name.label("last"), placed.c.name.label("placed"))
        .outerjoin(last, (parts.c.slot_id == last.c.id) & last.c.in_blueprint)
        .outerjoin(placed, (parts.c.placed_slot_id == placed.c.id) & placed.c.in_blueprint)
        .where(parts.c.robot_id == robot_id, parts.c.uid != "")
    )
    if uids is None:
        query = query.where(or_(last.c.id.is_not(None), placed.c.id.is_not(None)))
        return {row.identity: SlotMemory(row.last, row.placed) for row in connection.execute(query)}
    wanted = list(uids)
    found = connection.execute(query.where(parts.c.identity.in_(wanted)))
    return dict.fromkeys(wanted, NOWHERE) | {row.identity: SlotMemory(row.last, row.placed) for row in found}


def read_slot(connection: Connection, robot_id: int, slot: str) -> list[str]:
    """The UIDs of the parts that belong in a slot."""
    query = (
        select(parts.c.identity)
        .join(slots, or_(parts.c.slot_id == slots.c.id, parts.c.placed_slot_id == slots.c.id))
        .where(parts.c.robot_id == robot_id, parts.c.uid != "", slots.c.robot_id == robot_id, slots.c.name == slot)
    )
    return list(connection.execute(query.order_by(parts.c.identity)).scalars().unique())


def check_known(connection: Connection, robot_id: int, uid: bytes) -> str:
    """The UID as text, provided that the robot has seen that part.

    Raises:
        ConfigError: it has no UID, or was never seen here.
    """
    identity = uid_text(uid)
    if not identity:
        raise ConfigError(said("a part without a UID cannot be given a place: the robot would not know it again"))
    known = select(parts.c.identity).where(parts.c.robot_id == robot_id, parts.c.identity == identity)
    if connection.execute(known).scalar() is None:
        raise ConfigError(said("no part with UID {identity} was ever seen here: plug it in first", identity=identity))
    return identity


def name_of(connection: Connection, robot_id: int, identity: str) -> str:
    """What people call that part: its local name, else its part number and UID."""
    query = select(parts.c.local_name, parts.c.part_number)
    row = connection.execute(query.where(parts.c.robot_id == robot_id, parts.c.identity == identity)).one()
    name: str = row.local_name
    return name or f"{row.part_number} {identity}"


# Part types that people take out of the library while the robot runs.


def forget_part_type(connection: Connection, author: Author, number: str) -> EditRecord:
    """Delete a part type that no robot of the database has a slot for.

    Raises:
        ConfigError: a robot has one.
    """
    used = select(slots.c.name).where(slots.c.part_number == number, slots.c.in_blueprint).limit(1)
    if (slot := connection.execute(used).scalar()) is not None:
        raise ConfigError(said("{number} has slots: {slots}; take them out first", number=number, slots=slot))
    connection.execute(delete(library).where(library.c.number == number))
    words = said("{number} is forgotten: the library does not know it any more", number=number)
    return record(connection, author, EditKind.LIBRARY, words)
