"""What happened in a mission, one note after the other: all that marks are counted from. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from enum import Enum
from typing import Final

from msbot_agent.text.sentence import JsonSentence, from_json, to_json
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import RemoteProtocolError


class What(Enum):
    """The kinds of notes."""

    BEGAN = "began"
    """The mission; `who` has started it."""
    FAULT_BEGAN = "fault began"
    FAULT_OVER = "fault over"
    """`word` is `mended` if a person has mended it at the part itself."""
    NAMED = "named"
    """`who` says that the fault `word` is at `slot`."""
    REPAIRED = "repaired"
    """`who` had the repair `word` done at `slot`; `number` is the fault that it mended, 0: none."""
    ACT = "act"
    """`who` had the operation `word` carried out."""
    STATE = "state"
    """The part in `slot` is `word` from now on."""
    HINT = "hint"
    """`who` was given hint `number`."""
    LOOKED = "looked"
    """`who` has looked the answers up."""
    HOLDS = "holds"
    """The condition of task `number` holds from now on, if `word` is `yes`, or no longer."""
    ENDED = "ended"
    """The mission, for the reason in `text`."""


@dataclass(frozen=True, slots=True)
class Fact:
    """One note."""

    at_s: float
    """Seconds since the mission began."""
    what: What
    who: str = ""
    number: int = 0
    """Of a fault, a hint or a task, counted from 1."""
    slot: str = ""
    word: str = ""
    text: str = ""
    """A sentence, for people."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Of an act."""

    def as_json(self) -> dict[str, object]:
        """For a recording."""
        text: JsonSentence = to_json(self.text)
        return {
            "at_s": self.at_s, "what": self.what.value, "who": self.who, "number": self.number, "slot": self.slot,
            "word": self.word, "text": text, "arguments": dict(self.arguments),
        }  # fmt: skip


LONGEST_S: Final = 1e9
"""No mission lasts longer; JSON may hold whole numbers that are no float."""


def facts_from_json(notes: Iterable[object]) -> list[Fact]:
    """The notes of a recording.

    Raises:
        RemoteProtocolError: one is no note of a mission.
    """
    return [_fact(note) for note in notes]


def _fact(note: object) -> Fact:
    match note:
        case {
            "at_s": int() | float() as at_s, "what": str(what), "who": str(who), "number": int(number),
            "slot": str(slot), "word": str(word), "text": text, "arguments": dict(arguments),
        } if what in {one.value for one in What} and abs(at_s) < LONGEST_S:  # fmt: skip
            named = {str(name): str(value) for name, value in arguments.items()}
            return Fact(float(at_s), What(what), who, number, slot, word, from_json(text), named)
    raise RemoteProtocolError(f"no note of a mission: {note!r:.200}")
