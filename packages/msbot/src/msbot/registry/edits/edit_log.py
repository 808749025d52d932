"""The list of what people changed: one row for each edit, with the state before and after it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, Self

from sqlalchemy import ColumnElement, Connection, Row, delete, func, select, update

from msbot.registry.blueprint import blueprint_snapshot
from msbot.registry.database.tables import edits
from msbot.registry.records import UNDOABLE, EditKind, EditRecord
from msbot_agent.text.sentence import from_json, to_json
from msbot_xrce.lazy import dataclass

EDITS_KEPT = 10_000
"""How many edits of a robot are kept; of more, the oldest of the person with most of them gives way.

Else a pupil could set a value again and again until nobody sees any more what others have changed.
"""


@dataclass(frozen=True, slots=True)
class Author:
    """Who makes an edit, when, and on which robot."""

    robot_id: int | None
    """None: it concerns all robots of the database."""
    who: str
    now_ns: int

    @property
    def robot(self) -> int:
        """The robot's number."""
        assert self.robot_id is not None
        return self.robot_id


class UndoableChange(Protocol):
    """What an edit changes, with its content: the value of a parameter, where parts belong, a block, the ends of a
    topic, or everything that a blueprint decides."""

    def as_json(self) -> dict[str, object]:
        """The cell as the row stores it."""

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:
        """The same cell with its present content."""

    def write(self, connection: Connection, author: Author) -> None:
        """Write this content to the database; raises ConfigError when a slot is gone."""


def record(
    connection: Connection,
    author: Author,
    kind: EditKind,
    words: str,
    *,
    slot: str = "",
    before: UndoableChange | None = None,
    after: UndoableChange | None = None,
) -> EditRecord:
    """Write one line of the list; the caller makes the change itself."""
    row = {
        "robot_id": author.robot_id,
        "at_ns": author.now_ns,
        "who": author.who,
        "kind": kind.value,
        "slot": slot,
        "words": words,
        "said": to_json(words),
        "before": {} if before is None else before.as_json(),
        "after": {} if after is None else after.as_json(),
    }
    made = connection.execute(edits.insert().values(row))
    assert made.inserted_primary_key is not None
    (number,) = made.inserted_primary_key
    _make_room(connection, author.robot_id)
    found = connection.execute(select(edits).where(edits.c.id == number)).one()
    return _edit(found)


def _make_room(connection: Connection, robot_id: int | None) -> None:
    these = edits_of(robot_id)
    beyond = select(edits.c.id).where(these).order_by(edits.c.id.desc()).offset(EDITS_KEPT).limit(1)
    if connection.execute(beyond).first() is None:
        return
    oldest = func.min(edits.c.id)
    of_most = select(oldest).where(these).group_by(edits.c.who).order_by(func.count().desc(), oldest).limit(1)
    connection.execute(delete(edits).where(edits.c.id == connection.execute(of_most).scalar()))


def reword(connection: Connection, number: int, words: str) -> None:
    """Have one line of the list say something else."""
    connection.execute(update(edits).where(edits.c.id == number).values(words=words, said=to_json(words)))


def read_edits(connection: Connection, robot_id: int | None, limit: int) -> list[EditRecord]:
    """The most recent edits, newest first; without a robot, those that concern all robots."""
    query = select(edits).where(edits_of(robot_id)).order_by(edits.c.id.desc()).limit(limit)
    return [_edit(row) for row in connection.execute(query)]


def edits_of(robot_id: int | None) -> ColumnElement[bool]:
    """The condition for the rows of a robot."""
    return edits.c.robot_id.is_(None) if robot_id is None else edits.c.robot_id == robot_id


def _edit(row: Row[tuple[object, ...]]) -> EditRecord:
    return EditRecord(
        id=row.id,
        at_ns=row.at_ns,
        who=row.who,
        kind=row.kind,
        slot=row.slot,
        words=words_of(row),
        undone=row.undone_by is not None,
        slots=_slots_of(row.before, row.after),
        placed=_placed(row.after),
        placed_before=_placed(row.before),
        can_be_undone=row.undone_by is None and row.kind in UNDOABLE,
        is_kept=bool(row.before),
    )


def words_of(row: Row[tuple[object, ...]]) -> str:
    """What the edit of a row did, as a sentence that can be translated."""
    return str(row.words) if row.said is None else from_json(row.said)


def _placed(cell: Mapping[str, dict[str, list[str | None]]]) -> tuple[tuple[bytes, str | None], ...]:
    return tuple((bytes.fromhex(uid), place[0]) for uid, place in cell.get("parts", {}).items())


def _slots_of(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[str, ...]:
    """Slots whose configuration an edit changes."""
    match after.get("of"):
        case "value":
            return (str(after["slot"]),)
        case "bind":
            old, new = before["ends"], after["ends"]
            return tuple(sorted({end[0] for end in (*old, *new) if end not in old or end not in new}))
        case "binds":
            pairs = zip(before["topics"], after["topics"], strict=True)
            return tuple(sorted({slot for old, new in pairs for slot in _slots_of(old, new)}))
        case "apply":
            return blueprint_snapshot.slots_of(before["robot"], after["robot"])
        case _:
            return ()
