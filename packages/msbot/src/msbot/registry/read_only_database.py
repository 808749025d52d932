"""A quick look into a SQLite file: what `msbot parts`, `robots` and `why` show, with Python's own sqlite3.

SQLAlchemy alone takes longer to import than such a command may take. Whatever is less simple than in most classrooms (a
server, a file of an older or newer MsBOT, one that cannot be read) is left to `open_registry`, which says what is wrong
and what to do. `read_only_queries` is made from the tables.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from msbot.pnp.part_events import PartEvent, PartState
from msbot.registry.read_only_queries import JOURNAL, PARTS, ROBOTS, SCHEMA, SLOT_NAMES, SLOT_TYPES, TOPICS
from msbot.registry.records import JournalEntry, PartRecord, RobotRecord
from msbot_agent.text.sentence import from_json

NO_MASTER: Final = "its robot has no master at the moment"
"""Why a part of a robot that nobody runs is lost."""

_STATES: Final = {state.value: state for state in PartState}


class ReadOnlyDatabase:
    """One file, open for reading; `look_into` opens it."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection = connection
        self._path = path

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        self._connection.close()

    @property
    def database(self) -> str:
        """The file, for messages."""
        return str(self._path)

    def robots(self) -> list[RobotRecord]:
        """All robots, the one with the most recently applied blueprint first."""
        return [RobotRecord(*row) for row in self._connection.execute(ROBOTS)]

    def is_run(self, robot: RobotRecord) -> bool:
        """Whether a master is running this robot now; see `running.run_lock`."""
        return is_locked(lock_file(self._path, robot.id))

    def slot_names(self, robot: RobotRecord) -> list[str]:
        """The slots of a robot's blueprint, in its order."""
        return [name for (name,) in self._connection.execute(SLOT_NAMES, {"robot": robot.id})]

    def topics(self, robot: RobotRecord) -> list[str]:
        """The topics that ports of a robot are bound to."""
        return [name for (name,) in self._connection.execute(TOPICS, {"robot": robot.id})]

    def slot_types(self, robot: RobotRecord) -> list[tuple[str, list[str], list[str]]]:
        """The slots of a robot with the names of the ports and parameters of what fits there."""
        return [
            (slot, *([one["name"] for one in json.loads(listed)] for listed in lists))
            for slot, *lists in self._connection.execute(SLOT_TYPES, {"robot": robot.id})
        ]

    def parts(self, robot: RobotRecord | None = None) -> list[PartRecord]:
        """As `Registry.robots.parts`: all parts that were ever seen, those in slots first."""
        found = []
        for one in self.robots() if robot is None else [robot]:
            records = [
                PartRecord(one.name, bytes.fromhex(uid), *rest)
                for uid, *rest in self._connection.execute(PARTS, {"robot": one.id})
            ]
            found.extend(records if self.is_run(one) else [without_master(record) for record in records])
        return found

    def journal(self, limit: int, part: str, robot: RobotRecord | None = None) -> list[JournalEntry]:
        """The newest lines about a part, of one robot or of all, the oldest first; see `Registry.robots.journal`."""
        values = {"part": part, "small": part.lower(), "limit": limit, "robot": None if robot is None else robot.id}
        rows = self._connection.execute(f"{JOURNAL} LIMIT :limit", values).fetchall()
        return [_entry(row) for row in reversed(rows)]


def look_into(address: str) -> ReadOnlyDatabase | None:
    """Open a database for a quick look; None: it is not simple enough, see the module's docstring."""
    if "://" in address:
        return None
    path = Path(address)
    try:
        connection = sqlite3.connect(f"file:{path.absolute().as_posix()}?mode=ro", uri=True, timeout=5.0)
    except sqlite3.Error:
        return None
    try:
        (version,) = connection.execute("SELECT version_num FROM alembic_version").fetchone() or ("",)
    except sqlite3.Error:
        version = ""
    if version != SCHEMA:
        connection.close()
        return None
    return ReadOnlyDatabase(connection, path)


def lock_file(database: Path, robot_id: int) -> Path:
    """The file whose lock says that a master runs this robot."""
    return database.with_name(f"{database.name}.running{robot_id}")


def is_locked(lock: Path) -> bool:
    """Whether a master holds that lock; see `running.run_lock`."""
    if not lock.exists():
        return False
    with contextlib.closing(sqlite3.connect(lock, timeout=0.0, isolation_level=None)) as connection:
        try:
            connection.execute("BEGIN EXCLUSIVE")
        except sqlite3.OperationalError as error:
            return error.sqlite_errorname == "SQLITE_BUSY"
    return False


def without_master(record: PartRecord) -> PartRecord:
    """The record of a part whose robot nobody runs: not there, whatever the database says about its last change."""
    if _STATES[record.state].is_over:
        return record
    return replace(record, state=PartState.LOST.value, reason=NO_MASTER)


def _entry(row: tuple[object, ...]) -> JournalEntry:
    number, robot, at_ns, part, slot, before, after, reason, evidence, part_number, local_name, uid, address, told = row
    said_reason, said_evidence = (
        json.loads(str(told)) if told not in (None, "null") else (reason, json.loads(str(evidence)))
    )
    assert isinstance(at_ns, int)
    assert isinstance(number, int)
    event = PartEvent(
        at=at_ns / 1e9,
        part=str(part),
        slot=str(slot) or None,
        from_state=_STATES.get(str(before)),
        to_state=_STATES[str(after)],
        reason=from_json(said_reason),
        evidence=tuple(_pairs(said_evidence)),
        part_number=str(part_number),
        local_name=str(local_name),
        uid=bytes.fromhex(str(uid)),
        address=str(address),
    )
    return JournalEntry(number, str(robot), at_ns, event)


def _pairs(evidence: list[list[object]]) -> Iterator[tuple[str, str]]:
    for rule, outcome in evidence:
        yield from_json(rule), from_json(outcome)
