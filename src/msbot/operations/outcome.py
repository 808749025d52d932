"""What came of an operation, for the person who asked for it."""

from __future__ import annotations

from dataclasses import dataclass

from msbot.registry import EditRecord


@dataclass(frozen=True, slots=True)
class Outcome:
    """Something was done."""

    words: str
    """What, in one sentence."""
    edit_id: int | None = None
    """What `undo` takes to take it back; None: it changed nothing that is stored."""
    latency_ms: float | None = None
    """Of a STOP: until every part had confirmed it; None: not known yet (`Operations.stop_report` will)."""


def outcome_of(edit: EditRecord | None, words: str = "") -> Outcome:
    """What to say about a stored change; in other words than the stored ones if there are any."""
    return Outcome(words or ("" if edit is None else edit.words), None if edit is None else edit.id)
