"""The groups of a class at a robot: pupils, and the slots that only they may use."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from sqlalchemy import Connection, delete, insert, select

from msbot.pnp import Group
from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import class_groups
from msbot.registry.records import RobotRecord

PUPIL, SLOT = "pupil", "slot"


class ClassGroups:
    """See the module's docstring. Every method waits for the database."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def of(self, robot: RobotRecord) -> list[Group]:
        """The groups of a robot, by name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(read_groups, robot_id=robot.id))

    def replace(self, robot: RobotRecord, groups: Iterable[Group]) -> None:
        """From now on these are the groups of a robot; each pupil and each slot is in one at most.

        Raises:
            RegistryError: the database cannot be written; nothing has changed.
        """
        self._storage.change(partial(_keep, robot_id=robot.id, groups=tuple(groups)))


def remove_from_groups(connection: Connection, pupil: str) -> None:
    """Take a person who is removed out of every group."""
    connection.execute(delete(class_groups).where(class_groups.c.kind == PUPIL, class_groups.c.name == pupil))


def read_groups(connection: Connection, robot_id: int) -> list[Group]:
    """The groups of a robot, by name."""
    columns = class_groups.c
    query = select(class_groups).where(columns.robot_id == robot_id).order_by(columns.group_name, columns.name)
    rows = connection.execute(query).all()
    return [
        Group(
            name,
            tuple(row.name for row in rows if row.group_name == name and row.kind == PUPIL),
            tuple(row.name for row in rows if row.group_name == name and row.kind == SLOT),
        )
        for name in dict.fromkeys(row.group_name for row in rows)
    ]


def _keep(connection: Connection, robot_id: int, groups: tuple[Group, ...]) -> None:
    connection.execute(delete(class_groups).where(class_groups.c.robot_id == robot_id))
    entries = {
        (kind, name): group.name
        for group in groups
        for kind, names in ((PUPIL, group.pupils), (SLOT, group.slots))
        for name in names
    }
    if entries:
        connection.execute(
            insert(class_groups),
            [
                {"robot_id": robot_id, "kind": kind, "name": name, "group_name": group}
                for (kind, name), group in entries.items()
            ],
        )
