"""The outcome of an operation, for the person who asked for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from msbot.registry import EditRecord
from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Outcome:
    """Something was done, or a question was answered."""

    words: str = ""
    """What was done, in one sentence; empty for a question."""
    edit_id: int | None = None
    """The number for `undo`; None: nothing stored has changed."""
    answer: Mapping[str, object] = field(default_factory=dict)
    """The answer to a question, as JSON."""

    def as_json(self) -> dict[str, object]:
        """The answer to another process."""
        words = {"words": self.words} if self.words else {}
        edit = {} if self.edit_id is None else {"edit": self.edit_id}
        return {**words, **edit, **self.answer}


def outcome_of(edit: EditRecord | None, words: str = "") -> Outcome:
    """What to say about a stored change: `words` if there are any, else those that were stored."""
    return Outcome(words or ("" if edit is None else edit.words), None if edit is None else edit.id)
