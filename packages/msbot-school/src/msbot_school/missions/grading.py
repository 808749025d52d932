"""Marks of a mission, from its notes. Pure: the same notes give the same marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from msbot_agent.text.sentence import said
from msbot_school.faults.fault_kinds import KINDS
from msbot_school.missions.mission import REPAIRS, DrawnFault, Mission, MissionEvent, MissionEventKind, Task
from msbot_xrce.lazy import dataclass


@dataclass(slots=True)
class FaultGrade:
    """What was made of one fault."""

    fault: DrawnFault
    began_s: float | None = None
    over_s: float | None = None
    place_by: str = ""
    """Who named its place first, alone or with the kind."""
    is_place_looked_up: bool = False
    """Whether somebody had looked the answers up before."""
    found_by: str = ""
    found_s: float | None = None
    """Seconds after it began; None: nobody named it."""
    is_quick: bool = False
    is_looked_up: bool = False
    """Whether somebody had looked the answers up before it was named."""
    mended_by: str = ""
    mended_s: float | None = None
    """Seconds after it began."""
    mended_how: str = ""
    """The repair; empty: at the part itself."""
    marks: float = 0.0
    of: float = 0.0


@dataclass(frozen=True, slots=True)
class TaskGrade:
    """What was made of one thing that had to be done."""

    task: Task
    is_done: bool
    by: str
    after_s: float | None
    """Seconds after the first fault began, or, of a condition, since the mission began."""
    marks: float
    of: float


@dataclass(frozen=True, slots=True)
class Penalty:
    """Something that cost marks."""

    at_s: float
    who: str
    words: str
    cost: float


@dataclass(slots=True)
class Grade:
    """The marks of a mission."""

    faults: list[FaultGrade] = field(default_factory=list)
    tasks: list[TaskGrade] = field(default_factory=list)
    wrong: list[Penalty] = field(default_factory=list)
    """Wrong answers, wrong repairs, acts to be avoided, and hints, in their order."""
    looked_by: str = ""
    """Who looked the answers up first."""
    marks: float = 0.0
    of: float = 0.0
    seconds: float = 0.0
    """How long the mission took."""
    reason: str = ""
    """Why it ended; empty: it has not."""

    @property
    def percent(self) -> float:
        """Marks in percent of those that were possible."""
        return 100 * self.marks / self.of if self.of else 0.0

    @property
    def is_complete(self) -> bool:
        """Whether everything is found, mended and done that there was."""
        return all(
            one.began_s is not None
            and (not one.fault.find or one.found_s is not None)
            and (not one.fault.mend or one.over_s is not None)
            for one in self.faults
        ) and all(task.is_done for task in self.tasks)


def grade(mission: Mission, faults: Sequence[DrawnFault], facts: Sequence[MissionEvent]) -> Grade:
    """The marks for what the notes say; those of a mission that runs are what it has brought so far."""
    found = Grade(faults=[FaultGrade(fault) for fault in faults])
    by_number = {one.fault.number: one for one in found.faults}
    for fact in facts:
        found.seconds = max(found.seconds, fact.at_s)
        match fact.what:
            case MissionEventKind.FAULT_BEGAN:
                by_number[fact.number].began_s = fact.at_s
            case MissionEventKind.FAULT_OVER:
                _over(by_number[fact.number], fact)
            case MissionEventKind.NAMED:
                _named(mission, found, fact)
            case MissionEventKind.REPAIRED:
                _repaired(mission, found, by_number, fact)
            case MissionEventKind.ACT if fact.word in mission.avoid:
                found.wrong.append(
                    Penalty(
                        fact.at_s,
                        fact.who,
                        said("{operation} was to be avoided", operation=fact.word),
                        mission.marks.wrong,
                    )
                )
            case MissionEventKind.HINT:
                words = said("hint {number}", number=fact.number)
                found.wrong.append(Penalty(fact.at_s, fact.who, words, mission.marks.hint))
            case MissionEventKind.LOOKED:
                found.looked_by = found.looked_by or fact.who
            case MissionEventKind.ENDED:
                found.reason = fact.text
            case _:
                pass
    _count(mission, found, facts)
    return found


def is_wrong(answer: str) -> bool:
    """Whether what `judged` says costs a mark."""
    return answer not in ("right", "again")


def judged(faults: Sequence[FaultGrade], kind: str, slot: str) -> tuple[str, FaultGrade | None]:
    """What an answer is worth: `right`, `again` (it was said before), `place` (only that is right), `early` (nothing
    has begun yet) or `wrong`; and the fault that it is about.
    """
    there = [one for one in faults if one.began_s is not None and one.fault.find]
    exact = [one for one in there if (one.fault.kind, one.fault.at) == (kind, slot)]
    if exact:
        fresh = next((one for one in exact if one.found_s is None), None)
        return ("again", exact[0]) if fresh is None else ("right", fresh)
    near = next((one for one in there if one.fault.at == slot and one.found_s is None), None)
    if near is not None:
        return "place", near
    return ("wrong" if there else "early"), None


def _over(one: FaultGrade, fact: MissionEvent) -> None:
    one.over_s = fact.at_s
    if fact.word == "mended" and one.mended_s is None:
        one.mended_by, one.mended_s = fact.who, fact.at_s - (one.began_s or 0.0)


def _named(mission: Mission, found: Grade, fact: MissionEvent) -> None:
    verdict, about = judged(found.faults, fact.word, fact.slot)
    if about is not None and not about.place_by:
        about.place_by, about.is_place_looked_up = fact.who, bool(found.looked_by)
    if verdict == "right":
        assert about is not None and about.began_s is not None  # noqa: PT018
        about.found_by, about.found_s = fact.who, fact.at_s - about.began_s
        about.is_quick = about.found_s <= mission.marks.quick_s
        about.is_looked_up = bool(found.looked_by)
    if is_wrong(verdict):
        what = place_words(said("{kind}: {words}", kind=fact.word, words=KINDS[fact.word].words), fact.slot)
        found.wrong.append(
            Penalty(
                fact.at_s,
                fact.who,
                said("wrong answer: {what} ({verdict})", what=what, verdict=VERDICTS[verdict]),
                mission.marks.wrong,
            )
        )


VERDICTS = {
    "right": said("right"),
    "again": said("that was found already"),
    "place": said("only the place is right"),
    "early": said("nothing has gone wrong yet"),
    "wrong": said("nothing of that kind is wrong there"),
}
"""What is said to an answer."""


def place_words(what: str, slot: str) -> str:
    """Something and where it is."""
    if slot:
        return said("{what} (at {slot})", what=what, slot=slot)
    return said("{what} (the whole robot)", what=what)


def _repaired(mission: Mission, found: Grade, by_number: dict[int, FaultGrade], fact: MissionEvent) -> None:
    one = by_number.get(fact.number)
    if one is not None and one.began_s is not None:
        one.mended_by, one.mended_s, one.mended_how = fact.who, fact.at_s - one.began_s, fact.word
        return
    what = place_words(REPAIRS[fact.word].words, fact.slot)
    found.wrong.append(Penalty(fact.at_s, fact.who, said("repaired in vain: {what}", what=what), mission.marks.wrong))


def _count(mission: Mission, found: Grade, facts: Sequence[MissionEvent]) -> None:
    marks = mission.marks
    for one in found.faults:
        if one.began_s is None:
            continue
        if one.fault.find:
            one.of += marks.place + marks.kind + marks.quick
            if one.place_by and not one.is_place_looked_up:
                one.marks += marks.place
            if one.found_s is not None and not one.is_looked_up:
                one.marks += marks.kind + (marks.quick if one.is_quick else 0)
        if one.fault.mend:
            one.of += marks.mend
            if one.mended_s is not None:
                one.marks += marks.mend
    found.tasks = [_task(mission, number, task, found, facts) for number, task in enumerate(mission.tasks, 1)]
    earned = sum(one.marks for one in found.faults) + sum(one.marks for one in found.tasks)
    found.of = sum(one.of for one in found.faults) + sum(one.of for one in found.tasks)
    found.marks = max(earned - sum(one.cost for one in found.wrong), 0.0)


def _task(mission: Mission, number: int, task: Task, found: Grade, facts: Sequence[MissionEvent]) -> TaskGrade:
    of = mission.marks.do
    if task.until:
        last = [fact for fact in facts if fact.what is MissionEventKind.HOLDS and fact.number == number]
        holds = bool(last) and last[-1].word == "yes"
        return TaskGrade(task, holds, "", last[-1].at_s if holds else None, of if holds else 0.0, of)
    first_s = min((one.began_s for one in found.faults if one.began_s is not None), default=0.0)
    for fact in facts:
        if fact.what is not MissionEventKind.ACT or fact.word != task.operation:
            continue
        after_s = max(fact.at_s - first_s, 0.0)
        if task.arguments.items() <= fact.arguments.items() and (task.within_s is None or after_s <= task.within_s):
            return TaskGrade(task, True, fact.who, after_s, of, of)
    return TaskGrade(task, False, "", None, 0.0, of)
