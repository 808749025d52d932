"""Whether the journal of a robot is consistent: read from the database with SQL alone, judged by its documentation.

1. Numbers rise. Times do not go back.
2. Every change has a reason in words, and is one of docs/explain/part_states.md.
3. A slot has one holder at a time.
4. No part of the robot is accused of what it has not done: its own samples are never forged.
5. Every change by a person that was acknowledged is among the edits.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path

HOLDING = ("active", "late")
ALLOWED = {
    "": ("new", "checking", "active", "standby", "refused", "lost", "left"),  # strangers are not told of from the start
    "new": ("checking", "left", "lost", "refused", "standby", "active"),
    "checking": ("active", "standby", "refused", "lost", "left"),
    "active": ("late", "lost", "checking", "standby", "refused", "left"),
    "late": ("active", "lost", "checking", "standby", "refused", "left"),
    "standby": ("refused", "active", "checking", "lost", "left"),
    "refused": ("checking", "left", "lost", "standby", "active", "refused"),
    "lost": ("checking", "left", "new"),
    "left": ("new", "checking"),
}
WRITTEN_S = 5.0
"""After so long a change must be in the database."""
COLUMNS = "id, at_ns, part, uid, slot, from_state, to_state, reason"
Row = tuple[int, int, str, str, str, str, str, str]


def read_journal(database: Path, after: int) -> list[Row]:
    """The lines after that number.

    Raises:
        sqlite3.Error: it cannot be read now.
    """
    return [
        (int(str(number)), int(str(at_ns)), str(part), str(uid), str(slot), str(before), str(then), str(reason))
        for number, at_ns, part, uid, slot, before, then, reason in _ask(
            database, f"select {COLUMNS} from journal where id > {after} order by id"
        )
    ]


def read_edits(database: Path) -> set[int]:
    """The numbers of all changes by people.

    Raises:
        sqlite3.Error: it cannot be read now.
    """
    return {int(str(row[0])) for row in _ask(database, "select id from edits")}


def _ask(database: Path, query: str) -> list[tuple[object, ...]]:
    if not database.exists():
        raise sqlite3.OperationalError(f"{database} is not there")
    with contextlib.closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=1.0)) as connection:
        return connection.execute(query).fetchall()


class JournalOracle:
    """Rules 1 to 5."""

    def __init__(self, complain: Callable[[float, str, str], None]) -> None:
        self.last = 0
        self.lines = 0
        self._at_ns = 0
        self._holders: dict[str, str] = {}
        self._complain = complain
        self._missed: set[int] = set()

    def follow(self, now: float, rows: Iterable[Row]) -> None:
        """New lines."""
        for number, at_ns, part, uid, slot, before, after, reason in rows:
            self.lines += 1
            words = f"line {number}: {part} ({uid}) in {slot or 'no slot'}: {before or 'nothing'} -> {after}: {reason}"
            if number <= self.last:
                self._complain(now, "journal", f"{words}: comes after line {self.last}")
            if at_ns < self._at_ns:
                self._complain(
                    now, "journal", f"{words}: {(self._at_ns - at_ns) / 1e9:.3f} s before the line before it"
                )
            if not reason.strip():
                self._complain(now, "journal", f"{words}: without a reason")
            if before != after and after not in ALLOWED.get(before, ()):  # the same twice: something else is noted
                self._complain(now, "journal", f"{words}: no such change")
            if "that says it is from this part was refused" in reason:
                self._complain(now, "journal", f"{words}: it is its own")
            self.last, self._at_ns = number, max(at_ns, self._at_ns)
            if uid:
                self._hold(now, words, slot, uid, after)

    def _hold(self, now: float, words: str, slot: str, uid: str, after: str) -> None:
        for held in [held for held, holder in self._holders.items() if holder == uid]:
            del self._holders[held]
        if slot and after in HOLDING:
            if slot in self._holders:
                self._complain(now, "journal", f"{words}: but {self._holders[slot]} holds that slot")
            self._holders[slot] = uid

    def edits(self, now: float, kept: set[int], acknowledged: Iterable[tuple[int, float]]) -> None:
        """What is stored, and what was acknowledged when."""
        for edit, at in acknowledged:
            if edit not in kept and now - at > WRITTEN_S and edit not in self._missed:
                self._missed.add(edit)
                self._complain(now, "edits", f"change {edit} was acknowledged {now - at:.0f} s ago and is not stored")
