"""What a robot knows of a part: people may have it forget a part that is gone, and take that back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self

from sqlalchemy import Connection, delete, select

from msbot.registry.database.statements import upsert
from msbot.registry.database.tables import parts, slots
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.records import EditKind, EditRecord, PartRecord, uid_text
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_PLACES = {"slot_id": "slot", "placed_slot_id": "placed"}
"""Columns with the number of a slot -> where a cell has its name: numbers change when a blueprint is applied anew."""


@dataclass(frozen=True, slots=True)
class UndoableKnowledge:
    """What a robot knows of one part."""

    identity: str
    """The UID; part number and local name when it has none."""
    known: Mapping[str, Any] | None
    """Its row; None: the robot does not know the part."""

    def as_json(self) -> dict[str, object]:
        """See `UndoableChange.as_json`."""
        return {"of": "part", "identity": self.identity, "known": self.known}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:
        """See `UndoableChange.as_it_is`."""
        query = select(parts).where(parts.c.robot_id == robot_id, parts.c.identity == self.identity)
        row = connection.execute(query).mappings().one_or_none()
        if row is None:
            return replace(self, known=None)
        names = {key: _slot_name(connection, row[column]) for column, key in _PLACES.items()}
        rest = {key: value for key, value in row.items() if key not in ("robot_id", "identity", *_PLACES)}
        return replace(self, known={**rest, **names})

    def write(self, connection: Connection, author: Author) -> None:
        """See `UndoableChange.write`; of slots that are gone meanwhile the part knows nothing."""
        key = {"robot_id": author.robot, "identity": self.identity}
        if self.known is None:
            here = (parts.c.robot_id == author.robot, parts.c.identity == self.identity)
            connection.execute(delete(parts).where(*here))
            return
        values = {name: value for name, value in self.known.items() if name not in _PLACES.values()}
        numbers = {column: _slot_number(connection, author, self.known[name]) for column, name in _PLACES.items()}
        upsert(connection, parts, key, values | numbers)


def identity_text(part: PartRecord) -> str:
    """By what the database tells a part from others."""
    return uid_text(part.uid) or f"{part.part_number}/{part.local_name}"


def forget(connection: Connection, author: Author, part: PartRecord) -> EditRecord:
    """Forget a part: where it belongs, and that it was ever there. The journal keeps its lines.

    Raises:
        ConfigError: it is forgotten already.
    """
    after = UndoableKnowledge(identity_text(part), None)
    before = after.as_it_is(connection, author.robot)
    if before.known is None:
        raise ConfigError(said("{part} is forgotten already", part=part.name))
    after.write(connection, author)
    words = said("{part} ({part_number}) is forgotten", part=part.name, part_number=part.part_number)
    return record(connection, author, EditKind.PLACE, words, slot=part.slot or "", before=before, after=after)


def _slot_name(connection: Connection, number: int | None) -> str | None:
    return None if number is None else connection.execute(select(slots.c.name).where(slots.c.id == number)).scalar()


def _slot_number(connection: Connection, author: Author, name: str | None) -> int | None:
    if name is None:
        return None
    query = select(slots.c.id).where(slots.c.robot_id == author.robot, slots.c.name == name, slots.c.in_blueprint)
    return connection.execute(query).scalar()
