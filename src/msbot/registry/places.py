"""Where parts belong: the memory of which UID sits in which slot, when a person changes it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from sqlalchemy import Connection, or_, select, update

from msbot.errors import ConfigError
from msbot.registry.records import uid_text
from msbot.registry.tables import parts, slots
from msbot.registry.values import find_slot

Place = Sequence[str | None]
"""Two names of slots: the one a part was in last, and the one a person has put it into."""
NOWHERE: Place = (None, None)


def read(connection: Connection, robot_id: int, uids: Iterable[str] | None = None) -> dict[str, list[str | None]]:
    """Where these parts (all that belong anywhere, if none are named) belong, by UID; only slots of the blueprint."""
    last, placed = slots.alias("last"), slots.alias("placed")
    query = (
        select(parts.c.identity, last.c.name.label("last"), placed.c.name.label("placed"))
        .outerjoin(last, (parts.c.slot_id == last.c.id) & last.c.in_blueprint)
        .outerjoin(placed, (parts.c.placed_slot_id == placed.c.id) & placed.c.in_blueprint)
        .where(parts.c.robot_id == robot_id, parts.c.uid != "")
    )
    if uids is None:
        query = query.where(or_(last.c.id.is_not(None), placed.c.id.is_not(None)))
        return {row.identity: [row.last, row.placed] for row in connection.execute(query)}
    wanted = list(uids)
    found = connection.execute(query.where(parts.c.identity.in_(wanted)))
    return {uid: [None, None] for uid in wanted} | {row.identity: [row.last, row.placed] for row in found}


def read_slot(connection: Connection, robot_id: int, slot: str) -> list[str]:
    """The UIDs of the parts that belong in a slot."""
    query = (
        select(parts.c.identity)
        .join(slots, or_(parts.c.slot_id == slots.c.id, parts.c.placed_slot_id == slots.c.id))
        .where(parts.c.robot_id == robot_id, parts.c.uid != "", slots.c.robot_id == robot_id, slots.c.name == slot)
    )
    return list(connection.execute(query.order_by(parts.c.identity)).scalars().unique())


def write(connection: Connection, robot_id: int, places: Mapping[str, Place], now_ns: int) -> None:
    """Let parts belong elsewhere.

    Raises:
        ConfigError: there is no such slot.
    """
    for uid, place in places.items():
        last, placed = (None if slot is None else find_slot(connection, robot_id, slot)[0] for slot in place)
        this = (parts.c.robot_id == robot_id, parts.c.identity == uid)
        values = {"slot_id": last, "placed_slot_id": placed, "changed_ns": now_ns}
        connection.execute(update(parts).where(*this).values(values))


def check_known(connection: Connection, robot_id: int, uid: bytes) -> str:
    """The UID as text, when the robot has seen that part.

    Raises:
        ConfigError: it has no UID, or was never seen here.
    """
    identity = uid_text(uid)
    if not identity:
        raise ConfigError("a part without a UID cannot be given a place: the robot would not know it again")
    known = select(parts.c.identity).where(parts.c.robot_id == robot_id, parts.c.identity == identity)
    if connection.execute(known).scalar() is None:
        raise ConfigError(f"no part with UID {identity} was ever seen here: plug it in first")
    return identity


def name_of(connection: Connection, robot_id: int, identity: str) -> str:
    """What people call that part: its local name, else its part number and UID."""
    query = select(parts.c.local_name, parts.c.part_number)
    row = connection.execute(query.where(parts.c.robot_id == robot_id, parts.c.identity == identity)).one()
    name: str = row.local_name
    return name or f"{row.part_number} {identity}"
