"""What API and pages say of the robots of a class."""

from __future__ import annotations

from pydantic import Field

from msbot_web.models.robot_models import Model
from msbot_web.models.sentence_field import SentenceField


class RobotStatus(Model):
    """The robot in short, for the class that it is in."""

    robot: str
    version: str
    serial_number: str
    released: str
    manufacturer: str
    stop_group: str
    """Its STOP group; empty: none."""
    msbot: str
    """The version of MsBOT that runs it."""
    blueprint: str
    """A mark of the blueprint in force: robots with the same mark have the same slots, wires, settings and options."""
    database: str
    """A mark of its database: robots with the same mark share one; empty: it has none."""
    slots: int
    active: int
    """Slots with a part that is in."""
    stopped: bool
    told: int
    """Parts that STOP was said to."""
    not_confirmed: int
    """Parts that have not confirmed it: they may still move."""
    silent: list[str] = Field(default_factory=list)
    """Their names, the first hundred."""
    trouble: SentenceField = ""
    """Why changes are not being stored; empty: they are."""


class RobotTile(Model):
    """One robot of the database, for the class view."""

    name: str
    serial_number: str
    running: bool
    here: bool
    """Whether this server is its master's."""
    owner: str
    slots: int
    active: int
    last_event: SentenceField
    last_event_age_s: float | None
    address: str = ""
    """Where its own page is, when it is known."""
    stopped: bool = False
    """Whether STOP holds, as its master says."""
    reachable: bool = False
    """Whether its master answers, here or elsewhere by an access: one STOP for all reaches it."""
    version: str = ""
    """Of its blueprint's profile."""
    blueprint: str = ""
    """The mark of its blueprint in force; empty: not known."""
    msbot: str = ""
    """The version of MsBOT that runs it; empty: not known."""
    elsewhere: bool = False
    """Whether there is an access to its master on another computer."""
    trouble: SentenceField = ""
    """Why a master elsewhere does not answer."""
    stop_group: str = ""
    """Its STOP group; empty: none, or it is not known."""
    in_class: bool = True
    """Whether one STOP for all is meant for it; False: it is of another class, or of another STOP group."""
    database: str = ""
    """A mark of its database, which tells robots of the same name apart; empty: it has none, or it is not known."""


# What the API tells of missions.


class MissionTask(Model):
    """Something that must be done."""

    words: str
    done: bool


class MissionAnswerLine(Model):
    """An answer or a repair, and what came of it."""

    at_s: float
    who: str
    what: str
    word: str
    slot: str
    text: SentenceField


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
    told: list[MissionAnswerLine] = Field(default_factory=list)
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


class MissionPenaltyLine(Model):
    """Something that cost marks."""

    at_s: float
    who: str
    words: SentenceField
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
    reason: SentenceField
    marks: float
    of: float
    percent: float
    looked_by: str
    faults: list[FaultMarks]
    tasks: list[TaskMarks]
    wrong: list[MissionPenaltyLine]


# What the API tells of an examination by the doctor.


class FindingLine(Model):
    """One thing that is not as it should be."""

    check: str
    problem: str
    """What sort of problem, for programs: `bus-off`."""
    about: str
    must: bool
    """False: worth knowing, may be wanted."""
    saw: SentenceField
    why: SentenceField
    wire: SentenceField
    """How it shows in the traffic."""
    first: SentenceField
    """What hands must do before; empty: nothing."""
    mend: str
    """The command that mends it."""


class CheckLine(Model):
    """A check that could not, or need not, be made."""

    check: str
    why: SentenceField


class ExaminationState(Model):
    """What the doctor says of the robot and its computer, as `msbot doctor --json`."""

    well: bool
    findings: list[FindingLine]
    not_looked_at: list[CheckLine]
    not_needed: list[CheckLine]
    in_order: list[str]
