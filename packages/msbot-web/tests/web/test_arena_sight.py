"""A world in words, for who does not see its picture."""

from __future__ import annotations

from msbot.sim.arena.arena import Arena
from msbot.sim.arena.running_arena import RunningArena
from msbot.sim.arena.world_reader import open_world
from msbot_web.arena_view import ArenaView


def seen(world: str) -> tuple[ArenaView, Arena]:
    arena = Arena(open_world(world))
    return ArenaView(RunningArena(arena)), arena


def test_robots_are_told_with_the_place_on_top_and_what_is_near() -> None:
    sight, arena = seen("sumo")
    assert sight.describe() == [
        "robot is at 0.7, 1 m, looks 0° from east, stands, ring",
        "rival is at 1.3, 1 m, looks 180° from east, stands, ring",
    ]
    arena.put("robot", (1.3, 0.72), 90.0)
    assert sight.describe()[0].endswith(", ring, the robot rival 0.2 m ahead")
    arena.put("robot", (0.1, 1.0), 180.0)
    assert sight.describe()[0] == "robot is at 0.1, 1 m, looks 180° from east, stands, a wall 0.1 m ahead"


def test_what_is_read_out_stays_the_same_while_little_changes() -> None:
    sight, arena = seen("sorting")
    before = sight.spoken_summary()
    assert before[0].startswith("robot is at 1, 0.2 m, looks north, stands, a wall 0.2 m behind it, the box green 2 0.")
    arena.put("robot", (1.002, 0.249), 94.0)
    assert sight.spoken_summary() == before
    arena.put("robot", (1.01, 0.249), 140.0)
    assert "looks north-west" in sight.spoken_summary()[0]


def test_a_heading_is_0_to_359() -> None:
    sight, arena = seen("sumo")
    for degrees, words in ((359.7, "looks 0° from east"), (-90.0, "looks 270° from east"), (359.4, "looks 359°")):
        arena.put("robot", (0.7, 1.0), degrees)
        assert words in sight.describe()[0]
