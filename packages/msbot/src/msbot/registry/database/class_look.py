"""A look at all robots of a database at once, for the class: a few queries, however many robots there are."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import Connection, func, select

from msbot.pnp import PartState
from msbot.registry.database.statements import journal_entry, list_robots
from msbot.registry.database.tables import edits, journal, parts, robots, slots
from msbot.registry.records import JournalEntry, RobotRecord
from msbot_xrce.common.lazy_dataclass import dataclass

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
