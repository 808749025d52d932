"""The missions of a recording."""

from __future__ import annotations

from typing import Any, Final

from msbot.recording.recordings.reading import RecordingReader
from msbot_agent.text.json_reading import read_json
from msbot_agent.text.sentence import said
from msbot_school.missions.played import PlayedMission, played_from_json
from msbot_xrce.errors import ConfigError

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
