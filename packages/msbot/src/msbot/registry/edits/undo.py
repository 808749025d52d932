"""Undoing an edit: its cell is restored to its content before, as an edit of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self

from sqlalchemy import Connection, Row, delete, select, update

from msbot.config import Blueprint, Library
from msbot.registry.blueprint import blueprint_snapshot, blueprint_store
from msbot.registry.database import statements
from msbot.registry.database.statements import upsert
from msbot.registry.database.tables import blocks, edits
from msbot.registry.edits.edit_log import Author, UndoableChange, edits_of, record, words_of
from msbot.registry.edits.known_parts import UndoableKnowledge
from msbot.registry.edits.part_places import SlotMemory, UndoablePlace
from msbot.registry.edits.slot_values import UndoableSetting
from msbot.registry.edits.wires import UndoableTopic, UndoableTopics
from msbot.registry.records import UNDOABLE, EditKind, EditRecord, RobotRecord
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

# Blocks: parts that are not let in whatever they claim, by UID, or all parts of a part number.


@dataclass(frozen=True, slots=True)
class UndoableBlock:
    """Whether, and why, a UID or a part number is blocked."""

    kind: str
    """`uid` or `number`."""
    key: str
    """The UID, 16 hexadecimal digits, or the part number."""
    reason: str
    """Empty: it is not blocked."""

    def as_json(self) -> dict[str, object]:
        """See `UndoableChange.as_json`."""
        return {"of": "block", "kind": self.kind, "key": self.key, "reason": self.reason}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:  # noqa: ARG002 - blocks hold for all robots
        """See `UndoableChange.as_it_is`."""
        query = select(blocks.c.reason).where(blocks.c.kind == self.kind, blocks.c.key == self.key)
        return replace(self, reason=connection.execute(query).scalar() or "")

    def write(self, connection: Connection, author: Author) -> None:
        """See `UndoableChange.write`."""
        key = {"kind": self.kind, "key": self.key}
        if self.reason:
            upsert(connection, blocks, key, {"reason": self.reason, "since_ns": author.now_ns})
        else:
            connection.execute(delete(blocks).where(blocks.c.kind == self.kind, blocks.c.key == self.key))


def block(connection: Connection, author: Author, kind: str, key: str, reason: str) -> EditRecord:
    """Keep a UID or a part number out."""
    reason = reason or said("no reason given")
    return _write(connection, author, UndoableBlock(kind, key, reason), "{part} is blocked: {reason}")


def unblock(connection: Connection, author: Author, kind: str, key: str) -> EditRecord:
    """Let a UID or part number in again.

    Raises:
        ConfigError: it is not blocked.
    """
    return _write(connection, author, UndoableBlock(kind, key, ""), "{part} is let in again")


def _write(connection: Connection, author: Author, after: UndoableBlock, form: str) -> EditRecord:
    before = after.as_it_is(connection, author.robot)
    what = (
        said("part number {key}", key=after.key)
        if after.kind == "number"
        else said("part with UID {key}", key=after.key)
    )
    if not after.reason and not before.reason:
        raise ConfigError(said("{part} is not blocked", part=what))
    after.write(connection, author)
    words = said(form, part=what, reason=after.reason)
    return record(connection, author, EditKind.BLOCK, words, before=before, after=after)


@dataclass(frozen=True, slots=True)
class UndoableBlueprint:
    """Everything that a blueprint decides about a robot."""

    content: blueprint_snapshot.Content

    def as_json(self) -> dict[str, object]:
        """See `UndoableChange.as_json`."""
        return {"of": "apply", "robot": self.content}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:
        """See `UndoableChange.as_it_is`."""
        return type(self)(blueprint_snapshot.read(connection, robot_id, like=self.content))

    def write(self, connection: Connection, author: Author) -> None:
        """See `UndoableChange.write`."""
        blueprint_snapshot.write(connection, author.robot, self.content)


def read_cell(content: Mapping[str, Any]) -> UndoableChange:
    """The cell that a row of the edits stores, even one written by an older MsBOT."""
    match content["of"]:
        case "value":
            return UndoableSetting(content["slot"], content["name"], content["value"])
        case "place":
            return UndoablePlace({uid: SlotMemory(*place) for uid, place in content["parts"].items()})
        case "part":
            return UndoableKnowledge(content["identity"], content["known"])
        case "block":
            return UndoableBlock(content["kind"], content["key"], content["reason"])
        case "bind":
            return UndoableTopic.from_json(content)
        case "binds":
            return UndoableTopics.from_json(content)
        case _:
            return UndoableBlueprint(content["robot"])


def undo(connection: Connection, author: Author, number: int | None) -> EditRecord:
    """Undo an edit: the newest that is not undone, if none is given; an undo can be undone, too.

    `slots` and `placed` of the result say what is different now.

    Raises:
        ConfigError: there is no such edit, it is already undone, or what it changed has been changed again since.
    """
    row = _find(connection, author.robot, number)
    if not row.before:
        raise ConfigError(said("change {id} ({edit}) cannot be undone: change it again", id=row.id, edit=words_of(row)))
    before, after = read_cell(row.before), read_cell(row.after)
    if not isinstance(after, UndoablePlace) and after.as_it_is(connection, author.robot) != after:
        raise ConfigError(
            said(
                "change {id} ({edit}) cannot be undone: it has been changed since; undo what came later first",
                id=row.id,
                edit=words_of(row),
            )
        )
    before.write(connection, author)
    words = _undone_words(connection, row)
    made = record(connection, author, EditKind.UNDO, words, slot=row.slot, before=after, after=before)
    connection.execute(update(edits).where(edits.c.undone_by == row.id).values(undone_by=None))
    connection.execute(update(edits).where(edits.c.id == row.id).values(undone_by=made.id))
    return made


def _undone_words(connection: Connection, row: Row[tuple[object, ...]]) -> Sentence:
    """What an undo does; that of an undo names what counts again, not a chain of undos."""
    again = False
    while row.kind == EditKind.UNDO.value:
        undone = connection.execute(select(edits).where(edits.c.undone_by == row.id)).one_or_none()
        if undone is None:  # it was taken back itself meanwhile, or is no longer kept
            break
        row, again = undone, not again
    form = "change {id} made again: {edit}" if again else "change {id} undone: {edit}"
    return said(form, id=row.id, edit=words_of(row))


def apply_blueprint(
    connection: Connection, blueprint: Blueprint, library: Library, *, who: str, now_ns: int, slot_by_hand: str = ""
) -> tuple[RobotRecord, EditRecord | None]:
    """Apply a blueprint; its changes to an existing robot are recorded as an edit.

    `slot_by_hand` is the one slot that a person makes or takes out thereby, see `blueprint_store.apply`.
    """
    old = statements.find_robot(connection, blueprint.robot.name, blueprint.robot.serial_number)
    before = None if old is None else blueprint_snapshot.read(connection, old.id)
    robot = blueprint_store.apply(connection, blueprint, library, now_ns, slot_by_hand=slot_by_hand)
    if before is None or before == (after := blueprint_snapshot.read(connection, robot.id)):
        return robot, None
    made = blueprint.slot(slot_by_hand)
    if made is not None:
        words = said("slot {slot} is made, for {part}", slot=slot_by_hand, part=made.part_number)
    elif slot_by_hand:
        words = said("slot {slot} is taken out", slot=slot_by_hand)
    else:
        words = said(
            "the blueprint of {robot} is applied: {difference}",
            robot=robot.name,
            difference=blueprint_snapshot.difference_words(before, after),
        )
    author = Author(robot.id, who, now_ns)
    return robot, record(
        connection, author, EditKind.APPLY, words, before=UndoableBlueprint(before), after=UndoableBlueprint(after)
    )


def _find(connection: Connection, robot_id: int, number: int | None) -> Row[tuple[object, ...]]:
    query = select(edits).where(edits_of(robot_id))
    if number is None:
        newest = query.where(edits.c.undone_by.is_(None), edits.c.kind.in_(UNDOABLE))
        row = connection.execute(newest.order_by(edits.c.id.desc()).limit(1)).one_or_none()
        if row is None:
            raise ConfigError(said("there is nothing to undo"))
        return row
    row = connection.execute(query.where(edits.c.id == number)).one_or_none()
    if row is None:
        raise ConfigError(
            said(
                "there is no change {number} of this robot; the last ones are shown by `msbot undo --list`",
                number=number,
            )
        )
    if row.undone_by is not None:
        raise ConfigError(
            said(
                "change {number} ({edit}) is undone already, by change {undone_by}",
                number=number,
                edit=words_of(row),
                undone_by=row.undone_by,
            )
        )
    return row
