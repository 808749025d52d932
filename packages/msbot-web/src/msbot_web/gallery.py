"""The page Robots and worlds: what can be chosen, what ends when it is, and the change itself, which only a demo makes.

A demo changes its robot by starting anew in its place: the same page, people, programs and database, another robot. So
whatever runs at the robot ends; who asks for a change is told first what that is.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from msbot.config import SAMPLES
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.rights import Principal, Right
from msbot.operations.teaching_operations import people_stop
from msbot_agent.text.sentence import counted, joined, said
from msbot_school.demo.gallery import GALLERY, ROVER, DemoChoice, GalleryEntry, brought_entries
from msbot_web.access.sessions import Session
from msbot_web.lessons_view import LessonsView
from msbot_web.model_builder import ModelBuilder
from msbot_web.models.robot_models import ChangeResult
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class ChangeWish:
    """What somebody has asked for."""

    choice: DemoChoice
    lesson: str
    """The lesson that begins there; empty: none."""
    who: str


Change = Callable[[ChangeWish], None]
"""Ends this robot soon, and starts the other one in its place."""


@dataclass(frozen=True, slots=True)
class RunningDemo:
    """The demo whose page this is."""

    now: DemoChoice
    """What it runs; a lesson may have put other slots and wires into force."""
    change: Change


class AskFirst(ConfigError):
    """Something would end that nobody has agreed to."""


class Gallery:
    """See the module's docstring.

    Args:
        place: the demo; None: this is another robot, which stays what it is.
        operations: of the robot that runs.
        learning: its lessons.
        views: its parts.
        require: checks a right at this moment.
        asker: who asks for an operation.
    """

    def __init__(
        self,
        place: RunningDemo | None,
        operations: InProcessOperations,
        learning: LessonsView,
        views: ModelBuilder,
        *,
        require: Callable[[Session, Right], object],
        asker: Callable[[Session], Principal],
    ) -> None:
        self._place = place
        self._operations = operations
        self._learning = learning
        self._views = views
        self._require = require
        self._asker = asker
        self._is_changing = False

    @property
    def now(self) -> DemoChoice | None:
        """What runs; None: no demo."""
        return None if self._place is None else self._place.now

    @property
    def is_changing(self) -> bool:
        """Whether this robot is about to make room for another one."""
        return self._is_changing

    @property
    def entries(self) -> Sequence[GalleryEntry]:
        """What can be chosen: what MsBOT brings, and then the worlds of extensions."""
        return (*GALLERY, *brought_entries())

    @property
    def entry(self) -> GalleryEntry | None:
        """The one that runs; None: it is none of the gallery's."""
        return next((one for one in self.entries if one.choice == self.now), None)

    def may_change(self, session: Session) -> bool:
        """Whether to offer a change: only a demo can, and only teachers may."""
        return self._place is not None and session.may(Right.DESIGN)

    def what_ends(self, choice: DemoChoice | None = None, lesson: str = "") -> list[str]:
        """What ends when the robot is changed, a sentence each; nothing of it: it can be changed unasked."""
        stays = self._stays(choice, lesson)
        found: list[str] = []
        running = self._learning.now()
        if running.get("lesson"):
            people = running.get("people")
            count = len(people) if isinstance(people, list) else 0
            found.append(
                counted(
                    count,
                    "the lesson {title!r} ends: {count} person takes part; ticks are kept",
                    "the lesson {title!r} ends: {count} people take part; ticks are kept",
                    title=str(running.get("title", "")),
                )
            )
        mission = self._operations.missions.state()
        if mission.get("mission"):
            found.append(said("the mission that runs ends without a result"))
        if stays:
            return found
        if stop := people_stop(self._strangers()):
            found.append(stop)
        if self._operations.stopping.status.stopped:
            found.append(said("STOP holds, and goes on to hold at the other robot until somebody says GO"))
        return found

    async def change(
        self, session: Session, choice: DemoChoice, lesson: str = "", *, agreed: bool = False
    ) -> ChangeResult:
        """Have another robot in place of this one.

        Args:
            session: who asks.
            choice: the robot, and its world.
            lesson: begins there; empty: none.
            agreed: whether the person knows what ends.

        Raises:
            NotAllowed: only teachers may.
            ConfigError: this is no demo, there is no such robot, world or lesson, or (`AskFirst`) something would end.
        """
        self._require(session, Right.DESIGN)
        place = self._place
        if place is None:
            raise ConfigError(
                said("only the demo changes its robot: start another one with {command}", command=choice.command)
            )
        await asyncio.to_thread(_check, choice)
        if lesson:
            found = self._learning.lesson_named(lesson)
            if found.world and found.world != choice.world:
                raise ConfigError(
                    said("the lesson {title!r} needs the world {world}", title=found.title, world=found.world)
                )
            if self._operations.stopping.status.stopped:
                raise ConfigError(said("STOP holds: a lesson begins after GO"))
        ends = self.what_ends(choice, lesson)
        if ends and not agreed:
            raise AskFirst(said("ask first: {ends}", ends=joined("; ", ends)))
        if self._is_changing:
            raise ConfigError(said("the robot is being changed already"))
        stays = self._stays(choice, lesson)
        self._is_changing = not stays
        try:
            if self._learning.now().get("lesson"):  # it puts back what it has changed
                await self._operations.do("stop_lesson", who=self._asker(session))
            if stays:
                done = await self._operations.do("start_lesson", who=self._asker(session), lesson=lesson)
                return ChangeResult(words=done.words)
            place.change(ChangeWish(choice, lesson, session.name))
        except BaseException:
            self._is_changing = False
            raise
        return ChangeResult(words=said("another robot takes this one's place: the page comes back by itself"))

    def _stays(self, choice: DemoChoice | None, lesson: str) -> bool:
        """Whether a lesson is for the robot that runs already."""
        return bool(lesson) and choice == self.now

    def choice_of(self, lesson: str) -> DemoChoice:
        """The robot that a lesson begins at.

        Raises:
            ConfigError: there is no such lesson.
        """
        found = self._learning.lesson_named(lesson)
        return DemoChoice(found.robot or ROVER.robot, found.world)

    def _strangers(self) -> list[str]:
        """Whose programs and parts no simulation of this program is."""
        bench = self._views.bench
        own = self._operations.stand_ins.uids | {bench.uid(slot) for slot in bench.slots()}
        return self._operations.faults.running.people_here(own)


def _check(choice: DemoChoice) -> None:
    """Raises ConfigError if it could not be started: this robot would have ended for nothing."""
    if choice.robot not in SAMPLES:
        raise ConfigError(
            said("there is no sample robot {name!r}: choose {robots}", name=choice.robot, robots=", ".join(SAMPLES))
        )
    if choice.world:
        from msbot.sim.arena import arena
        from msbot.sim.arena.world_reader import known_worlds, open_world

        if choice.world not in known_worlds():
            raise ConfigError(
                said(
                    "there is no world {name!r}: choose {worlds}",
                    name=choice.world,
                    worlds=", ".join(known_worlds()),
                )
            )
        arena.place_for(open_world(choice.world), None)
