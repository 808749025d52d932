"""A lesson: what a person reads, step by step, and the checks that tick when it is done."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from msbot.operations.fault_request import FaultRequest
from msbot_school.lessons.answers import is_same
from msbot_school.lessons.conditions import Condition
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class LessonQuestion:
    """What a person has to answer in words or numbers."""

    right: tuple[str, ...]
    """The right answers, in any form in which people write them (`msbot_school.lessons.answers`)."""
    tolerance: float = 0.0
    """How far a number may be off."""
    choices: tuple[str, ...] = ()
    """What can be chosen; empty: the person writes."""
    unit: str = ""
    """The unit of a number: an answer may leave it out, one in another unit is wrong. Empty: any word may follow."""

    def is_right(self, answer: str) -> bool:
        """Whether that answer is right."""
        return any(is_same(one, answer, tolerance=self.tolerance, unit=self.unit) for one in self.right)


@dataclass(frozen=True, slots=True)
class LessonCheck:
    """One thing that must be so, or must have been done."""

    name: str
    """`STEP.NUMBER`, both counted from 1: it identifies the check in what is kept of people's progress."""
    says: str
    """What is to be seen or done, in a sentence."""
    conditions: tuple[Condition, ...] = ()
    """All of them must hold at the same time."""
    for_s: float = 0.0
    """For how long without a break."""
    question: LessonQuestion | None = None
    hint: str = ""
    """Where to look when it does not tick."""
    line: int = 0


@dataclass(frozen=True, slots=True)
class Step:
    """A part of a lesson, with its checks."""

    title: str
    blocks: tuple[str | LessonCheck, ...]
    """Its text (Markdown) and its checks, in their order."""
    for_teachers: bool = False
    """Whether only teachers read it."""

    @property
    def checks(self) -> tuple[LessonCheck, ...]:
        """Its checks."""
        return tuple(block for block in self.blocks if isinstance(block, LessonCheck))


@dataclass(frozen=True, slots=True)
class Lesson:
    """A lesson as its file describes it."""

    name: str
    """The name of its file without `.md`."""
    title: str
    minutes: int
    number: int
    """Its place in the list."""
    steps: tuple[Step, ...]
    robot: str = ""
    """A sample of `msbot init`; empty with `blueprint`."""
    blueprint: Path | None = None
    """The blueprint that the lesson brings."""
    world: str = ""
    """The world that its robot must be in; empty: any, or none."""
    unplugged: tuple[str, ...] = ()
    """Slots whose part is pulled out when the lesson begins."""
    spares: tuple[str, ...] = ()
    """Slots that somebody simulates in the lesson, so that their part stands by."""
    settings: Mapping[str, Mapping[str, str]] | None = None
    """Values of slots that are set when the lesson begins, by slot and name."""
    faults: tuple[FaultRequest, ...] = ()
    """What goes wrong on purpose from the beginning on."""
    hint_after_s: float = 60.0
    """After how long without a tick a hint is shown."""
    file: Path | None = None
    topic: str = ""
    """What it is about, in a sentence."""
    age: int = 0
    """From which age on, years; 0: it is not said."""
    needs: tuple[str, ...] = ()
    """Names of lessons that come before."""

    @property
    def checks(self) -> tuple[LessonCheck, ...]:
        """All its checks, in their order."""
        return tuple(check for step in self.steps for check in step.checks)

    def check(self, name: str) -> LessonCheck | None:
        """The check of that name."""
        return next((check for check in self.checks if check.name == name), None)
