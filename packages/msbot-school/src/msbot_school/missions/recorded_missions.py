"""The missions of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from msbot.recording.recordings.mcap_reader import RecordingReader
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import read_json
from msbot_school.missions.grading import Grade, grade
from msbot_school.missions.mission import DrawnFault, Mission, MissionEvent, MissionEventKind, drawn, events_from_json
from msbot_school.missions.mission_file import parse_mission
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

# A mission that was played: its file, its seed and its notes, from which its marks follow; as JSON and back.


@dataclass(frozen=True, slots=True)
class PlayedMission:
    """A mission that was played: its file, its seed and its notes, from which its marks follow; as JSON and back."""

    number: int
    """Counted from 1 since the robot started."""
    mission: Mission
    seed: int
    began_ms: int
    """Milliseconds since 1970."""
    facts: tuple[MissionEvent, ...]

    @property
    def who(self) -> str:
        """Who has started it."""
        return next((fact.who for fact in self.facts if fact.what is MissionEventKind.BEGAN), "")

    @property
    def faults(self) -> tuple[DrawnFault, ...]:
        """Its faults as chance has decided them."""
        return drawn(self.mission, self.seed)

    def grade(self) -> Grade:
        """Its marks."""
        return grade(self.mission, self.faults, self.facts)

    def as_json(self) -> dict[str, object]:
        """For a recording, and for other processes."""
        return {**self.head(), "facts": [fact.as_json() for fact in self.facts]}

    def head(self) -> dict[str, object]:
        """The same without its notes."""
        return {
            "number": self.number,
            "mission": self.mission.name,
            "toml": self.mission.source,
            "seed": self.seed,
            "began_ms": self.began_ms,
        }


def played_from_json(content: Mapping[str, object]) -> PlayedMission:
    """The mission that `PlayedMission.as_json` wrote.

    Raises:
        RemoteProtocolError: it is none.
        ConfigError: its file cannot be read by this version.
    """
    match content:
        case {
            "number": int(number),
            "mission": str(name),
            "toml": str(toml),
            "seed": int(seed),
            "began_ms": int(began),
            "facts": list(facts),
        }:
            mission = parse_mission(toml, f"{name}.toml")
            return PlayedMission(number, mission, seed, began, tuple(events_from_json(facts)))
    raise RemoteProtocolError(f"no mission: {content!r:.200}")


def grade_json(played: PlayedMission) -> dict[str, object]:
    """Marks, times and wrong acts, for programs."""
    found = played.grade()
    return {
        "number": played.number,
        "mission": played.mission.name,
        "title": played.mission.title,
        "seed": played.seed,
        "who": played.who,
        "began_ms": played.began_ms,
        "seconds": found.seconds,
        "reason": found.reason,
        "marks": found.marks,
        "of": found.of,
        "percent": round(found.percent, 1),
        "looked_by": found.looked_by,
        "faults": [
            {
                "kind": one.fault.kind,
                "at": one.fault.at,
                "began_s": one.began_s,
                "over_s": one.over_s,
                "place_by": one.place_by,
                "found_by": one.found_by,
                "found_s": one.found_s,
                "quick": one.is_quick,
                "mended_by": one.mended_by,
                "mended_s": one.mended_s,
                "repair": one.mended_how,
                "marks": one.marks,
                "of": one.of,
            }
            for one in found.faults
        ],
        "tasks": [
            {
                "words": one.task.words,
                "done": one.is_done,
                "by": one.by,
                "after_s": one.after_s,
                "marks": one.marks,
                "of": one.of,
            }
            for one in found.tasks
        ],
        "wrong": [{"at_s": one.at_s, "who": one.who, "words": one.words, "cost": one.cost} for one in found.wrong],
    }


TOPIC: Final = "/msbot/mission"
"""The topic where notes of missions are."""


def played_in(reader: RecordingReader) -> list[PlayedMission]:
    """The missions of a recording, oldest first; one that was broken off as far as it was recorded.

    What of it could not be read is in the reader's `damage` then.

    Raises:
        ConfigError: it is no recording, or there is no mission in it.
    """
    heads: dict[int, dict[str, object]] = {}
    notes: dict[int, list[object]] = {}
    for message in reader.messages():
        if message.topic != TOPIC:
            continue
        note = _note(message.data)
        if note is None:
            continue  # of a damaged recording, or of another program
        began = note.pop("began_ms")
        head = note.pop("head", None)
        if isinstance(head, dict):
            heads[began] = head
        match note.get("facts"):
            case list(facts):  # the whole, written at the end
                notes[began] = facts
            case _:
                notes.setdefault(began, []).append(note)
    if not heads:
        raise ConfigError(
            said(
                "there is no mission in {path}: a recording has one that began while it recorded", path=str(reader.path)
            )
        )
    return [played_from_json({**head, "facts": notes.get(began, [])}) for began, head in sorted(heads.items())]


def _note(data: bytes) -> dict[str, Any] | None:
    """What a message says; None: it makes no sense."""
    try:
        found = read_json(data)
    except ValueError:
        return None
    return found if isinstance(found, dict) and isinstance(found.get("began_ms"), int) else None
