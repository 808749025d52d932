"""What is near a robot is told as it is: which thing, how far, and on which side of the robot."""

from __future__ import annotations

from msbot.sim.arena.arena import Arena, Nearby, RelativeSide, ThingKind, surroundings
from msbot.sim.arena.world_reader import parse_world

WORLD = """
[world]
name = "W"
width_m = 4.0
height_m = 4.0

[[wall]]
points = [[1.0, 2.3], [3.0, 2.3]]

[[box]]
name = "red"
at = [2.3, 2.0]
size = [0.1, 0.1]

[[robot]]
name = "robot"
start = [2.0, 2.0]
heading_deg = 0

[[robot]]
name = "other"
start = [2.0, 1.6]
heading_deg = 0
"""


def told(heading_deg: float) -> dict[tuple[ThingKind, str], Nearby]:
    arena = Arena(parse_world(WORLD, "w.toml"))
    arena.put("robot", (2.0, 2.0), heading_deg)
    found = surroundings(arena, arena.robot("robot"))
    assert [one.distance_m for one in found] == sorted(one.distance_m for one in found)
    return {(one.sort, one.name): one for one in found}


def test_sides_are_those_of_the_robot_and_what_is_far_is_left_out() -> None:
    found = told(0.0)
    assert {key: one.side for key, one in found.items()} == {
        (ThingKind.BOX, "red"): RelativeSide.AHEAD,
        (ThingKind.WALL, ""): RelativeSide.LEFT,
        (ThingKind.ROBOT, "other"): RelativeSide.RIGHT,
    }
    assert abs(found[ThingKind.BOX, "red"].distance_m - 0.25) < 1e-6, "to the side of the box, not to its middle"
    assert 0.28 < found[ThingKind.WALL, ""].distance_m < 0.3
    assert told(90.0)[ThingKind.BOX, "red"].side is RelativeSide.RIGHT
    assert told(180.0)[ThingKind.BOX, "red"].side is RelativeSide.BEHIND
    assert told(-90.0)[ThingKind.BOX, "red"].side is RelativeSide.LEFT


def test_nothing_near_is_nothing() -> None:
    arena = Arena(parse_world(WORLD, "w.toml"))
    arena.put("robot", (0.9, 0.9), 0.0)
    assert surroundings(arena, arena.robot("robot")) == []
