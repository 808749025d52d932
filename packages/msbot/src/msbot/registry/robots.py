"""The robots of a database: their blueprints, their parts and what happened to them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from sqlalchemy import Connection, func, select

from msbot.config import Blueprint, Difference, Library
from msbot.pnp import PartState
from msbot.registry.blueprint import blueprint_reader, blueprint_store
from msbot.registry.database import statements
from msbot.registry.database.statements import journal_entry, list_robots
from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import edits, journal, library, parts, robots, slots
from msbot.registry.edits import slot_values, undo
from msbot.registry.read_only_database import without_master
from msbot.registry.records import EditRecord, JournalEntry, PartRecord, RobotRecord, ValueRecord
from msbot.registry.running.runs import Runs
from msbot_xrce.lazy import dataclass

# A look at all robots of a database at once, for the class: a few queries, however many robots there are.


_REGISTERED = [state.value for state in PartState if state.is_registered]


@dataclass(frozen=True, slots=True)
class RobotInClass:
    """One robot of the database in short."""

    robot: RobotRecord
    slots: int
    """Of its blueprint."""
    filled: int
    """Those with a part that is in, as was stored last; says nothing of a robot that nobody runs."""
    newest: JournalEntry | None
    """The newest line of its journal."""
    newest_edit: int
    """Number of the newest change that people made to it; 0: none."""


def look_at_class(connection: Connection) -> Sequence[RobotInClass]:
    """All robots, the most recently used first."""
    has = select(slots.c.robot_id, func.count()).where(slots.c.in_blueprint).group_by(slots.c.robot_id)
    held = (
        select(parts.c.robot_id, func.count(slots.c.id.distinct()))
        .join(slots, parts.c.slot_id == slots.c.id)
        .where(slots.c.in_blueprint, parts.c.state.in_(_REGISTERED))
        .group_by(parts.c.robot_id)
    )
    last = select(func.max(journal.c.id)).group_by(journal.c.robot_id)
    lines = select(journal, robots.c.name.label("robot")).join(robots, journal.c.robot_id == robots.c.id)
    changed = select(edits.c.robot_id, func.max(edits.c.id)).where(edits.c.robot_id.is_not(None))
    of_slots, of_filled, of_edits = (
        {int(robot): int(count) for robot, count in connection.execute(query)}
        for query in (has, held, changed.group_by(edits.c.robot_id))
    )
    newest = {row.robot_id: journal_entry(row) for row in connection.execute(lines.where(journal.c.id.in_(last)))}
    return [
        RobotInClass(
            one, of_slots.get(one.id, 0), of_filled.get(one.id, 0), newest.get(one.id), of_edits.get(one.id, 0)
        )
        for one in list_robots(connection)
    ]


class Robots:
    """Reads what the database knows about robots, and applies blueprints. Every method may raise `RegistryError`."""

    def __init__(self, storage: Storage, runs: Runs) -> None:
        self._storage = storage
        self._runs = runs

    def apply_blueprint(self, blueprint: Blueprint, library: Library, who: str = "msbot") -> RobotRecord:
        """Store or update a robot, its slots, bindings, settings and the library, all or nothing.

        The memory of which part was in which slot, the values set by hand, and the journal are kept. A change to an
        existing robot is an edit by `who` and can be undone.

        Raises:
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self.change_blueprint(blueprint, library, who)[0]

    def change_blueprint(
        self, blueprint: Blueprint, library: Library, who: str, *, slot_by_hand: str = ""
    ) -> tuple[RobotRecord, EditRecord | None]:
        """The same; also returns the edit, None when nothing changes.

        With `slot_by_hand`, a person makes that slot, if the blueprint has it, or takes it out, if it has not; a slot
        that a person has made stays when a blueprint without it is applied.

        Raises:
            RegistryError: the database cannot be written; nothing has changed.
        """
        now_ns = self._storage.epoch_ns()
        return self._storage.change(
            lambda connection: undo.apply_blueprint(
                connection, blueprint, library, who=who, now_ns=now_ns, slot_by_hand=slot_by_hand
            )
        )

    def type_differences(self, library: Library) -> tuple[Difference, ...]:
        """What applying a blueprint with that library changes of part types, besides those that MsBOT brings."""
        return self._storage.read(partial(blueprint_store.type_differences, part_types=library))

    def all(self) -> list[RobotRecord]:
        """All robots of the database, the most recently used first."""
        return self._storage.read(statements.list_robots)

    def in_class(self) -> Sequence[RobotInClass]:
        """All robots in short, by a few queries."""
        self._storage.catch_up()
        return self._storage.read(look_at_class)

    def find(self, blueprint: Blueprint) -> RobotRecord | None:
        """The robot of a blueprint: the one with its name and serial number."""
        profile = blueprint.robot
        find = partial(statements.find_robot, name=profile.name, serial_number=profile.serial_number)
        return self._storage.read(find)

    def blueprint(self, robot: RobotRecord, *, by_hand: bool = True) -> Blueprint:
        """What the database knows about a robot, as a blueprint.

        Args:
            robot: which one.
            by_hand: include what people set by hand; otherwise as the blueprint was last applied.
        """
        return self._storage.read(partial(blueprint_reader.read, robot_id=robot.id, by_hand=by_hand))

    def made_by_hand(self, robot: RobotRecord) -> dict[tuple[str, str], str]:
        """(slot, parameter), (topic, "") or ("", slot) of everything made by hand -> by whom, in words."""
        return self._storage.read(partial(blueprint_reader.read_notes, robot_id=robot.id))

    def slot_names(self, robot: RobotRecord) -> list[str]:
        """The slots of the robot's blueprint, in its order."""
        return [slot.name for slot in self._storage.read(partial(statements.list_slots, robot_id=robot.id))]

    def slot_types(self, robot: RobotRecord) -> list[tuple[str, list[str], list[str]]]:
        """Each slot of the robot's blueprint with the names of its ports and parameters, as the library has them."""
        query = (
            select(slots.c.name, library.c.ports, library.c.parameters)
            .join(library, library.c.number == slots.c.part_number)
            .where(slots.c.robot_id == robot.id, slots.c.in_blueprint)
            .order_by(slots.c.position)
        )
        rows = self._storage.read(lambda connection: connection.execute(query).all())
        return [(name, [one["name"] for one in ports], [one["name"] for one in named]) for name, ports, named in rows]

    def values(self, robot: RobotRecord, slot: str) -> tuple[ValueRecord, ...]:
        """The parameters of a slot, their values, and where these come from.

        Raises:
            ConfigError: there is no such slot.
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(slot_values.read_values, robot_id=robot.id, slot=slot))

    def parts(self, robot: RobotRecord | None = None) -> list[PartRecord]:
        """All parts that were ever seen, as they were after their last change of state; those in slots first.

        While nobody runs a robot, none of its parts is active: those that were when the master was killed are lost.
        """
        records = []
        for one in self.all() if robot is None else [robot]:
            found = self._storage.read(partial(statements.list_parts, robot_id=one.id))
            records.extend(found if self._runs.is_run(one) else [without_master(record) for record in found])
        return records

    def journal(
        self, limit: int = 100, part: str | None = None, *, robot: RobotRecord | None = None, by_name: bool = False
    ) -> list[JournalEntry]:
        """The newest lines of the journal, the oldest of them first.

        Args:
            limit: the most lines to return.
            part: only lines about this part: its name, slot, local name, part number or UID; case does not matter.
            robot: only lines about this robot.
            by_name: no part is found by what only teachers see: UID and address.
        """
        robot_id = None if robot is None else robot.id
        self._storage.catch_up()
        return self._storage.read(
            partial(statements.read_journal, robot_id=robot_id, part=part, limit=limit, by_name=by_name)
        )
