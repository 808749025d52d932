"""How one person does a lesson: which checks are ticked for them, and what is missing. Pure: the time is passed in.

Theory of operation. Several people may do a lesson at one robot; each has a run of their own. A check is looked at as
soon as the robot's checks of the steps before it have ticked; a question waits for nobody. Whoever did the last thing
at the slots of a check, before it began to hold, has done it, and it ticks for them and for their group. While it holds
by somebody else's hand it does not tick; what the run has seen of it is forgotten, and it must end before it counts.
What nobody did, the robot did: that ticks for everybody.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import NamedTuple

from msbot_agent.text.sentence import joined, said
from msbot_school.lessons.check_authors import Doing
from msbot_school.lessons.conditions import ConditionMemory, RobotState
from msbot_school.lessons.lesson import Lesson, LessonCheck, LessonQuestion
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


class Hand(NamedTuple):
    """Whose hand did the last thing at the slots of a check, as one person sees it."""

    doing: Doing | None
    """None: it was somebody else, who has nothing to do with this person."""
    who: str = ""
    """Empty: oneself, or nobody."""


NOBODY = Hand(Doing.ROBOT)


class Ticked(NamedTuple):
    """A check has ticked."""

    check: LessonCheck
    by: Hand


@dataclass(slots=True)
class _Progress:
    memories: list[ConditionMemory]
    holds_since: float | None = None
    hand: Hand = NOBODY
    """Whose hand it was when it began to hold."""
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
    """One person's run of a lesson; see the module's docstring. What has ticked stays."""

    lesson: Lesson
    begun_at: float
    _progress: dict[str, _Progress] = field(default_factory=dict)
    _last_tick_at: float = 0.0
    answers: dict[str, str] = field(default_factory=dict)
    """The person's last answer to each question, right or wrong."""

    def __post_init__(self) -> None:
        """Nothing has ticked yet."""
        self._last_tick_at = self.begun_at
        for check in self.lesson.checks:
            self._progress[check.name] = _Progress(_memories(check))

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

    def author_of(self, check: str) -> Hand:
        """By whose hand a check has ticked, or holds."""
        return self._progress[check].hand

    def tries(self, check: str) -> int:
        """How many wrong answers a question has got."""
        return self._progress[check].tries

    def evaluate(
        self, robot: RobotState, now: float, hand_of: Callable[[LessonCheck], Hand] = lambda _: NOBODY
    ) -> list[Ticked]:
        """Look at the checks whose turn it is; returns those that have ticked now.

        Args:
            robot: what it is like.
            now: seconds.
            hand_of: whose hand did the last thing at the slots of a check.
        """
        found: list[Ticked] = []
        for check in self._open():
            if check.question is not None:
                continue
            progress, hand = self._progress[check.name], hand_of(check)
            holds = self._all_hold(check, robot)
            if hand.doing is None:
                progress.memories = _memories(check)
            if not holds:
                progress.holds_since = None
                progress.hand = NOBODY
                continue
            if progress.holds_since is None:
                progress.holds_since, progress.hand = now, hand
            if progress.hand.doing is not None and now - progress.holds_since >= check.for_s:
                self._tick(progress, now)
                found.append(Ticked(check, progress.hand))
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
        self.answers[name] = answer
        if not any(question.is_right(answer) for question in (check.question, *others)):
            progress.tries += 1
            return False
        progress.hand = Hand(Doing.OWN)
        self._tick(progress, now)
        return True

    def since_tick(self, now: float) -> float:
        """Seconds since something ticked, or since the lesson began."""
        return now - self._last_tick_at

    def hint(self, robot: RobotState, now: float) -> Hint | None:
        """What to tell when nothing has ticked for long; None: not yet, or all is done."""
        if self.since_tick(now) < self.lesson.hint_after_s:
            return None
        return self.missing(robot)

    def missing(self, robot: RobotState) -> Hint | None:
        """The first check that has not ticked, and what is so instead; None: all is done."""
        check = next(iter(self._open()), None)
        if check is None:
            return None
        progress = self._progress[check.name]
        if progress.holds_since is not None and progress.hand.doing is None:
            return Hint(check.name, others_words(progress.hand.who), check.hint)
        seen = [
            condition.describe_actual(robot, memory)
            for condition, memory in zip(check.conditions, progress.memories, strict=True)
            if not condition.holds(robot, memory)
        ]
        if not seen and check.for_s:
            seen = [said("it holds, and must do so for {seconds:g} s", seconds=check.for_s)]
        return Hint(check.name, joined("; ", seen), check.hint)

    def ticks_of_others(self, check: str) -> str:
        """Who has done a check that does not tick for this person because of that; empty: nobody."""
        progress = self._progress[check]
        is_theirs = progress.ticked_at is None and progress.holds_since is not None and progress.hand.doing is None
        return progress.hand.who if is_theirs else ""

    def _open(self) -> list[LessonCheck]:
        """The checks whose turn it is and that have not ticked: up to the first step that waits for the robot."""
        found: list[LessonCheck] = []
        for step in self.lesson.steps:
            missing = [check for check in step.checks if self._progress[check.name].ticked_at is None]
            found += missing
            if any(check.question is None for check in missing):
                break
        return found

    def _all_hold(self, check: LessonCheck, robot: RobotState) -> bool:
        memories = self._progress[check.name].memories
        # Each is asked, also behind one that does not hold: some have to remember.
        held = [one.holds(robot, memory) for one, memory in zip(check.conditions, memories, strict=True)]
        return all(held)

    def _tick(self, progress: _Progress, now: float) -> None:
        progress.ticked_at = now
        self._last_tick_at = now


def others_words(who: str) -> str:
    """That somebody else has done it."""
    return said("{who} has done this: end it, and do it yourself", who=who)


def _memories(check: LessonCheck) -> list[ConditionMemory]:
    return [ConditionMemory() for _ in check.conditions]
