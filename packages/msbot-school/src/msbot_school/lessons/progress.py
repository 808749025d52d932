"""How far people are in lessons, worked out from what has ticked for them. Pure."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence

from msbot.registry.lesson_ticks import BEGUN, Tick
from msbot_agent.text.sentence import as_cell
from msbot_school.lessons.check_authors import Doing
from msbot_school.lessons.lesson import Lesson
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class LessonProgress:
    """One person in one lesson."""

    person: str
    lesson: str
    title: str
    ticked: int
    checks: int
    """How many checks the lesson has; 0: there is no such lesson any more."""
    begun_ms: int
    """When the person began it, milliseconds since 1970."""
    last_ms: int
    """When something ticked last; as `begun_ms` when nothing has."""
    own: int = 0
    """How many of the ticks are the person's own: questions answered, things done by hand."""
    group: int = 0
    """How many somebody of the person's group did."""
    helped: int = 0
    """How many a teacher did, because pupils may not."""
    partners: tuple[str, ...] = ()
    """Who did the ticks of `group` and `helped`."""

    @property
    def robot(self) -> int:
        """How many came by themselves, without anybody's hand."""
        return self.ticked - self.own - self.group - self.helped

    @property
    def is_done(self) -> bool:
        """Whether every check has ticked."""
        return 0 < self.checks <= self.ticked

    def as_json(self) -> dict[str, object]:
        """For programs."""
        return {
            "person": self.person,
            "lesson": self.lesson,
            "title": self.title,
            "ticked": self.ticked,
            "own": self.own,
            "group": self.group,
            "helped": self.helped,
            "robot": self.robot,
            "partners": list(self.partners),
            "checks": self.checks,
            "done": self.is_done,
            "begun_ms": self.begun_ms,
            "last_tick_ms": self.last_ms,
        }


def progress_of(ticks: Iterable[Tick], lessons: Sequence[Lesson]) -> list[LessonProgress]:
    """How far everybody is, by person and then in the order of the lessons.

    Args:
        ticks: all of them, the oldest first.
        lessons: the lessons that there are; checks that a lesson has no more do not count.
    """
    known = {lesson.name: lesson for lesson in lessons}
    places = {lesson.name: place for place, lesson in enumerate(lessons)}
    by_pair: dict[tuple[str, str], list[Tick]] = {}
    for tick in ticks:
        by_pair.setdefault((tick.person, tick.lesson), []).append(tick)
    rows = []
    for (person, name), own in by_pair.items():
        lesson = known.get(name)
        names = set() if lesson is None else {check.name for check in lesson.checks}
        counted = [tick for tick in own if tick.check != BEGUN and tick.check in names]
        hands = Counter(tick.doing for tick in counted)
        rows.append(
            LessonProgress(
                person,
                name,
                name if lesson is None else lesson.title,
                len(counted),
                len(names),
                own[0].at_ns // 1_000_000,
                max(tick.at_ns for tick in [own[0], *counted]) // 1_000_000,
                hands[Doing.OWN.value],
                hands[Doing.GROUP.value],
                hands[Doing.HELPED.value],
                tuple(dict.fromkeys(tick.by for tick in counted if tick.by)),
            )
        )
    return sorted(rows, key=lambda row: (row.person, places.get(row.lesson, len(places)), row.lesson))


def csv_of(rows: Iterable[LessonProgress]) -> str:
    """The same as a table for a spreadsheet."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    heads = ("person", "lesson", "ticked", "checks", "own", "group", "helped", "robot", "partners", "begun_ms")
    writer.writerow([*heads, "last_tick_ms"])
    for row in rows:
        counts = (row.ticked, row.checks, row.own, row.group, row.helped, row.robot)
        partners = as_cell(", ".join(row.partners))
        writer.writerow([as_cell(row.person), as_cell(row.lesson), *counts, partners, row.begun_ms, row.last_ms])
    return out.getvalue()
