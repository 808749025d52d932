"""The world that a robot's simulated parts drive in, as people stop it, begin it anew and put robots elsewhere."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Protocol

from msbot.operations.outcome import Outcome
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

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

    def use(self, world: WorldControl) -> None:
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
