"""The example of each world does its task there: rounds, way out, push, park, sort, deliver; in the world's own time.

The program runs as it is. Between it and the world there is no master and no bus here, only what its parts would say:
`test_driving.py` has a whole robot.
"""

from __future__ import annotations

import math
import runpy
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any

import pytest

from msbot import Angle, Colour, Distance, Line, Speed, Switch
from msbot.sim.arena.arena import Arena
from msbot.sim.arena.arena_robot import ArenaRobot
from msbot.sim.arena.wheels import SENSE_STEPS, STEP_S
from msbot.sim.arena.world_reader import open_world, shipped_worlds
from tests import ROOT

EXAMPLES = ROOT / "examples/arena"
TICK_S = SENSE_STEPS * STEP_S
JAW_MM, FINGERS_MM_S = 55.0, 80.0
PARTS = {
    "wheels": ("motor.left", "motor.right"),
    "rear_wheels": ("motor.left", "motor.right"),
    "line": ("line.place", "line.seen"),
    "eyes": ("distance",),
    "floor": ("colour.red", "colour.green", "colour.blue"),
    "left_wheel": ("wheel",),
    "right_wheel": ("wheel",),
    "compass": ("heading",),
    "reed": ("magnet",),
    "hand": ("grip.opening", "grip.thing"),
}
"""The parts of the sample `buggy` that the programs use, and what they sense and do."""


@dataclass
class Program:
    """Stands in for the program's part: keeps what it asks for and what it says."""

    number: str
    handlers: dict[str, Callable[[Any], None]] = field(default_factory=dict)
    calls: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    """What it wants to be called, and after how many seconds each time."""
    said: dict[str, Any] = field(default_factory=dict)

    def on(self, port: str, _message: type) -> Callable[[Callable[[Any], None]], Callable[[Any], None]]:
        return lambda handler: self.handlers.setdefault(port, handler)

    def every(self, period_s: float) -> Callable[[Callable[[], None]], Callable[[], None]]:
        def keep(call: Callable[[], None]) -> Callable[[], None]:
            self.calls.append((period_s, call))
            return call

        return keep

    def publish(self, port: str, message: Any) -> None:
        self.said[port] = message

    def run(self) -> None:
        """The test does."""


class Stage:
    """A world with a program in it."""

    def __init__(self, world: str, program: Program) -> None:
        self.arena = Arena(open_world(world))
        self.robot: ArenaRobot = self.arena.robot("robot")
        self.program = program
        self._ticks = 0
        self._random = Random(1)
        self._line = 0.0
        self._jaw = JAW_MM
        for slot, quantities in PARTS.items():
            self.arena.mount("robot", slot, quantities)

    def tick(self) -> None:
        """A fiftieth of a second."""
        self._ticks += 1
        for every, port, tell in (
            (2, "line", self._tell_line),
            (5, "distance", self._tell_distance),
            (5, "heading", self._tell_heading),
            (5, "left_speed", lambda: self._tell_speed("left_wheel")),
            (5, "right_speed", lambda: self._tell_speed("right_wheel")),
            (5, "magnet", lambda: Switch(on=bool(self._sense("reed")["magnet"]))),
            (5, "holding", lambda: Switch(on=self.robot.held is not None)),
            (10, "colour", self._tell_colour),
        ):
            handler = self.program.handlers.get(port)
            if handler is not None and self._ticks % every == 0:
                handler(tell())
        for period_s, call in self.program.calls:
            if int(self._ticks * TICK_S / period_s + 1e-9) > int((self._ticks - 1) * TICK_S / period_s + 1e-9):
                call()
        self._act()
        self.arena.step(SENSE_STEPS)

    def until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Whether it is done within that time."""
        for _ in range(round(seconds / TICK_S)):
            self.tick()
            if done():
                return True
        return False

    def _act(self) -> None:
        power = {port: message.percent for port, message in self.program.said.items() if hasattr(message, "percent")}
        for slot, prefix in (("wheels", ""), ("rear_wheels", "rear_")):
            self.arena.drive(
                "robot",
                slot,
                {f"motor.{side}": max(-100.0, min(100.0, power.get(prefix + side, 0.0))) for side in ("left", "right")},
            )
        wanted = JAW_MM * (1 - power.get("grip", 0.0) / 100)
        step = FINGERS_MM_S * TICK_S
        thing = float(self._sense("hand").get("grip.thing", 0.0))
        self._jaw = max(self._jaw - step, wanted, thing) if wanted < self._jaw else min(self._jaw + step, wanted)
        self.arena.drive("robot", "hand", {"grip.opening": self._jaw})

    def _sense(self, slot: str) -> dict[str, float | bool]:
        return self.arena.sense("robot", slot, PARTS[slot])

    def _tell_line(self) -> Line:
        found = self._sense("line")
        self._line = float(found.get("line.place", self._line))
        return Line(position=self._line, seen=bool(found["line.seen"]))

    def _tell_distance(self) -> Distance:
        metres = float(self._sense("eyes")["distance"]) + self._random.gauss(0, 0.002)
        return Distance(metres=max(0.0, min(4.0, metres)), in_range=metres <= 4.0)

    def _tell_heading(self) -> Angle:
        return Angle(degrees=(float(self._sense("compass")["heading"]) + self._random.gauss(0, 0.5)) % 360.0)

    def _tell_speed(self, slot: str) -> Speed:
        return Speed(rpm=abs(float(self._sense(slot)["wheel"])))

    def _tell_colour(self) -> Colour:
        found = self._sense("floor")
        return Colour(**{name: round(float(found[f"colour.{name}"])) for name in ("red", "green", "blue")})

    def is_in(self, area: str, x: float, y: float) -> bool:
        corners = next(one for one in self.arena.plan.areas if one.name == area).corners
        return min(c[0] for c in corners) <= x <= max(c[0] for c in corners) and min(c[1] for c in corners) <= y <= max(
            c[1] for c in corners
        )


def program(monkeypatch: pytest.MonkeyPatch, name: str) -> Program:
    monkeypatch.setattr("msbot.Part", Program)
    found = runpy.run_path(str(EXAMPLES / f"{name}.py"))["part"]
    assert isinstance(found, Program)
    return found


def box(stage: Stage, name: str) -> tuple[float, float]:
    pose = stage.arena.poses()[name]
    return pose.x, pose.y


def sorted_colours(stage: Stage) -> set[str]:
    """The colours of boxes that lie in their field."""
    names = [thing.plan.name for thing in stage.arena.boxes]
    return {name.split()[0] for name in names if stage.is_in(f"{name.split()[0]} field", *box(stage, name))}


TASKS: dict[str, tuple[str, float, Callable[[Stage], bool]]] = {
    "line": ("line_follower", 40, lambda stage: stage.robot.pose.angle > math.tau - 0.5),
    "maze": ("maze", 240, lambda stage: stage.is_in("goal", stage.robot.pose.x, stage.robot.pose.y)),
    "sumo": ("sumo", 30, lambda stage: math.dist(box(stage, "rival"), (1.0, 1.0)) > 0.77),
    "parking": ("parking", 25, lambda stage: stage.robot.body.velocity.length < 1e-3 and stage.is_in(
        "gap", stage.robot.pose.x - 0.08, stage.robot.pose.y - 0.07) and stage.is_in(
        "gap", stage.robot.pose.x + 0.08, stage.robot.pose.y + 0.07)),
    "sorting": ("sorting", 240, lambda stage: sorted_colours(stage) == {"red", "green", "blue"}),
    "warehouse": ("warehouse", 60, lambda stage: stage.robot.held is None and stage.is_in(
        "loading place", *box(stage, "crate"))),
}  # fmt: skip


def test_each_world_has_its_example() -> None:
    assert set(TASKS) == set(shipped_worlds())
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {name for name, _, _ in TASKS.values()}


@pytest.mark.parametrize("world", TASKS)
def test_the_example_does_its_task(world: str, monkeypatch: pytest.MonkeyPatch) -> None:
    name, seconds, is_done = TASKS[world]
    stage = Stage(world, program(monkeypatch, name))
    assert not is_done(stage), "not done from the beginning"
    assert stage.until(lambda: is_done(stage), seconds), stage.robot.pose
