"""The lesson desk of a running robot: sets the robot up for a lesson, looks whether it is done, puts everything back.

Theory of operation. A lesson has a robot of its own: its slots and wires are put into force as a blueprint, and
stand-ins take the slots that have no part. Whoever takes part has a run of their own (`lessons.run`). Four times a
second the checks of the runs are looked at, and it is worked out whose hand has done each. At the end whatever was
changed since the beginning, by the desk and by people, is undone, the newest change first.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from typing import Final

from msbot.config import SAMPLES, Blueprint, open_blueprint, parse_blueprint
from msbot.operations.dispatch import InProcessOperations
from msbot.process.worker_pool import WorkerPool
from msbot.registry import EditKind
from msbot.registry.lesson_ticks import BEGUN
from msbot_agent.link.can.sim import SimBusDriver
from msbot_agent.text.sentence import joined, said
from msbot_school.faults.effects import PartsHere
from msbot_school.faults.fault_kinds import LOAD
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.check_author_lookup import LessonHands
from msbot_school.lessons.check_authors import Doing
from msbot_school.lessons.conditions import sources
from msbot_school.lessons.lesson import Lesson, LessonCheck
from msbot_school.lessons.lesson_run import Hint, LessonRun, Ticked
from msbot_school.lessons.robot_state import RunningRobotState
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

LOOK_S: Final = 0.25
"""Period in which checks are looked at."""
SETTLED_S: Final = 3.0
"""After the start the first page comes first: reading all lessons takes as long. Who looks at them does not wait."""
FILES_S: Final = 5.0
"""How old the lessons' texts may be, while somebody looks at them."""
MOST_PEOPLE: Final = 100
"""Most people who take part in one run of a lesson."""
EDITS: Final = 1000
"""Most changes that are undone at the end of a lesson."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Begun:
    """The lesson that runs, and what has to be put back."""

    lesson: Lesson
    began_at: float
    who: str
    began_ns: int
    newest_edit: int
    faults: set[int]
    hands_of: LessonHands
    """Whose hand has done what."""
    runs: dict[str, LessonRun] = field(default_factory=dict)
    """Who takes part, and how far they are."""
    hands: dict[str, float] = field(default_factory=dict)
    """Who asks for help, and since when."""
    unplugged: list[str] = field(default_factory=list)
    stand_ins: tuple[str, ...] = ()
    """Slots that were simulated before."""
    real_again: list[str] = field(default_factory=list)
    """Those of them whose stand-in has ended for the lesson."""
    second: list[str] = field(default_factory=list)
    """Slots that got a simulated part which is no stand-in."""
    holders: dict[str, bytes] = field(default_factory=dict)
    """Who held which slot before."""


class LessonController:
    """The lesson desk of one running robot; made in its event loop.

    Args:
        operations: what can be done to the robot.
        shelf: the lessons that there are.
        parts: its parts that are simulated in this process; None: its stand-ins.
        bus: its simulated bus.
        world: the name of the world that the robot is in; empty: none.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self,
        operations: InProcessOperations,
        shelf: LessonCatalog,
        *,
        parts: PartsHere | None = None,
        bus: SimBusDriver | None = None,
        world: str = "",
        epoch_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._operations = operations
        self._running = operations.faults.running
        self.shelf = shelf
        self._parts: PartsHere = operations.stand_ins if parts is None else parts
        self._robot = RunningRobotState(self._running, bus)
        self._world = world
        self._epoch_ns = epoch_ns
        self._workshop = WorkerPool()
        self._begun: _Begun | None = None
        self._is_busy = False
        self._looked_at = float("-inf")
        self._wake = asyncio.Event()
        self._trouble = ""
        operations.lessons.attach(self)

    @property
    def lesson(self) -> Lesson | None:
        """The lesson that runs."""
        return None if self._begun is None else self._begun.lesson

    # What people do.

    async def begin(self, lesson: str, who: str) -> str:
        """See `LessonControl`.

        Raises:
            ConfigError: it cannot be begun; nothing has changed.
        """
        if self._begun is not None or self._is_busy:
            name = "" if self._begun is None else self._begun.lesson.title
            raise ConfigError(said("the lesson {name!r} runs already: end it first", name=name))
        if self._running.master.stop.stopped:
            raise ConfigError(said("STOP holds: a lesson begins after GO"))
        self._is_busy = True
        try:
            await asyncio.to_thread(self.shelf.refresh)  # its author may have changed it this moment
            wanted = self.shelf.get(lesson)
            if obstacle := self.obstacle(wanted):
                raise ConfigError(obstacle)
            return await self._set_up(wanted, who)
        finally:
            self._is_busy = False

    def obstacle(self, lesson: Lesson) -> str:
        """Why nobody could do the lesson to its end at this robot, a sentence; empty: it can be done here."""
        if lesson.world and lesson.world != self._world:
            return said(
                "the lesson {title!r} needs a robot in the world {world}: start it on a demo's page Robots and "
                "worlds, or by `msbot demo --lesson {name}`",
                title=lesson.title,
                world=lesson.world,
                name=lesson.name,
            )
        looks_at = {source for check in lesson.checks for one in check.conditions for source in sources(one)}
        if LOAD in looks_at and not self._robot.has_bus:
            return said(
                "the lesson {title!r} needs a robot on a simulated bus, whose load is known: start it on a demo's page "
                "Robots and worlds, or by `msbot demo --lesson {name}`",
                title=lesson.title,
                name=lesson.name,
            )
        return ""

    async def who_stops(self, lesson: str) -> list[str]:
        """Whose programs and parts lose their slots when that lesson begins, see `RunningRobot.people_here`.

        Raises:
            ConfigError: there is no such lesson, or its blueprint is wrong.
        """
        if not self.shelf.is_read:
            await asyncio.to_thread(self.shelf.refresh)
        if await self._blueprint(self.shelf.get(lesson)) is None:
            return []
        own = self._operations.stand_ins.uids | {self._parts.uid(slot) for slot in self._parts.names}
        return self._running.people_here(own)

    async def end(self, who: str) -> str:
        """See `LessonControl`.

        Raises:
            ConfigError: no lesson runs.
        """
        begun = self._need()
        if self._is_busy:
            raise ConfigError(said("the lesson is being set up or put back at this moment"))
        self._is_busy = True
        try:
            self._begun = None
            left = await self._put_back(begun, who)
        finally:
            self._is_busy = False
        title = begun.lesson.title
        self._operations.lessons.note(said("the lesson {title!r} is over", title=title), who)
        if left:
            return said("the lesson {title!r} is over; not put back: {left}", title=title, left=joined("; ", left))
        return said("the lesson {title!r} is over; everything is as it was before", title=title)

    def join(self, who: str) -> str:
        """See `LessonControl`.

        Raises:
            ConfigError: no lesson runs, or too many people take part.
        """
        begun = self._need()
        if who not in begun.runs:
            if len(begun.runs) >= MOST_PEOPLE:
                raise ConfigError(said("{most} people take part, which is the most", most=MOST_PEOPLE))
            begun.runs[who] = LessonRun(begun.lesson, self._running.now())
            self._keep(begun, (who,), BEGUN)
            self._wake.set()
        return said("{who} takes part in {title!r}", who=who, title=begun.lesson.title)

    def answer(self, check: str, answer: str, who: str) -> str:
        """See `LessonControl`.

        Raises:
            ConfigError: there is no such question now, or the answer is wrong.
        """
        begun = self._need()
        self.join(who)
        questions = self.shelf.questions(begun.lesson, check)
        run = begun.runs[who]
        if not run.answer(check, answer, self._running.now(), questions):
            raise ConfigError(said("that is not right yet"))
        found = begun.lesson.check(check)
        assert found is not None
        self._ticked(begun, {who: [Ticked(found, run.author_of(check))]})
        return said("that is right, {who}", who=who)

    def hand(self, who: str, *, up: bool) -> str:
        """See `LessonControl`.

        Raises:
            ConfigError: no lesson runs.
        """
        begun = self._need()
        if up and (who in begun.runs or len(begun.hands) < MOST_PEOPLE):
            begun.hands.setdefault(who, self._running.now())
            return said("{who} asks for help", who=who)
        begun.hands.pop(who, None)
        return said("{who} asks for nothing", who=who)

    def forget(self, who: str) -> None:
        """A person is removed: whoever has that name later does not take part."""
        if self._begun is not None:
            self._begun.runs.pop(who, None)
            self._begun.hands.pop(who, None)

    def look_again(self) -> None:
        """Somebody looks at the lessons: read the files again, unless that was just done."""
        now = self._running.now()
        if now - self._looked_at >= FILES_S:
            self._looked_at = now
            self._running.run_later(asyncio.to_thread(self.shelf.refresh))

    def hint_now(self, who: str) -> Hint | None:
        """What is missing for a person's next check; None: nothing, or they do not take part."""
        run = self.run_of(who)
        return None if run is None else run.missing(self._robot)

    def run_of(self, who: str) -> LessonRun | None:
        """How far a person is; None: they do not take part, or no lesson runs."""
        return None if self._begun is None else self._begun.runs.get(who)

    def seconds_of(self, who: str) -> float:
        """For how long a person has taken part, seconds; 0: they do not."""
        run = self.run_of(who)
        return 0.0 if run is None else self._running.now() - run.begun_at

    def as_json(self) -> Mapping[str, object]:
        """See `LessonControl`."""
        begun, now = self._begun, self._running.now()
        if begun is None:
            return {"lesson": None, "trouble": self._trouble}
        lesson = begun.lesson
        people = [self._person(name, run, now) for name, run in begun.runs.items()]
        return {
            "lesson": lesson.name,
            "title": lesson.title,
            "who": begun.who,
            "since_s": now - begun.began_at,
            "steps": len(lesson.steps),
            "done": bool(begun.runs) and all(run.is_done for run in begun.runs.values()),
            "checks": [
                {
                    "check": check.name,
                    "says": check.says,
                    "ticked": [name for name, run in begun.runs.items() if check.name in run.ticked],
                }
                for check in lesson.checks
            ],
            "progress": people,
            "people": list(begun.runs),
            "hands": {name: now - at for name, at in begun.hands.items()},
            "trouble": self._trouble,
        }

    def _person(self, name: str, run: LessonRun, now: float) -> Mapping[str, object]:
        hint = run.hint(self._robot, now)
        return {
            "person": name,
            "step": run.step,
            "done": run.is_done,
            "ticked": {
                check: {"after_s": at - run.begun_at, "doing": _doing(run, check).value, "by": run.author_of(check).who}
                for check, at in run.ticked.items()
            },
            "quiet_s": run.since_tick(now),
            "hint": None if hint is None else {"check": hint.check, "seen": hint.seen, "look": hint.look},
        }

    async def run(self) -> None:
        """Look at the checks of the lesson that runs, until cancelled."""
        settling = self._running.loop.call_later(SETTLED_S, self._read_unless_read)
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while (begun := self._begun) is not None:
                    self._look(begun)
                    await asyncio.sleep(LOOK_S)
        finally:
            settling.cancel()

    # How it works.

    def _read_unless_read(self) -> None:
        if not self.shelf.is_read:
            self.look_again()

    def _need(self) -> _Begun:
        if self._begun is None:
            raise ConfigError(said("no lesson runs: begin one on the page Learn, or with `msbot lesson start`"))
        return self._begun

    async def _set_up(self, lesson: Lesson, who: str) -> str:
        wanted = await self._blueprint(lesson)
        edits = await self._operations.undoing.read(1)
        begun = _Begun(
            lesson=lesson,
            began_at=self._running.now(),
            hands_of=LessonHands(self._operations, self._running, in_world=bool(self._world)),
            who=who,
            began_ns=self._epoch_ns(),
            newest_edit=edits[0].id if edits else 0,
            stand_ins=self._operations.stand_ins.names,
            holders=self._holders(),
            faults={number for fault in self._operations.faults.listed() if isinstance(number := fault["number"], int)},
        )
        try:
            if wanted is not None:
                await self._operations.applying.put_in_force(wanted, self._running.library, who=who)
            await self._fill(begun, lesson, who)
            for slot, values in (lesson.settings or {}).items():
                for name, value in values.items():
                    await self._operations.do("set", who=who, slot=slot, name=name, value=value)
            for fault in lesson.faults:
                self._operations.faults.plant(fault, who)
        except MsbotError:
            await self._put_back(begun, who)
            raise
        self._begun = begun
        begun.hands_of.begin()
        self._trouble = ""
        self.join(who)
        self._wake.set()
        self._operations.lessons.note(said("the lesson {title!r} begins", title=lesson.title), who)
        return said("the lesson {title!r} begins: its page is Learn", title=lesson.title)

    async def _blueprint(self, lesson: Lesson) -> Blueprint | None:
        """The running robot with the slots and wires of the lesson; None: it has them."""
        library = self._running.library
        if library is None:
            raise ConfigError(said("this robot was started without its library: it cannot take another blueprint"))
        if lesson.blueprint is not None:
            wanted, _ = await self._workshop.run(open_blueprint, lesson.blueprint)
        else:
            wanted = parse_blueprint(SAMPLES[lesson.robot], library)
        present = await self._operations.applying.present()
        if (present.slots, present.bindings) == (wanted.slots, wanted.bindings):
            return None
        return replace(present, slots=wanted.slots, bindings=wanted.bindings)

    async def _fill(self, begun: _Begun, lesson: Lesson, who: str) -> None:
        """Stand-ins for slots without a part; those that begin empty are pulled out, and so are spares."""
        for spare in set(self._parts.names) - set(self._running.slot_names()):
            if self._parts.is_plugged(spare):
                self._parts.unplug(spare)
                begun.unplugged.append(spare)
        for slot in set(lesson.spares) & set(self._operations.stand_ins.names):
            await self._operations.do("simulate", who=who, slot=slot, end=True)
            begun.real_again.append(slot)
        for slot in self._running.slot_names():
            is_here = slot in self._parts.names
            if slot in lesson.unplugged and is_here:
                if self._parts.is_plugged(slot):
                    self._parts.unplug(slot)
                    begun.unplugged.append(slot)
                continue
            holder = self._running.holder(slot)
            is_held = holder is not None and holder.state.is_registered
            if is_here and not self._parts.is_plugged(slot):
                self._parts.plug(slot)
            elif not is_here and not is_held and slot in lesson.spares:
                await self._operations.stand_ins.add_second(slot)
                begun.second.append(slot)
            elif not is_here and not is_held:
                # One that begins pulled out, too: without a stand-in its card has nothing that could be plugged in.
                await self._operations.do("simulate", who=who, slot=slot)
                if slot in lesson.unplugged:
                    self._operations.stand_ins.unplug(slot)

    async def _put_back(self, begun: _Begun, who: str) -> list[str]:
        """What could not be put back, and why."""
        left: list[str] = []

        async def attempt(deed: Callable[[], object]) -> str:
            try:
                result = deed()
                if asyncio.iscoroutine(result):
                    await result
            except MsbotError as error:
                return str(error)
            return ""

        for fault in self._operations.faults.listed():
            if isinstance(number := fault["number"], int) and number not in begun.faults:
                left.append(await attempt(partial(self._operations.do, "clear_fault", who=who, fault=number)))
        for slot in set(self._operations.stand_ins.names) - (set(begun.stand_ins) - set(begun.real_again)):
            left.append(await attempt(partial(self._operations.do, "simulate", who=who, slot=slot, end=True)))
        for slot in begun.second:
            await self._operations.stand_ins.end_second(slot)
        made = [edit for edit in await self._operations.undoing.read(EDITS) if edit.id > begun.newest_edit]
        for edit in made:
            if edit.can_be_undone:
                why = await attempt(partial(self._operations.do, "undo", who=who, edit=edit.id))
                # A part that was only there for the lesson cannot be put back; whoever was there before, is again.
                if edit.kind != EditKind.PLACE.value or self._holders() != begun.holders:
                    left.append(why)
        for slot in set(begun.real_again) - set(self._operations.stand_ins.names):
            left.append(await attempt(partial(self._operations.do, "simulate", who=who, slot=slot)))
        for slot in begun.unplugged:
            if slot in self._parts.names and not self._parts.is_plugged(slot):
                left.append(await attempt(partial(self._parts.plug, slot)))
        return [why for why in left if why]

    def _holders(self) -> dict[str, bytes]:
        return {
            slot: holder.uid
            for slot in self._running.slot_names()
            if (holder := self._running.holder(slot)) is not None and holder.state.is_registered
        }

    def _look(self, begun: _Begun) -> None:
        """Look at what everybody who takes part has to do now."""
        begun.hands_of.observe()
        now = self._running.now()
        found = {
            who: ticked
            for who, run in begun.runs.items()
            if (ticked := run.evaluate(self._robot, now, partial(begun.hands_of.author_for, who)))
        }
        self._ticked(begun, found)

    def _ticked(self, begun: _Begun, found: Mapping[str, Sequence[Ticked]]) -> None:
        """Note and keep what has ticked for whom."""
        checks: dict[str, LessonCheck] = {}
        rows: dict[tuple[str, Doing, str], list[str]] = {}
        for who, ticked in found.items():
            for one in ticked:
                checks[one.check.name] = one.check
                assert one.by.doing is not None
                rows.setdefault((one.check.name, one.by.doing, one.by.who), []).append(who)
        for name, check in checks.items():
            people = [who for (one, _, _), names in rows.items() if one == name for who in names]
            self._operations.lessons.note(said("ticked: {says}", says=check.says), joined(", ", people))
        for (name, doing, by), people in rows.items():
            self._keep(begun, tuple(people), name, doing, by)

    def _keep(self, begun: _Begun, people: tuple[str, ...], check: str, doing: Doing = Doing.OWN, by: str = "") -> None:
        """Keep a tick in the database, without waiting for it."""
        registry = self._running.registry
        if registry is None or not people:
            return
        note, at_ns = registry.lesson_ticks.note, self._epoch_ns()
        work = partial(note, people, begun.lesson.name, check, at_ns, doing=doing.value, by=by)

        async def keep() -> None:
            try:
                await registry.storage.in_time(work)
            except MsbotError as error:
                self._trouble = said("what was done is not kept: {error}", error=str(error))
                _log.warning("%s", self._trouble)

        self._running.run_later(keep())


def _doing(run: LessonRun, check: str) -> Doing:
    doing = run.author_of(check).doing
    assert doing is not None  # else it would not have ticked
    return doing
