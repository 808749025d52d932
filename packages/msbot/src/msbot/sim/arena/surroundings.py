"""What is near a robot of a world, for people who do not see the picture."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

from msbot.sim.arena.arena import Arena
from msbot.sim.arena.robot import ArenaRobot
from msbot_xrce.common.lazy_dataclass import dataclass

REACH_M: Final = 0.5
"""What is farther away is not near."""


class Side(Enum):
    """Where something is, as the robot sees it."""

    AHEAD = "ahead"
    LEFT = "left"
    BEHIND = "behind"
    RIGHT = "right"


class Sort(Enum):
    """What it is."""

    WALL = "wall"
    BOX = "box"
    ROBOT = "robot"


@dataclass(frozen=True, slots=True)
class Nearby:
    """One thing near a robot."""

    sort: Sort
    name: str
    """As the world file calls it; empty for a wall."""
    distance_m: float
    """From the middle of the robot to the nearest point of the thing."""
    side: Side


def surroundings(arena: Arena, robot: ArenaRobot) -> list[Nearby]:
    """Boxes and robots near a robot, and on each side the nearest wall; the nearest thing first."""
    pose = robot.pose
    boxes = {thing.shape: thing.plan.name for thing in arena.boxes if thing.body is not robot.held}
    robots = {other.shape: other.plan.name for other in arena.robots.values()}
    found: dict[tuple[Sort, str], Nearby] = {}
    for info in arena.space.point_query((pose.x, pose.y), REACH_M, robot.filter):
        if info.shape is None or (robot.held is not None and info.shape.body is robot.held):
            continue
        angle = math.degrees(math.atan2(info.point.y - pose.y, info.point.x - pose.x) - pose.angle) % 360.0
        side = (Side.AHEAD, Side.LEFT, Side.BEHIND, Side.RIGHT)[round(angle / 90.0) % 4]
        if info.shape in boxes:
            sort, name = Sort.BOX, boxes[info.shape]
        elif info.shape in robots:
            sort, name = Sort.ROBOT, robots[info.shape]
        else:
            sort, name = Sort.WALL, ""
        one = Nearby(sort, name, max(0.0, float(info.distance)), side)
        key = (sort, name or side.value)
        if key not in found or one.distance_m < found[key].distance_m:
            found[key] = one
    return sorted(found.values(), key=lambda one: (one.distance_m, one.sort.value, one.name))
