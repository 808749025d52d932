"""Whose hand did the last thing for a check of a lesson at a running robot."""

from __future__ import annotations

from msbot.operations.dispatch import InProcessOperations
from msbot.operations.last_manual_actions import STOP_BUTTON
from msbot.operations.running_robot import RunningRobot
from msbot_school.lessons.check_authors import Doing
from msbot_school.lessons.conditions import STOP, places
from msbot_school.lessons.lesson import LessonCheck
from msbot_school.lessons.lesson_run import NOBODY, Hand


class LessonHands:
    """Made when a lesson begins; what was done before does not count.

    Args:
        operations: what people do to the robot.
        running: the robot.
        in_world: whether its parts are in a world: there what is done at one slot may move the number of any other.
    """

    def __init__(self, operations: InProcessOperations, running: RunningRobot, *, in_world: bool) -> None:
        self._acts = operations.acts
        self._pupils = operations.pupils
        self._running = running
        self._in_world = in_world
        self._before = self._acts.count
        self._programs: set[tuple[str, str]] = set()
        """Pupils and the slots that their programs hold."""
        self._speaks_to: dict[str, set[str]] | None = None
        """Slot -> the slots whose messages it hears; None: to be worked out anew."""

    def begin(self) -> None:
        """The robot is set up: what has been done so far was that."""
        self._before = self._acts.count

    def observe(self) -> None:
        """See whose programs have come into which slots, and how they are wired."""
        self._speaks_to = None
        here = self._running.inventory.pupil_parts.here()
        found = {(pupil, slot) for pupil, slots in here.items() for slot in slots}
        for pupil, slot in sorted(found - self._programs):
            self._acts.note(pupil, [slot])
        self._programs = found

    def author_for(self, who: str, check: LessonCheck) -> Hand:
        """Whose hand did the last thing at the slots of a check, as that person sees it."""
        act = self._acts.latest(self._places(check), self._before)
        if act is None:
            return NOBODY
        if act.who == who:
            return Hand(Doing.OWN)
        group = self._pupils.group_of(who)
        if group and group == self._pupils.group_of(act.who):
            return Hand(Doing.GROUP, act.who)
        return Hand(Doing.HELPED if act.helps else None, act.who)

    def _places(self, check: LessonCheck) -> set[str]:
        found: set[str] = set()
        for condition in check.conditions:
            own, heard = places(condition)
            found |= {STOP_BUTTON if place == STOP else place for place in own}
            if heard:
                found |= self._behind(heard)
        return found

    def _behind(self, slots: set[str]) -> set[str]:
        """These slots, and those whose messages reach them."""
        if self._in_world:
            return set(self._running.slot_names())
        if self._speaks_to is None:
            self._speaks_to = {}
            for binding in self._running.blueprint.bindings:
                for target in binding.targets:
                    self._speaks_to.setdefault(target.slot, set()).add(binding.source.slot)
        speaks_to = self._speaks_to
        found, new = set(slots), set(slots)
        while new:
            new = {source for slot in new for source in speaks_to.get(slot, ())} - found
            found |= new
        return found
