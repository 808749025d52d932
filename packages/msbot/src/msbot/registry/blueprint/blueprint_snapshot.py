"""Everything that a blueprint decides about a robot, as one value, so that applying a blueprint can be undone."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

from sqlalchemy import ColumnElement, Connection, Table, and_, delete, insert, select, update

from msbot.registry.database.statements import bump_versions, upsert
from msbot.registry.database.tables import bindings, robots, settings, slots
from msbot_agent.text.sentence import said

_NOT_OF_BLUEPRINT = ("id", "applied_ns", "stop")
"""Columns of a robot that no blueprint decides; above all, undoing a blueprint must not end STOP."""
_SLOT_COLUMNS = ("position", "part_number", "local_name", "description", "origin")

Content = Mapping[str, object]
"""What `read` returns; stored as JSON in an edit."""


def read(connection: Connection, robot_id: int, like: Content | None = None) -> dict[str, object]:
    """The robot's row, the slots of its blueprint, their wires and settings; no row numbers, no versions.

    With `like`, only the columns of the robot and of its slots that `like` has: an older MsBOT knew fewer.
    """
    known = None if like is None else like["robot"]
    assert known is None or isinstance(known, dict)
    columns = _SLOT_COLUMNS if like is None else _slot_columns(like)
    robot = connection.execute(select(robots).where(robots.c.id == robot_id)).one()
    found = connection.execute(select(slots).where(_of(robot_id)).order_by(slots.c.position))
    return {
        "robot": {
            name: value
            for name, value in robot._asdict().items()
            if name not in _NOT_OF_BLUEPRINT and (known is None or name in known)
        },
        "slots": {row.name: {column: getattr(row, column) for column in columns} for row in found},
        "bindings": _rows(connection, bindings, robot_id, without=("id", "robot_id", "slot_id")),
        "settings": _rows(connection, settings, robot_id, without=("slot_id",)),
    }


def write(connection: Connection, robot_id: int, content: Content) -> None:
    """Restore the robot to what it was; slots added since are taken out of the blueprint and kept aside."""
    changed = slots_of(read(connection, robot_id), content)
    robot, wanted = content["robot"], content["slots"]
    assert isinstance(robot, dict)
    assert isinstance(wanted, dict)
    connection.execute(
        update(robots)
        .where(robots.c.id == robot_id)
        .values({name: value for name, value in robot.items() if name not in _NOT_OF_BLUEPRINT})
    )
    connection.execute(update(slots).where(slots.c.robot_id == robot_id).values(in_blueprint=False))
    for name, row in wanted.items():
        values = {"origin": "blueprint", **row, "in_blueprint": True}
        upsert(connection, slots, {"robot_id": robot_id, "name": name}, values, configuration_version=1)
    ids = {row.name: row.id for row in connection.execute(select(slots.c.name, slots.c.id).where(_of(robot_id)))}
    connection.execute(delete(bindings).where(bindings.c.robot_id == robot_id))
    connection.execute(delete(settings).where(settings.c.slot_id.in_(select(slots.c.id).where(_of(robot_id)))))
    for table, more in ((bindings, {"robot_id": robot_id}), (settings, {})):
        rows = content[table.name]
        assert isinstance(rows, list)
        if rows:
            plain = [
                {**{name: value for name, value in row.items() if name != "slot"}, **more, "slot_id": ids[row["slot"]]}
                for row in rows
            ]
            connection.execute(insert(table), plain)
    bump_versions(connection, robot_id, changed)


def slots_of(before: Content, after: Content) -> tuple[str, ...]:
    """The slots whose part type, wires or settings differ."""
    old, new = _by_slot(before), _by_slot(after)
    return tuple(sorted(name for name in old.keys() | new.keys() if old.get(name) != new.get(name)))


def difference_words(before: Content, after: Content) -> str:
    """What has changed, in a few words, for example `slot DD is new; AA, BB changed`."""
    old, new = _in_blueprint(before), _in_blueprint(after)
    changed = [name for name in slots_of(before, after) if name in old and name in new]
    parts: list[str] = []
    for names, form in (
        ([name for name in new if name not in old], "new: {slots}"),
        ([name for name in old if name not in new], "gone: {slots}"),
        (changed, "changed: {slots}"),
    ):
        if names:
            some = ", ".join(names[:_MOST_NAMED])
            if len(names) > _MOST_NAMED:
                some = said("{some} and {count} more", some=some, count=len(names) - _MOST_NAMED)
            parts.append(said(form, slots=some))
    if not parts:
        return said("profile, timing, options or descriptions")
    return reduce(lambda one, other: said("{one}; {other}", one=one, other=other), parts)


_MOST_NAMED = 5


def _in_blueprint(content: Content) -> list[str]:
    known = content["slots"]
    assert isinstance(known, dict)
    return list(known)


def _by_slot(content: Content) -> dict[str, list[object]]:
    found: dict[str, list[object]] = {}
    known = content["slots"]
    assert isinstance(known, dict)
    for name, row in known.items():
        found[name] = [row["part_number"]]
    for table in ("bindings", "settings"):
        rows = content[table]
        assert isinstance(rows, list)
        for row in rows:
            found[row["slot"]].append(row)
    return found


def _slot_columns(content: Content) -> tuple[str, ...]:
    known = content["slots"]
    assert isinstance(known, dict)
    return next((tuple(row) for row in known.values()), _SLOT_COLUMNS)


def _rows(connection: Connection, table: Table, robot_id: int, *, without: tuple[str, ...]) -> list[dict[str, object]]:
    """The rows of the robot's slots, with the slot's name in place of its number."""
    query = select(table, slots.c.name.label("slot")).join(slots, table.c.slot_id == slots.c.id)
    rows = connection.execute(query.where(_of(robot_id)).order_by(*table.primary_key.columns))
    return [{name: value for name, value in row._asdict().items() if name not in without} for row in rows]


def _of(robot_id: int) -> ColumnElement[bool]:
    return and_(slots.c.robot_id == robot_id, slots.c.in_blueprint)
