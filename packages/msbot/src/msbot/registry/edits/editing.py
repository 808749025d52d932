"""What people change: each change is one transaction with a line in the list of edits, and most can be undone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from sqlalchemy import Connection

from msbot.registry.database.storage import Storage
from msbot.registry.edits.edit_log import Author, read_edits, record, reword
from msbot.registry.records import NOTED, EditKind, EditRecord, RobotRecord

Making = Callable[[Connection, Author], EditRecord]
"""Makes a change and records it: `places.swap`, `slot_values.set_value` and so on, with their arguments bound."""


@dataclass(slots=True)
class NotedLine:
    """A line of the list that may still be waiting to be stored."""

    number: int | None = None
    """None: it is not stored (yet)."""


class Edits:
    """Makes changes and reads the list of them.

    A change waits until everything handed over before is stored, so that it is based on the true state; when the
    database cannot be written, the change is refused and nothing has changed.
    """

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def make(self, robot: RobotRecord | None, who: str, making: Making) -> EditRecord:
        """Make a change to a robot, or to something that concerns all robots of the database.

        Raises:
            ConfigError: the change makes no sense; the text says why.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._storage.change(self._by(robot, who, making))

    async def make_soon(self, robot: RobotRecord | None, who: str, making: Making) -> EditRecord:
        """The same for an event loop, without blocking it."""
        storage = self._storage
        change = storage.writer.submit(self._by(robot, who, making), wait_s=storage.patience_s)
        return await change.stored(storage.limit_s)

    def _by(self, robot: RobotRecord | None, who: str, making: Making) -> Callable[[Connection], EditRecord]:
        author = Author(None if robot is None else robot.id, who, self._storage.epoch_ns())
        return lambda connection: making(connection, author)

    def note(self, robot: RobotRecord, kind: EditKind, words: str, who: str) -> NotedLine:
        """Record something a person did that changed nothing in the database, as soon as it can be stored.

        Args:
            robot: at which robot.
            kind: one of `NOTED`.
            words: what it was.
            who: who did it.
        """
        assert kind.value in NOTED
        making = self._by(robot, who, partial(record, kind=kind, words=words))
        line = NotedLine()

        def write(connection: Connection) -> None:
            line.number = making(connection).id

        self._storage.writer.put(write)
        return line

    def note_again(self, line: NotedLine, words: str) -> None:
        """Have a line say something else, as soon as that can be stored: the same was done again."""

        def write(connection: Connection) -> None:
            if line.number is not None:
                reword(connection, line.number, words)

        self._storage.writer.put(write)

    def latest(self, robot: RobotRecord | None, limit: int = 50) -> list[EditRecord]:
        """The most recent edits, newest first; without a robot, those of users and keys.

        Raises:
            RegistryError: the database cannot be read.
        """
        robot_id = None if robot is None else robot.id
        self._storage.catch_up()
        return self._storage.read(partial(read_edits, robot_id=robot_id, limit=limit))
