"""The world of a robot as the page shows it, in numbers and in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from msbot_agent.text.sentence import joined, said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.sim.arena.arena import Nearby
    from msbot.sim.arena.arena_robot import ArenaRobot
    from msbot.sim.arena.running_arena import RunningArena


MARKS = ("distance", "near", "line", "colour", "touch", "light", "sound", "magnet", "heading", "grip", "lamp", "tone")
"""Kinds of parts that are drawn on a robot, by the first word of what they sense or do."""


UNITS = {"distance": "m", "heading": "°", "pitch": "°", "roll": "°", "spin": "°/s", "light": "lx", "grip": "mm"}
"""Of what parts sense, by the first word of it."""
STANDS_M_PER_S = 0.005
MOST_NEARBY = 3
"""Things near a robot that are told of."""
_COMPASS = (
    said("east"), said("north-east"), said("north"), said("north-west"), said("west"), said("south-west"),
    said("south"), said("south-east"),
)  # fmt: skip
"""Up in the picture is north."""


@dataclass(frozen=True, slots=True)
class PartReadings:
    """What one part senses now, by the words of `SENSES`."""

    robot: str
    slot: str
    values: Mapping[str, float | bool]


class ArenaView:
    """See the module's docstring.

    Args:
        living: the world; None: the robot is in none that this program has.
    """

    def __init__(self, living: RunningArena | None) -> None:
        self._living = living
        self.drivers: set[object] = set()
        """The pages that have plugged the pilot in, or drive it since: it goes with the last of them."""

    @property
    def is_there(self) -> bool:
        """Whether this program has a world."""
        return self._living is not None

    @property
    def name(self) -> str:
        """What people call the world."""
        return self._world.arena.plan.name

    @property
    def speed(self) -> float:
        """Seconds that pass in the world in one second."""
        return self._world.speed

    @property
    def paused(self) -> bool:
        """Whether the world stands still."""
        return self._world.paused

    @property
    def can_slide(self) -> bool:
        """Whether a robot of the world can drive sideways."""
        return any(robot.chassis.kind.value == "omni" for robot in self._world.arena.plan.robots)

    def picture(self) -> str:
        """The world as it began, as SVG."""
        from msbot.sim.arena.world_drawing import world_svg

        return world_svg(self._world.arena.plan)

    def state(self) -> dict[str, object]:
        """What moves, in mm and degrees, as short as it can be said ten times a second."""
        living = self._world
        poses = living.arena.poses()
        boxes = {name: pose for name, pose in poses.items() if name not in living.arena.robots}
        return {
            "t": round(living.arena.now, 2),
            "still": living.paused,
            "robots": {name: self._robot(robot) for name, robot in living.arena.robots.items()},
            "boxes": {name: [*_at(pose.x, pose.y), _degrees(pose.angle)] for name, pose in boxes.items()},
        }

    def sensed(self) -> list[PartReadings]:
        """What each part senses, for a table."""
        living, found = self._world, []
        for name in living.arena.robots:
            for slot in living.slots(name):
                seat = living.arena.robot(name).seats[slot]
                values = living.arena.sense(name, slot, seat.quantities)
                if values:
                    found.append(PartReadings(name, slot, values))
        return found

    def describe(self) -> list[str]:
        """Where the robots are and what is near them, in words, for those who do not see the picture."""
        return [self._described(name, robot, roughly=False) for name, robot in self._world.arena.robots.items()]

    def spoken_summary(self) -> list[str]:
        """The same so roughly that it stays the same for a while: to be read out."""
        return [self._described(name, robot, roughly=True) for name, robot in self._world.arena.robots.items()]

    def _described(self, name: str, robot: ArenaRobot, *, roughly: bool) -> str:
        from msbot.sim.arena.arena import surroundings

        pose, speed = robot.pose, robot.body.velocity.length
        areas = reversed(self._world.arena.plan.areas)  # the last one lies on top
        place = next((area.name for area in areas if area.name and _is_in((pose.x, pose.y), area.corners)), "")
        x, y = (round(one, 1 if roughly else 2) for one in (pose.x, pose.y))
        turned = math.degrees(pose.angle) % 360
        found: list[str] = [
            said("{name} is at {x:g}, {y:g} m", name=name, x=x, y=y),
            said("looks {where}", where=_COMPASS[round(turned / 45) % 8])
            if roughly
            else said("looks {degrees:.0f}° from east", degrees=round(turned) % 360),
        ]
        if speed <= STANDS_M_PER_S:
            found.append(said("stands"))
        else:
            found.append(said("drives") if roughly else said("drives {speed:.2f} m/s", speed=speed))
        if place:
            found.append(place)
        if robot.held is not None:
            found.append(said("holds a box"))
        found += [_nearby(one, roughly=roughly) for one in surroundings(self._world.arena, robot)[:MOST_NEARBY]]
        return joined(", ", found)

    @property
    def _world(self) -> RunningArena:
        if self._living is None:
            raise ConfigError(said("this robot is in no world: start it with msbot demo --world line"))
        return self._living

    def _robot(self, robot: ArenaRobot) -> dict[str, object]:
        pose, senses = robot.pose, self._world.arena.senses
        rays = []
        for seat in robot.seats.values():
            if "distance" in seat.quantities:
                looking, reach = robot.looking(seat), min(4.0, senses.distance(robot, seat))
                at = _at(looking.x, looking.y)
                rays.append([*at, _degrees(looking.angle), round(1000 * reach), seat.place.cone_deg])
        lamp = [round(min(255.0, max(0.0, robot.does(f"lamp.{part}")))) for part in ("red", "green", "blue")]
        white = robot.does("lamp")
        return {
            "p": [*_at(pose.x, pose.y), _degrees(pose.angle)],
            "lamp": lamp if any(lamp) else [round(2.55 * white)] * 3 if white > 0 else None,
            "loud": round(robot.does("loudness")),
            "grip": round(robot.does("grip.opening", -1.0)),
            "rays": rays,
            "parts": [
                [seat.slot, kind, *_at(*seat.place.at)]
                for seat in robot.seats.values()
                if (kind := seat.quantities[0].partition(".")[0]) in MARKS
            ],
        }


def _nearby(one: Nearby, *, roughly: bool) -> str:
    match one.sort.value:
        case "wall":
            what = said("a wall")
        case "box":
            what = said("the box {name}", name=one.name) if one.name else said("a box")
        case _:
            what = said("the robot {name}", name=one.name)
    where = {
        "ahead": said("ahead"),
        "left": said("on the left"),
        "behind": said("behind it"),
        "right": said("on the right"),
    }[one.side.value]
    return said(
        "{what} {metres:g} m {where}", what=what, metres=round(one.distance_m, 1 if roughly else 2), where=where
    )


def _at(x: float, y: float) -> tuple[float, float]:
    return round(1000 * x, 1), round(1000 * y, 1)


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 2)


def _is_in(at: tuple[float, float], corners: tuple[tuple[float, float], ...]) -> bool:
    """Whether a place is in a convex area."""
    x, y = at
    sides = [
        (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        for (ax, ay), (bx, by) in zip(corners, (*corners[1:], corners[0]), strict=True)
    ]
    return all(side >= 0 for side in sides) or all(side <= 0 for side in sides)
