"""What sensors see, by their place on the chassis. The robot stands at [1, 1] and looks east."""

from __future__ import annotations

import math

import pytest

from tests.sim.arena.worlds import arena, driving, sensed

WALL = "[[wall]]\npoints = [[1.6, 0.0], [1.6, 2.0]]\nthickness_m = 0.02\n"


def part(slot: str, words: str) -> str:
    return f'[[robot.part]]\nslot = "{slot}"\n{words}\n'


def test_distance_is_measured_from_where_the_sensor_sits_to_where_it_faces() -> None:
    robot = part("left eye", "at = [0.0, 0.08]\nturn_deg = 90\ncone_deg = 0") + part("far", "at = [0.1, 0]\ncone_deg=0")
    world = arena(WALL, robot=robot)
    assert sensed(world, "far", "distance")["distance"] == pytest.approx(1.59 - 1.1, abs=1e-3)
    assert sensed(world, "left eye", "distance")["distance"] == pytest.approx(0.92, abs=1e-3)
    assert sensed(world, "front eye", "distance")["distance"] == pytest.approx(0.49, abs=1e-3)  # where it fits


def test_a_cone_sees_what_a_ray_does_not() -> None:
    post = "[[post]]\nat = [1.5, 1.06]\nradius_m = 0.02\n"
    narrow = arena(post, robot=part("eye", "cone_deg = 0"))
    wide = arena(post, robot=part("eye", "cone_deg = 30"))
    assert sensed(narrow, "eye", "distance")["distance"] > 1
    assert sensed(wide, "eye", "distance")["distance"] < 0.45


def test_a_sensor_on_a_servo_turns_with_it() -> None:
    world = arena(WALL, robot=part("neck", "at = [0.0, 0.0]") + part("eye", 'on = "neck"\ncone_deg = 0'))
    world.mount("robot", "neck", ["servo"])
    assert sensed(world, "eye", "distance")["distance"] == pytest.approx(0.59, abs=1e-3)
    world.drive("robot", "neck", {"servo": 180.0})
    assert sensed(world, "eye", "distance")["distance"] == pytest.approx(1.0, abs=1e-3)


def test_near_and_touch() -> None:
    world = arena(WALL, at="[1.40, 1.0]", robot=part("bumper", ""))
    assert sensed(world, "front", "near") == {"near": True}
    assert sensed(world, "bumper", "touch") == {"touch": False}
    driving(world, 50, 50, 1)
    assert sensed(world, "bumper", "touch") == {"touch": True}
    driving(world, -50, -50, 1)
    assert (sensed(world, "bumper", "touch"), sensed(world, "front", "near")) == ({"touch": False}, {"near": False})


@pytest.mark.parametrize(("y", "seen"), [(1.0, 0.0), (1.02, -0.57), (0.98, 0.57), (1.06, None)])
def test_a_line_follower_says_on_which_side_the_line_is(y: float, seen: float | None) -> None:
    world = arena(f"[[line]]\npoints = [[0.2, {y}], [2.8, {y}]]\n")
    found = sensed(world, "line", "line.place", "line.seen")
    assert found == (
        {"line.seen": False} if seen is None else {"line.seen": True, "line.place": pytest.approx(seen, abs=0.15)}
    )


def test_light_paint_is_no_line_and_what_lies_on_top_counts() -> None:
    pale = '[[line]]\npoints = [[0.2, 1.0], [2.8, 1.0]]\ncolour = "yellow"\n'
    assert sensed(arena(pale), "line", "line.seen") == {"line.seen": False}
    over = (
        '[[area]]\nrectangle = [0.5, 0.5, 1.0, 1.0]\ncolour = "black"\n'
        '[[area]]\nrectangle = [1.0, 0.9, 0.2, 0.2]\ncolour = "red"\n'
    )
    red = sensed(arena(over), "floor", "colour.red", "colour.green", "colour.blue")
    assert red == {"colour.red": 204.0, "colour.green": 44.0, "colour.blue": 36.0}


def test_a_colour_sensor_that_looks_ahead_sees_the_box_in_front_of_it() -> None:
    robot = part("eye", 'looks = "ahead"\nat = [0.1, 0.0]')
    box = '[[box]]\nat = [1.15, 1.0]\ncolour = "blue"\n'
    blue = sensed(arena(box, robot=robot), "eye", "colour.red", "colour.blue")
    assert blue == {"colour.red": 30.0, "colour.blue": 190.0}
    assert sensed(arena(robot=robot), "eye", "colour.red") == {"colour.red": 12.0}


def test_light_falls_with_the_square_of_the_distance_and_walls_cast_shadows() -> None:
    lamp = "[[lamp]]\nat = [2.0, 1.0]\nlux = 400\n"
    assert sensed(arena(lamp), "light", "light")["light"] == pytest.approx(300 + 400)
    assert sensed(arena(lamp + WALL), "light", "light")["light"] == pytest.approx(300)
    away = arena(lamp, robot=part("light", 'looks = "ahead"\nturn_deg = 180'))
    assert sensed(away, "light", "light")["light"] == pytest.approx(300)


def test_robots_light_and_sound_reach_each_other() -> None:
    world = arena(robot='[[robot]]\nname = "other"\nstart = [1.5, 1.0]\n')
    assert sensed(world, "light", "light")["light"] == 300
    assert sensed(world, "ear", "sound") == {"sound": 8.0}
    world.mount("other", "lamp", ["lamp"])
    world.drive("other", "lamp", {"lamp": 100.0})
    world.mount("other", "horn", ["loudness", "tone"])
    world.drive("other", "horn", {"loudness": 100.0, "tone": 440.0})
    assert sensed(world, "light", "light")["light"] == pytest.approx(300 + 25 / 0.25)
    assert sensed(world, "ear", "sound")["sound"] == pytest.approx(8 + 100 * 0.15 / 0.65)


def test_a_door_contact_feels_the_magnet_below_it() -> None:
    world = arena("[[magnet]]\nat = [1.3, 1.0]\n")
    assert sensed(world, "reed", "magnet") == {"magnet": False}
    world.put("robot", (1.29, 1.01))
    assert sensed(world, "reed", "magnet") == {"magnet": True}


@pytest.mark.parametrize(("turned", "heading"), [(0, 90), (90, 0), (180, 270), (-90, 180)])
def test_a_compass_counts_clockwise_from_north(turned: float, heading: float) -> None:
    world = arena()
    world.put("robot", (1, 1), turned)
    found = float(sensed(world, "compass", "heading")["heading"])
    assert math.cos(math.radians(found - heading)) == pytest.approx(1)


def test_an_imu_feels_turning_and_pushing() -> None:
    world = arena()
    sensed(world, "imu", "push.ahead", "push.left", "spin")
    driving(world, 100, 100, 0.1)
    assert sensed(world, "imu", "push.ahead")["push.ahead"] > 0.5
    driving(world, -50, 50, 1)
    assert sensed(world, "imu", "spin")["spin"] > 90


def test_encoders_count_their_own_wheel() -> None:
    world = arena()
    driving(world, 60, 30, 1)
    left, right = (float(sensed(world, slot, "wheel")["wheel"]) for slot in ("left encoder", "right_encoder"))
    assert left > 1.5 * right > 0
    assert left == pytest.approx(60 * world.robot("robot").wheels[0].speed / (math.pi * 0.065))
