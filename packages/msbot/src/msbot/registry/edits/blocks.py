"""Blocks: parts that are not let in whatever they claim, by UID, or all parts of a part number."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

from sqlalchemy import Connection, delete, select

from msbot.registry.database.statements import upsert
from msbot.registry.database.tables import blocks
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.records import EditKind, EditRecord
from msbot_agent.text.sentence import said
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError


@dataclass(frozen=True, slots=True)
class BlockCell:
    """Whether, and why, a UID or a part number is blocked."""

    kind: str
    """`uid` or `number`."""
    key: str
    """The UID, 16 hexadecimal digits, or the part number."""
    reason: str
    """Empty: it is not blocked."""

    def as_json(self) -> dict[str, object]:
        """See `Cell.as_json`."""
        return {"of": "block", "kind": self.kind, "key": self.key, "reason": self.reason}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:  # noqa: ARG002 - blocks hold for all robots
        """See `Cell.as_it_is`."""
        query = select(blocks.c.reason).where(blocks.c.kind == self.kind, blocks.c.key == self.key)
        return replace(self, reason=connection.execute(query).scalar() or "")

    def write(self, connection: Connection, author: Author) -> None:
        """See `Cell.write`."""
        key = {"kind": self.kind, "key": self.key}
        if self.reason:
            upsert(connection, blocks, key, {"reason": self.reason, "since_ns": author.now_ns})
        else:
            connection.execute(delete(blocks).where(blocks.c.kind == self.kind, blocks.c.key == self.key))


def block(connection: Connection, author: Author, kind: str, key: str, reason: str) -> EditRecord:
    """Keep a UID or a part number out."""
    reason = reason or said("no reason given")
    return _write(connection, author, BlockCell(kind, key, reason), "{part} is blocked: {reason}")


def unblock(connection: Connection, author: Author, kind: str, key: str) -> EditRecord:
    """Let a UID or part number in again.

    Raises:
        ConfigError: it is not blocked.
    """
    return _write(connection, author, BlockCell(kind, key, ""), "{part} is let in again")


def _write(connection: Connection, author: Author, after: BlockCell, form: str) -> EditRecord:
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
