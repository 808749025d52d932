"""What people change, one row for each change, with the state before and after: whatever was done can be undone.

An edit keeps the *cells* it touches as they were and as they are: the value of a parameter, where parts belong, a
block, the ends of a topic, or all of a robot's tables. To undo it is to write the old cells, as an edit of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sqlalchemy import ColumnElement, Connection, Row, delete, select, update

from msbot.errors import ConfigError
from msbot.registry import places, snapshot, store, values, wires
from msbot.registry.records import EditRecord
from msbot.registry.tables import blocks, edits

EDITS_KEPT = 10_000
"""Edits of a robot that are kept."""

NOT_UNDONE = ("undo", "stop", "go", "window")
"""Kinds that an undo without a number passes over."""

Cells = Mapping[str, object]
"""What an edit touches: `of` says what it is, the rest which and with which content."""


@dataclass(frozen=True, slots=True)
class Author:
    """Whose edit it is, and when and where."""

    robot_id: int | None
    """None: it concerns all robots of the database."""
    who: str
    now_ns: int


def record(
    connection: Connection, author: Author, kind: str, words: str, *, slot: str = "", before: Cells, after: Cells
) -> EditRecord:
    """Write one line; the change itself is the caller's."""
    row = {
        "robot_id": author.robot_id,
        "at_ns": author.now_ns,
        "who": author.who,
        "kind": kind,
        "slot": slot,
        "words": words,
        "before": dict(before),
        "after": dict(after),
    }
    (number,) = connection.execute(edits.insert().values(row)).inserted_primary_key or (0,)
    connection.execute(delete(edits).where(_of(author.robot_id), edits.c.id <= number - EDITS_KEPT))
    found = connection.execute(select(edits).where(edits.c.id == number)).one()
    return _edit(found)


def read_edits(connection: Connection, robot_id: int | None, limit: int) -> list[EditRecord]:
    """The newest edits, the newest first; without a robot those that concern all."""
    query = select(edits).where(_of(robot_id)).order_by(edits.c.id.desc()).limit(limit)
    return [_edit(row) for row in connection.execute(query)]


def undo(connection: Connection, author: Author, number: int | None) -> EditRecord:
    """Take an edit back, the newest that is not undone if none is named; an undo can be undone, too.

    Raises:
        ConfigError: there is no such edit, it is undone already, or what it changed has been changed since.
    """
    row = _find(connection, author.robot_id, number)
    before, after = dict(row.before), dict(row.after)
    if not before:
        raise ConfigError(f"edit {row.id} ({row.words}) cannot be undone: change it again")
    if after["of"] != "place" and read_cells(connection, author, after) != after:
        raise ConfigError(
            f"edit {row.id} ({row.words}) cannot be undone: it has been changed since; undo what came later first"
        )
    write_cells(connection, author, before)
    words = f"edit {row.id} undone: {row.words}"
    made = record(connection, author, "undo", words, slot=row.slot, before=after, after=before)
    connection.execute(update(edits).where(edits.c.undone_by == row.id).values(undone_by=None))
    connection.execute(update(edits).where(edits.c.id == row.id).values(undone_by=made.id))
    return made


def _find(connection: Connection, robot_id: int | None, number: int | None) -> Row[tuple[object, ...]]:
    query = select(edits).where(_of(robot_id))
    if number is None:
        query = (
            query.where(edits.c.undone_by.is_(None), edits.c.kind.not_in(NOT_UNDONE))
            .order_by(edits.c.id.desc())
            .limit(1)
        )
        row = connection.execute(query).one_or_none()
        if row is None:
            raise ConfigError("there is nothing to undo")
        return row
    row = connection.execute(query.where(edits.c.id == number)).one_or_none()
    if row is None:
        raise ConfigError(f"there is no edit {number} of this robot; the last ones are shown by `msbot undo --list`")
    if row.undone_by is not None:
        raise ConfigError(f"edit {number} ({row.words}) is undone already, by edit {row.undone_by}")
    return row


def read_cells(connection: Connection, author: Author, like: Cells) -> Cells:
    """The same cells as they are now."""
    robot_id = _robot(author)
    match like["of"]:
        case "value":
            slot, name = str(like["slot"]), str(like["name"])
            return {**like, "value": values.hand_value(connection, robot_id, slot, name)}
        case "place":
            return {**like, "parts": places.read(connection, robot_id, _parts(like))}
        case "block":
            where = (blocks.c.kind == like["kind"], blocks.c.key == like["key"])
            return {**like, "reason": connection.execute(select(blocks.c.reason).where(*where)).scalar() or ""}
        case "bind":
            return {**like, "ends": wires.read_topic(connection, robot_id, str(like["topic"]))}
        case _:
            return {**like, "robot": snapshot.read(connection, robot_id)}


def write_cells(connection: Connection, author: Author, cells: Cells) -> None:
    """Put cells as they are said to be.

    Raises:
        ConfigError: a slot is no more.
    """
    robot_id = _robot(author)
    match cells["of"]:
        case "value":
            slot, name, value = str(cells["slot"]), str(cells["name"]), cells["value"]
            assert value is None or isinstance(value, bool | int | float | str)
            values.write_hand_value(connection, robot_id, slot, name, value, who=author.who, now_ns=author.now_ns)
            store.bump_versions(connection, robot_id, [slot])
        case "place":
            places.write(connection, robot_id, _parts(cells), author.now_ns)
        case "block":
            kind, key, reason = str(cells["kind"]), str(cells["key"]), str(cells["reason"])
            store.write_block(connection, kind, key, reason, author.now_ns)
        case "bind":
            ends = cells["ends"]
            assert isinstance(ends, list)
            wires.write_topic(connection, robot_id, str(cells["topic"]), ends)
        case _:
            content = cells["robot"]
            assert isinstance(content, dict)
            snapshot.write(connection, robot_id, content)


def _robot(author: Author) -> int:
    assert author.robot_id is not None
    return author.robot_id


def _parts(cells: Cells) -> dict[str, places.Place]:
    parts = cells["parts"]
    assert isinstance(parts, dict)
    return parts


def _of(robot_id: int | None) -> ColumnElement[bool]:
    return edits.c.robot_id.is_(None) if robot_id is None else edits.c.robot_id == robot_id


def _edit(row: Row[tuple[object, ...]]) -> EditRecord:
    before, after = row.before, row.after
    return EditRecord(
        id=row.id,
        at_ns=row.at_ns,
        who=row.who,
        kind=row.kind,
        slot=row.slot,
        words=row.words,
        undone=row.undone_by is not None,
        slots=_slots_of(before, after),
        placed=_placed(after),
        placed_before=_placed(before),
        can_be_undone=row.undone_by is None and row.kind not in NOT_UNDONE,
    )


def _placed(cells: Mapping[str, dict[str, list[str | None]]]) -> tuple[tuple[bytes, str | None], ...]:
    return tuple((bytes.fromhex(uid), place[0]) for uid, place in cells.get("parts", {}).items())


def _slots_of(before: Mapping[str, object], after: Mapping[str, object]) -> tuple[str, ...]:
    """Slots whose configuration an edit changes."""
    match after.get("of"):
        case "value":
            return (str(after["slot"]),)
        case "bind":
            old, new = before["ends"], after["ends"]
            assert isinstance(old, list)
            assert isinstance(new, list)
            return tuple(sorted({end[0] for end in (*old, *new) if end not in old or end not in new}))
        case "apply":
            robot_before, robot_after = before["robot"], after["robot"]
            assert isinstance(robot_before, dict)
            assert isinstance(robot_after, dict)
            return snapshot.slots_of(robot_before, robot_after)
        case _:
            return ()
