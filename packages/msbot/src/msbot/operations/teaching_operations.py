"""Lessons as people begin, do and end them at a running robot; the lesson desk, if it has one, carries them out."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Final, Protocol

from msbot.operations.fault_request import FaultRequest
from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.registry import EditKind
from msbot_agent.text.sentence import joined, said
from msbot_xrce.errors import ConfigError


class LessonControl(Protocol):
    """The lesson desk of this robot."""

    async def begin(self, lesson: str, who: str) -> str:
        """Set the robot up for a lesson; says what was done."""

    async def who_stops(self, lesson: str) -> Sequence[str]:
        """Whose programs and parts lose their slots when that lesson begins."""

    async def end(self, who: str) -> str:
        """Put everything back; says what was done."""

    def join(self, who: str) -> str:
        """Let a person take part."""

    def answer(self, check: str, answer: str, who: str) -> str:
        """Answer a question of the lesson."""

    def hand(self, who: str, *, up: bool) -> str:
        """A person asks for help, or does not any more."""

    def as_json(self) -> Mapping[str, object]:
        """The lesson that runs."""


def people_stop(people: Sequence[str]) -> str:
    """That programs and parts stop because the robot gets other slots, in words; empty: nobody's."""
    if not people:
        return ""
    return said("programs and parts of people stop: {parts}; their texts are kept", parts=joined(", ", people))


class Lessons:
    """The operations of a robot's lesson desk."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._desk: LessonControl | None = None

    def attach(self, desk: LessonControl) -> None:
        """Say who carries lessons out."""
        self._desk = desk

    def note(self, words: str, who: str) -> None:
        """Note in the journal what a lesson did; for the desk."""
        self.running.note(EditKind.LESSON, words, who)

    async def start_lesson(self, lesson: str, who: str) -> Outcome:
        """Begin a lesson."""
        return Outcome(await self._the_desk().begin(lesson, who))

    async def who_stops(self, lesson: str) -> Outcome:
        """Whose programs and parts stop when a lesson begins."""
        people = list(await self._the_desk().who_stops(lesson))
        return Outcome(people_stop(people), answer={"people": people})

    async def stop_lesson(self, who: str) -> Outcome:
        """End the lesson that runs."""
        return Outcome(await self._the_desk().end(who))

    def join_lesson(self, who: str) -> Outcome:
        """Take part in the lesson that runs."""
        return Outcome(self._the_desk().join(who))

    def answer_lesson(self, check: str, answer: str, who: str) -> Outcome:
        """Answer a question of the lesson that runs."""
        return Outcome(self._the_desk().answer(check, answer, who))

    def raise_hand(self, who: str, *, up: bool) -> str:
        """Somebody's hand is up, or down: the lesson that runs knows it; empty: none runs."""
        if self._desk is None or self._desk.as_json().get("lesson") is None:
            return ""
        return self._desk.hand(who, up=up)

    def lesson(self) -> Outcome:
        """The lesson that runs."""
        return Outcome(answer=dict(self._the_desk().as_json()))

    def _the_desk(self) -> LessonControl:
        if self._desk is None:
            raise ConfigError(said("this robot runs without lessons"))
        return self._desk


# Missions, as people start, solve and stop them; the laboratory, if this robot has one, plays them.


class MissionControl(Protocol):
    """What plays missions in this robot; each method raises `ConfigError` with what is wrong."""

    def start(self, name: str, toml: str, seed: int | None, who: str) -> Awaitable[str]:
        """Begin a ready mission, or, with `toml`, that of a file with this name; says what begins."""

    def stop(self, who: str) -> str:
        """End the mission that runs; says which."""

    def answer(self, kind: str, at: str, who: str) -> str:
        """Somebody says what is wrong and where; says whether that is so."""

    def repair(self, repair: str, at: str, who: str) -> str:
        """Somebody has something repaired; says what came of it."""

    def hint(self, who: str) -> str:
        """The next hint."""

    def as_json(self) -> Mapping[str, object]:
        """The mission that runs, without its answers; empty: none."""

    def obstacles(self) -> Mapping[str, str]:
        """The ready missions that need another robot, and why, a sentence each."""

    def report(self, number: int | None) -> Mapping[str, object]:
        """The report of a mission that is over; without number the latest."""


class Missions:
    """The operations of missions."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._control: MissionControl | None = None
        self._listeners: list[Callable[[Mapping[str, object]], object]] = []

    def attach(self, control: MissionControl) -> None:
        """Say what plays missions."""
        self._control = control

    def on_note(self, listener: Callable[[Mapping[str, object]], object]) -> None:
        """Call the listener with every note of a mission, for a recording."""
        self._listeners.append(listener)

    def noted(self, note: Mapping[str, object]) -> None:
        """Tell of a note; for what plays missions."""
        for listener in self._listeners:
            listener(note)

    def journal(self, words: str, who: str) -> None:
        """Note in the journal that a mission has begun or ended; for what plays missions."""
        self.running.note(EditKind.MISSION, words, who)

    async def start_mission(self, mission: str, toml: str, seed: int | None, who: str) -> Outcome:
        """Begin a mission."""
        return Outcome(await self._the_control().start(mission, toml, seed, who))

    def stop_mission(self, who: str) -> Outcome:
        """End it."""
        return Outcome(self._the_control().stop(who))

    def answer_mission(self, kind: str, at: str, who: str) -> Outcome:
        """Say what is wrong, and where."""
        return Outcome(self._the_control().answer(kind, at, who))

    def repair(self, repair: str, at: str, who: str) -> Outcome:
        """Have something repaired."""
        return Outcome(self._the_control().repair(repair, at, who))

    def mission_hint(self, who: str) -> Outcome:
        """The next hint."""
        return Outcome(self._the_control().hint(who))

    def state(self) -> Mapping[str, object]:
        """The mission that runs, without its answers, and the numbers of those that are over."""
        return {"reports": []} if self._control is None else self._control.as_json()

    def obstacles(self) -> Mapping[str, str]:
        """The ready missions that need another robot, and why, a sentence each."""
        return {} if self._control is None else self._control.obstacles()

    def report(self, number: int | None) -> Mapping[str, object]:
        """A mission that is over, with its notes; without number the latest.

        Raises:
            ConfigError: there is none.
        """
        return self._the_control().report(number)

    def mission(self) -> Outcome:
        """The mission that runs."""
        return Outcome(answer=dict(self.state()))

    def mission_report(self, number: int | None) -> Outcome:
        """A mission that is over."""
        return Outcome(answer=dict(self.report(number)))

    def _the_control(self) -> MissionControl:
        if self._control is None:
            raise ConfigError(said("this robot runs without missions"))
        return self._control


# Faults on purpose, as people plant and clear them; the fault lab, if this robot has one, carries them out.


class FaultControl(Protocol):
    """The fault lab of this robot."""

    def plant(self, wish: FaultRequest, who: str) -> str:
        """Plant a fault; says what will happen."""

    def clear(self, number: int | None, who: str) -> str:
        """End one fault, or all; says what was ended."""

    def as_json(self, *, with_answers: bool) -> Mapping[str, object]:
        """What is planted; without answers, nothing of what a mission wants to be found."""

    def visible_faults(self, slot: str) -> Sequence[str]:
        """What may be told to everybody of the faults at a slot, or, for an empty slot, of those of the robot."""


class Faults:
    """The operations of a robot's fault lab."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._lab: FaultControl | None = None
        self._listeners: list[Callable[[Mapping[str, object]], object]] = []
        self._looked_listeners: list[Callable[[str], object]] = []

    def attach(self, lab: FaultControl) -> None:
        """Say who carries faults out."""
        self._lab = lab

    def on_change(self, listener: Callable[[Mapping[str, object]], object]) -> None:
        """Call the listener with every beginning and end of a fault."""
        self._listeners.append(listener)

    def on_looked(self, listener: Callable[[str], object]) -> None:
        """Call the listener with the name of everybody who has had the answers of a mission shown."""
        self._looked_listeners.append(listener)

    def changed(self, change: Mapping[str, object], words: str, who: str) -> None:
        """Note in the journal, and tell, that a fault has begun or ended; for the lab."""
        self.running.note(EditKind.FAULT, words, who)
        for listener in self._listeners:
            listener(change)

    def visible_faults(self, slot: str) -> Sequence[str]:
        """See `FaultControl.visible_faults`; nothing without a lab."""
        return () if self._lab is None else self._lab.visible_faults(slot)

    def listed(self) -> Sequence[Mapping[str, object]]:
        """What is planted, also what is hidden, but no answers of a mission; nothing without a lab."""
        found = () if self._lab is None else self._lab.as_json(with_answers=False)["faults"]
        assert isinstance(found, Sequence)
        return found

    def plant_fault(  # noqa: PLR0917 - the arguments of the table
        self,
        kind: str,
        at: str,
        amount: float | None,
        jitter_ms: float | None,
        port: str,
        number: str,
        after_s: float,
        for_s: float | None,
        when: str,
        chance: float | None,
        seed: int | None,
        hidden: bool,
        who: str,
    ) -> Outcome:
        """Plant a fault."""
        wish = FaultRequest(
            kind, at, amount, jitter_ms, port, number, after_s, for_s, when, chance, seed, hidden=hidden
        )
        return Outcome(self.plant(wish, who))

    def plant(self, wish: FaultRequest, who: str) -> str:
        """Plant a fault; says what will happen.

        Raises:
            ConfigError: it cannot be planted; the text says why.
        """
        return self._the_lab().plant(wish, who)

    def clear_fault(self, fault: int | None, who: str) -> Outcome:
        """End one fault, or all."""
        return Outcome(self._the_lab().clear(fault, who))

    def faults(self, answers: bool, who: str) -> Outcome:
        """What is planted, also what is hidden from the class; with `answers` also what a mission wants found."""
        found = self._the_lab().as_json(with_answers=answers)
        for listener in self._looked_listeners if answers else ():
            listener(who)
        return Outcome(answer=dict(found))

    def _the_lab(self) -> FaultControl:
        if self._lab is None:
            raise ConfigError(said("this robot runs without a fault lab"))
        return self._lab


# The world that a robot's simulated parts drive in, as people stop it, begin it anew and put robots elsewhere.


STEPS_PER_S: Final = 50
"""Steps of a world in one of its seconds."""


class WorldControl(Protocol):
    """The world of this robot, if it is in this program."""

    paused: bool
    speed: float

    def step(self) -> None:
        """Let one step pass in a world that stands still."""

    def reset(self) -> None:
        """Begin anew."""

    def put(self, robot: str, at: tuple[float, float], heading_deg: float | None = None) -> None:
        """Take a robot by hand and put it elsewhere; metres and degrees."""

    def as_json(self) -> Mapping[str, object]:
        """Where everything is."""


class Worlds:
    """The operations of a world."""

    def __init__(self) -> None:
        self._world: WorldControl | None = None

    def attach(self, world: WorldControl) -> None:
        """Say which world it is."""
        self._world = world

    def pause_world(self, off: bool, who: str) -> Outcome:  # noqa: ARG002 - the table's: nothing is noted
        """Stop the world's time, or let it go on; the robot's own time is not the world's."""
        self._the_world().paused = not off
        return Outcome(said("the world goes on") if off else said("the world stands still"))

    def step_world(self, steps: int, who: str) -> Outcome:  # noqa: ARG002 - as above
        """Let some steps pass in a world that stands still from then on."""
        world = self._the_world()
        world.paused = True
        for _ in range(steps):
            world.step()
        return Outcome(said("{seconds:g} s have passed in the world", seconds=steps / STEPS_PER_S))

    def reset_world(self, who: str) -> Outcome:  # noqa: ARG002 - as above
        """Everything as at the start."""
        self._the_world().reset()
        return Outcome(said("the world has begun anew"))

    def world_speed(self, speed: float, who: str) -> Outcome:  # noqa: ARG002 - as above
        """How many seconds pass in the world in one second."""
        self._the_world().speed = speed
        return Outcome(said("the world's speed is {speed:g}", speed=speed))

    def put_robot(self, robot: str, x: float, y: float, heading: float | None, who: str) -> Outcome:  # noqa: ARG002
        """Put a robot elsewhere; metres, and degrees counter-clockwise from east."""
        if not all(math.isfinite(value) for value in (x, y, heading or 0.0)):
            raise ConfigError(said("a place is two numbers in metres"))
        self._the_world().put(robot, (x, y), heading)
        return Outcome(said("{robot} is put elsewhere", robot=robot))

    def world(self) -> Outcome:
        """Where everything is."""
        return Outcome(answer=dict(self._the_world().as_json()))

    def _the_world(self) -> WorldControl:
        if self._world is None:
            raise ConfigError(said("this robot is in no world: start it with msbot demo --world line"))
        return self._world
