"""What the API tells of missions."""

from __future__ import annotations

from pydantic import Field

from msbot_web.api.model import Model
from msbot_web.api.said import Said


class MissionTask(Model):
    """Something that must be done."""

    words: str
    done: bool


class MissionToldLine(Model):
    """An answer or a repair, and what came of it."""

    at_s: float
    who: str
    what: str
    word: str
    slot: str
    text: Said


class MissionState(Model):
    """The mission that runs, without its answers; all empty but `reports` when none runs."""

    mission: str = ""
    title: str = ""
    story: str = ""
    who: str = ""
    time_s: float = 0.0
    left_s: float = 0.0
    found: int = 0
    to_find: int = 0
    mended: int = 0
    to_mend: int = 0
    hints: list[str] = Field(default_factory=list)
    hints_left: int = 0
    tasks: list[MissionTask] = Field(default_factory=list)
    told: list[MissionToldLine] = Field(default_factory=list)
    reports: list[int] = Field(default_factory=list)
    """Numbers of the missions that are over."""


class FaultMarks(Model):
    """What was made of one fault."""

    kind: str
    at: str
    began_s: float | None
    over_s: float | None
    place_by: str
    found_by: str
    found_s: float | None
    quick: bool
    mended_by: str
    mended_s: float | None
    repair: str
    marks: float
    of: float


class TaskMarks(Model):
    """What was made of one thing that had to be done."""

    words: str
    done: bool
    by: str
    after_s: float | None
    marks: float
    of: float


class WrongActLine(Model):
    """Something that cost marks."""

    at_s: float
    who: str
    words: Said
    cost: float


class MissionMarks(Model):
    """The report of a mission that is over."""

    number: int
    mission: str
    title: str
    seed: int
    who: str
    began_ms: int
    seconds: float
    reason: Said
    marks: float
    of: float
    percent: float
    looked_by: str
    faults: list[FaultMarks]
    tasks: list[TaskMarks]
    wrong: list[WrongActLine]
