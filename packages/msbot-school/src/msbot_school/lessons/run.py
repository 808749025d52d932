"""A lesson that somebody is doing: which checks have ticked, and what is missing. Pure: the time is passed in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

from msbot_agent.text.sentence import joined, said
from msbot_school.lessons.conditions import ConditionMemory, RobotNow
from msbot_school.lessons.lesson import Lesson, LessonCheck, LessonQuestion
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


@dataclass(slots=True)
class _Progress:
    memories: list[ConditionMemory]
    holds_since: float | None = None
    ticked_at: float | None = None
    tries: int = 0
    """Wrong answers."""


@dataclass(frozen=True, slots=True)
class Hint:
    """What to tell somebody who is stuck."""

    check: str
    seen: str
    """What the robot is like."""
    look: str
    """Where to look."""


@dataclass(slots=True)
class LessonRun:
    """One run of a lesson at one robot.

    A check is looked at once every check of the steps before it has ticked. What has ticked stays.
    """

    lesson: Lesson
    begun_at: float
    _progress: dict[str, _Progress] = field(default_factory=dict)
    _last_tick_at: float = 0.0

    def __post_init__(self) -> None:
        """Nothing has ticked yet."""
        self._last_tick_at = self.begun_at
        for check in self.lesson.checks:
            self._progress[check.name] = _Progress([ConditionMemory() for _ in check.conditions])

    @property
    def step(self) -> int:
        """The index of the first step with a check that has not ticked; the number of steps when all have."""
        for index, step in enumerate(self.lesson.steps):
            if any(self._progress[check.name].ticked_at is None for check in step.checks):
                return index
        return len(self.lesson.steps)

    @property
    def is_done(self) -> bool:
        """Whether every check has ticked."""
        return self.step == len(self.lesson.steps)

    @property
    def ticked(self) -> Mapping[str, float]:
        """When each check ticked, by its name, in the order of the lesson."""
        return {name: one.ticked_at for name, one in self._progress.items() if one.ticked_at is not None}

    def tries(self, check: str) -> int:
        """How many wrong answers a question has got."""
        return self._progress[check].tries

    def look(self, robot: RobotNow, now: float) -> list[LessonCheck]:
        """Look at the checks of the present step; returns those that have ticked now."""
        found: list[LessonCheck] = []
        for check in self._open():
            progress = self._progress[check.name]
            if check.question is not None or not self._all_hold(check, robot):
                progress.holds_since = None
                continue
            if progress.holds_since is None:
                progress.holds_since = now
            if now - progress.holds_since >= check.for_s:
                self._tick(progress, now)
                found.append(check)
        return found

    def answer(self, name: str, answer: str, now: float, others: Sequence[LessonQuestion] = ()) -> bool:
        """Answer a question; whether that was right, for it or for one of its translations.

        Raises:
            ConfigError: there is no such question, or it is not its turn.
        """
        check = next((check for check in self._open() if check.name == name and check.question is not None), None)
        if check is None:
            raise ConfigError(said("there is no open question {name} now", name=name))
        assert check.question is not None
        progress = self._progress[name]
        if not any(question.is_right(answer) for question in (check.question, *others)):
            progress.tries += 1
            return False
        self._tick(progress, now)
        return True

    def since_tick(self, now: float) -> float:
        """Seconds since something ticked, or since the lesson began."""
        return now - self._last_tick_at

    def hint(self, robot: RobotNow, now: float) -> Hint | None:
        """What to tell when nothing has ticked for long; None: not yet, or all is done."""
        if self.since_tick(now) < self.lesson.hint_after_s:
            return None
        return self.missing(robot)

    def missing(self, robot: RobotNow) -> Hint | None:
        """The first check that has not ticked, and what is so instead; None: all is done."""
        check = next(iter(self._open()), None)
        if check is None:
            return None
        memories = self._progress[check.name].memories
        seen = [
            condition.seen(robot, memory)
            for condition, memory in zip(check.conditions, memories, strict=True)
            if not condition.holds(robot, memory)
        ]
        if not seen and check.for_s:
            seen = [said("it holds, and must do so for {seconds:g} s", seconds=check.for_s)]
        return Hint(check.name, joined("; ", seen), check.hint)

    def _open(self) -> list[LessonCheck]:
        """The checks of the present step that have not ticked."""
        step = self.step
        if step == len(self.lesson.steps):
            return []
        return [check for check in self.lesson.steps[step].checks if self._progress[check.name].ticked_at is None]

    def _all_hold(self, check: LessonCheck, robot: RobotNow) -> bool:
        memories = self._progress[check.name].memories
        # Each is asked, also behind one that does not hold: some have to remember.
        held = [one.holds(robot, memory) for one, memory in zip(check.conditions, memories, strict=True)]
        return all(held)

    def _tick(self, progress: _Progress, now: float) -> None:
        progress.ticked_at = now
        self._last_tick_at = now
