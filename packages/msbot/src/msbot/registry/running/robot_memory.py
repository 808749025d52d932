"""Everything that a running robot needs from its database, read in one go: it never queries the database again.

What people change, here or in another process, is reloaded by the writer's thread after the change is stored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

from sqlalchemy import Connection, func, select, update

from msbot.config import Blueprint, PartType, Slot
from msbot.pnp import Configuration, Group, StopRecord
from msbot.registry.blueprint import blueprint_reader
from msbot.registry.class_groups import read_groups
from msbot.registry.configurations import read_configurations
from msbot.registry.database.statements import list_slots, read_part_types
from msbot.registry.database.tables import blocks, edits, keys, robots
from msbot.registry.edits import part_places
from msbot.registry.edits.users import list_users
from msbot.registry.records import NOTED, UserRecord
from msbot_xrce.lazy import dataclass

# The latest STOP of a robot, as its database stores it.


def read(connection: Connection, robot_id: int) -> StopRecord | None:
    """The stored record; None: nobody ever said STOP."""
    kept = connection.execute(select(robots.c.stop).where(robots.c.id == robot_id)).scalar_one_or_none()
    return None if kept is None else StopRecord(**kept)


def write(connection: Connection, robot_id: int, record: StopRecord) -> None:
    """Store it in place of the previous one."""
    connection.execute(update(robots).where(robots.c.id == robot_id).values(stop=asdict(record)))


@dataclass(frozen=True, slots=True)
class StoredRobotSnapshot:
    """A robot as its database had it at one moment."""

    newest_edit: int
    """Number of the newest change in the database, of any robot."""
    blueprint: Blueprint
    """The blueprint in force, including what was set by hand."""
    slots: tuple[Slot, ...]
    types: Mapping[str, tuple[PartType, str]]
    """Part number -> the type, and the versions it describes."""
    configurations: Mapping[str, Configuration]
    blocks: Mapping[tuple[str, str], str]
    """(`uid` or `number`, its value) -> why it is blocked."""
    keys: Mapping[str, bytes]
    """UID -> key."""
    places: Mapping[str, part_places.SlotMemory]
    """UID -> where that part belongs."""
    users: tuple[UserRecord, ...]
    groups: tuple[Group, ...]
    """Of a class, by name."""
    stop: StopRecord | None
    """The latest STOP that was stored; None: nobody ever said it."""


_NEWEST_EDIT = select(func.max(edits.c.id))
"""Asked for every second, so made once."""


def read_newest_edit(connection: Connection) -> int:
    """Number of the newest change in the database; 0: there was none."""
    return int(connection.execute(_NEWEST_EDIT).scalar() or 0)


def has_changed(connection: Connection, after: int) -> bool:
    """Whether one of the lines after that number changed something in the database."""
    query = select(edits.c.id).where(edits.c.id > after, edits.c.kind.not_in(NOTED)).limit(1)
    return connection.execute(query).first() is not None


def read_memory(connection: Connection, robot_id: int) -> StoredRobotSnapshot:
    """Read everything."""
    return StoredRobotSnapshot(
        newest_edit=read_newest_edit(connection),
        blueprint=blueprint_reader.read(connection, robot_id, by_hand=True),
        slots=list_slots(connection, robot_id),
        types=read_part_types(connection),
        configurations=read_configurations(connection, robot_id),
        blocks={(row.kind, row.key): row.reason for row in connection.execute(select(blocks))},
        keys={row.uid: bytes(row.key) for row in connection.execute(select(keys.c.uid, keys.c.key))},
        places=part_places.read(connection, robot_id),
        users=tuple(list_users(connection)),
        groups=tuple(read_groups(connection, robot_id)),
        stop=read(connection, robot_id),
    )
