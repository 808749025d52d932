"""An arena that lives in the robot's own time: 50 times a second its parts act, time passes, and its parts see.

Time is that of the event loop, so a test runs it in virtual time. Where the computer is too slow, world time is lost
and counted; nothing is caught up in a jump.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Protocol

from msbot.config import DRIVES, SENSES, Control, PartType
from msbot.sim.arena.wheels import SENSE_STEPS, STEP_S
from msbot.sim.arena.world_plan import Point
from msbot.sim.simulated_reading import as_number
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.sim.arena.arena import Arena


# What an arena and a simulated part have to do with each other: what the part does, and what it is shown.


Sensed = float | bool


class WorldPart(Protocol):
    """A part in a world: in this process, or in another one."""

    def drive_values(self) -> Mapping[str, float]:
        """What it does now, by the words of `DRIVES`."""

    def sense(self, values: Mapping[str, Sensed]) -> None:
        """Show it what it senses now, by the words of `SENSES`."""


class PartSimulation(Protocol):
    """The face of a `SimulatedPart` that is needed here."""

    @property
    def part_type(self) -> PartType:
        """Its type."""

    def source(self, name: str) -> object:
        """The value of one of its readings now."""

    def set_all(self, values: Mapping[str, bool | int | float | str]) -> None:
        """Set several controls at once."""


def quantities_of(part_type: PartType) -> tuple[str, ...]:
    """What parts of that type sense and do in a world; nothing: they have no place in one."""
    simulator = part_type.simulator
    if simulator is None:
        return ()
    senses = [control.senses for control in simulator.controls if control.senses]
    return (*senses, *(reading.drives for reading in simulator.readings if reading.drives))


class SimulatedWorldPart:
    """A simulated part of this process in a world.

    What the world shows it sets its controls, within their limits; what its readings say is what it does.
    """

    def __init__(self, simulated: PartSimulation) -> None:
        simulator = simulated.part_type.simulator
        self._simulated = simulated
        controls = () if simulator is None else simulator.controls
        readings = () if simulator is None else simulator.readings
        self._controls = {control.senses: control for control in controls if control.senses}
        self._drives = {reading.drives: reading.name for reading in readings if reading.drives}

    def drive_values(self) -> Mapping[str, float]:
        """See `WorldPart.drive_values`."""
        found = {}
        for quantity, reading in self._drives.items():
            value = self._simulated.source(reading)
            found[quantity] = as_number(value) if isinstance(value, bool | int | float | str) else 0.0
        return found

    def sense(self, values: Mapping[str, Sensed]) -> None:
        """See `WorldPart.sense`."""
        wanted: dict[str, bool | int | float | str] = {}
        for quantity, value in values.items():
            control = self._controls.get(quantity)
            if control is None:
                continue
            wanted[control.name] = value if isinstance(value, bool) else _within(control, value)
        self._simulated.set_all(wanted)


def _within(control: Control, value: float) -> float:
    """The nearest value that a control can have."""
    least = -math.inf if control.least is None else control.least
    most = math.inf if control.most is None else control.most
    return min(most, max(least, value))


TICK_S = STEP_S * SENSE_STEPS
MOST_BEHIND_S = 0.2
"""A world that is later than this loses the time in between."""
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class ArenaPart:
    """A part in the world."""

    inhabitant: WorldPart
    senses: tuple[str, ...]
    """What it is shown."""
    acts: bool
    """It does something, too."""


class RunningArena:
    """See the module's docstring.

    Args:
        arena: the world.
    """

    def __init__(self, arena: Arena) -> None:
        self.arena = arena
        self.paused = False
        self.lost_s = 0.0
        """World time that was lost because the computer was too slow."""
        self._speed = 1.0
        self._owed = 0.0
        self._lodgers: dict[tuple[str, str], ArenaPart] = {}
        self._listeners: list[Callable[[], None]] = []

    @property
    def speed(self) -> float:
        """How many seconds pass in the world in one second."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        if speed not in SPEEDS:
            raise ConfigError(f"the world's speed is one of {', '.join(f'{one:g}' for one in SPEEDS)}; it is {speed:g}")
        self._speed = speed

    def on_tick(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call the listener after each tick; what is returned ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def seat(self, robot: str, slot: str, quantities: Iterable[str], inhabitant: WorldPart) -> None:
        """Put a part into the world.

        Raises:
            ConfigError: the world has no such robot, or another part sits there.
        """
        if (robot, slot) in self._lodgers:
            raise ConfigError(f'another part sits at slot "{slot}" of robot "{robot}" in the world')
        names = tuple(quantities)
        self.arena.mount(robot, slot, names)
        senses = tuple(name for name in names if name in SENSES)
        self._lodgers[robot, slot] = ArenaPart(inhabitant, senses, acts=not set(names).isdisjoint(DRIVES))

    def unseat(self, robot: str, slot: str) -> None:
        """Take a part out: it does nothing any more."""
        if self._lodgers.pop((robot, slot), None) is not None:
            self.arena.robot(robot).unmount(slot)

    def slots(self, robot: str) -> tuple[str, ...]:
        """The slots of a robot whose parts are in the world."""
        return tuple(slot for name, slot in self._lodgers if name == robot)

    def free_robot(self) -> str:
        """The first robot that nobody has a part on.

        Raises:
            ConfigError: each has.
        """
        for name in self.arena.robots:
            if not self.slots(name):
                return name
        raise ConfigError(f"each robot of the world is somebody's already: {', '.join(self.arena.robots)}")

    def put(self, robot: str, at: Point, heading_deg: float | None = None) -> None:
        """Take a robot by hand and put it elsewhere."""
        self.arena.put(robot, at, heading_deg)

    def reset(self) -> None:
        """Begin anew."""
        self.arena.reset()

    def as_json(self) -> dict[str, object]:
        """Its time in seconds, and where everything is in metres and degrees, for programs."""
        robots = self.arena.robots
        places = {
            name: {"x": round(pose.x, 4), "y": round(pose.y, 4), "heading": round(math.degrees(pose.angle) % 360, 2)}
            for name, pose in self.arena.poses().items()
        }
        return {
            "world": self.arena.plan.name,
            "seconds": round(self.arena.now, 2),
            "paused": self.paused,
            "speed": self.speed,
            "lost_s": round(self.lost_s, 2),
            "robots": {name: {**places[name], "parts": list(self.slots(name))} for name in robots},
            "boxes": {name: place for name, place in places.items() if name not in robots},
        }

    def step(self) -> None:
        """Let one tick pass in a world that is paused."""
        self._act()
        self.arena.step(SENSE_STEPS)
        self._see()

    def tick(self) -> None:
        """One tick of `TICK_S`: parts act, the world goes on unless it is paused, parts see."""
        self._act()
        if not self.paused:
            self._owed += SENSE_STEPS * self._speed
            steps = int(self._owed)
            self._owed -= steps
            self.arena.step(steps)
        self._see()

    async def run(self) -> None:
        """Live until cancelled."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due += TICK_S
            behind = loop.time() - due
            if behind > MOST_BEHIND_S:
                self.lost_s += behind
                due = loop.time()
            await asyncio.sleep(max(0.0, due - loop.time()))
            self.tick()

    def _act(self) -> None:
        for (robot, slot), lodger in self._lodgers.items():
            if lodger.acts:
                self.arena.drive(robot, slot, lodger.inhabitant.drive_values())

    def _see(self) -> None:
        for (robot, slot), lodger in self._lodgers.items():
            if lodger.senses:
                lodger.inhabitant.sense(self.arena.sense(robot, slot, lodger.senses))
        for listener in tuple(self._listeners):
            listener()
