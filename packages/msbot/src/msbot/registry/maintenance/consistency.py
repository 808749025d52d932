"""Contradictions in a database, in sentences. MsBOT itself cannot cause any of them."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import Connection, func, select

from msbot.config import binding_faults
from msbot.registry.blueprint import blueprint_reader
from msbot.registry.database import statements as store
from msbot.registry.database.tables import edits, journal, library, parts, settings, slots, users
from msbot.registry.edits import wires
from msbot.registry.edits.user_statements import ROLES
from msbot_xrce.common.amount import amount

MOST_TOLD = 100
"""At most this many findings are reported."""


def find(connection: Connection) -> list[str]:
    """Everything that is wrong, the worst first."""
    found = list(_damage(connection))
    if found:
        return found[:MOST_TOLD]
    for robot in store.list_robots(connection):
        name = f"robot {robot.name}"
        found += [f"{name}: {sentence}" for sentence in _of_robot(connection, robot.id)]
    found += [*_of_users(connection), *_of_edits(connection)]
    return found[:MOST_TOLD]


def _damage(connection: Connection) -> Iterator[str]:
    """Damage that SQLite finds in its own file; a server looks after itself."""
    if connection.dialect.name != "sqlite":
        return
    for (words,) in connection.exec_driver_sql("PRAGMA integrity_check"):
        if words != "ok":
            yield f"the file is damaged: {words}"
    for table, number, other, _ in connection.exec_driver_sql("PRAGMA foreign_key_check"):
        yield f"row {number} of {table} refers to a row of {other} that is not there"


def _of_robot(connection: Connection, robot_id: int) -> Iterator[str]:
    mine = slots.c.robot_id == robot_id
    unknown = select(slots.c.name, slots.c.part_number).where(
        mine, slots.c.in_blueprint, slots.c.part_number.not_in(select(library.c.number))
    )
    for row in connection.execute(unknown):
        yield f"slot {row.name} wants part number {row.part_number}, which is not in the library"
    bare = select(slots.c.name).where(mine, slots.c.configuration_version < 1)
    for name in connection.execute(bare).scalars():
        yield f"the configuration of slot {name} has no version"
    yield from _of_settings(connection, robot_id)
    wired = blueprint_reader.read_bindings(connection, robot_id)
    yield from binding_faults(wired, wires.read_slots(connection, robot_id), wires.read_library(connection, robot_id))
    for column in (parts.c.slot_id, parts.c.placed_slot_id):
        foreign = select(parts.c.identity).join(slots, column == slots.c.id)
        for identity in connection.execute(
            foreign.where(parts.c.robot_id == robot_id, slots.c.robot_id != robot_id)
        ).scalars():
            yield f"part {identity} is in a slot of another robot"


def _of_settings(connection: Connection, robot_id: int) -> Iterator[str]:
    """Check that every parameter of every slot has the library's value, and that every value has a parameter."""
    query = (
        select(slots.c.name, library.c.parameters, slots.c.id)
        .join(library, slots.c.part_number == library.c.number)
        .where(slots.c.robot_id == robot_id, slots.c.in_blueprint)
    )
    for slot in connection.execute(query.order_by(slots.c.position)).all():
        known = {parameter["name"] for parameter in slot.parameters}
        rows = connection.execute(select(settings.c.name, settings.c.origin).where(settings.c.slot_id == slot.id)).all()
        for name in sorted({row.name for row in rows} - known):
            yield f"slot {slot.name} has a value for {name}, which its part type does not have"
        for name in sorted(known - {row.name for row in rows if row.origin == "library"}):
            yield f"slot {slot.name} has no default for {name}"


def _of_users(connection: Connection) -> Iterator[str]:
    for name, role in connection.execute(select(users.c.name, users.c.role).where(users.c.role.not_in(ROLES))):
        yield f"user {name} has the role {role!r}, which does not exist"


def _of_edits(connection: Connection) -> Iterator[str]:
    undoing = edits.alias("undoing")
    query = select(edits.c.id).outerjoin(undoing, edits.c.undone_by == undoing.c.id)
    # The newest edits are kept, and an undo is newer than what it undoes.
    for number in connection.execute(query.where(edits.c.undone_by.is_not(None), undoing.c.id.is_(None))).scalars():
        yield f"edit {number} was undone by an edit that is not there"
    strange = select(func.count()).select_from(journal).where(journal.c.to_state.not_in(list(store.STATES)))
    if count := connection.execute(strange).scalar():
        lines = amount(count, "line of the journal tells", "lines of the journal tell")
        yield f"{lines} of a state that does not exist"
