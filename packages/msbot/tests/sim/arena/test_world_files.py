"""World files: each of those that MsBOT brings, and what each mistake gets."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import CliRunner

from msbot.sim.arena.world_drawing import world_svg
from msbot.sim.arena.world_reader import open_world, parse_world, shipped_worlds
from msbot_agent.cli import msbot
from msbot_xrce.errors import ConfigError

HEAD = '[world]\nname = "W"\nwidth_m = 2\nheight_m = 1\n[[robot]]\nname = "robot"\nstart = [1, 0.5]\n'
MISTAKES = [
    ('[world]\nname = "W"\n', 'robot: a world needs a place for a robot; add [[robot]] with name = "robot"'),
    (
        HEAD.replace("[1, 0.5]", "[3, 0.5]"),
        "line 7, robot[0].start: [3, 0.5] is outside the world, which goes from [0, 0] to [2, 1]",
    ),
    (HEAD.replace("start = [1, 0.5]", ""), "robot[0].start: is missing; add a line such as start = [0.5, 0.4]"),
    (HEAD.replace("[1, 0.5]", '"middle"'), 'must be 2 numbers, for example [0.5, 0.4]; it is the text "middle"'),
    (HEAD + '[[wall]]\npoints = [[0, 0]]\n', "line 9, wall[0].points: has 1 point; write 2 to 500 points in metres"),
    (HEAD + '[[wall]]\npoints = [[0, 0], [0, 0]]\n', "is the same point as the one before; remove it"),
    (HEAD + '[[box]]\nat = [1, 0.5]\ncolour = "gren"\n', "line 10, box[0].colour: must be a colour"),
    (HEAD + '[[box]]\nat = [1, 0.5]\ncolour = [1, 2, 300]\n', "red, green and blue are 0 to 255"),
    (HEAD + '[[box]]\nat = [1, 0.5]\nweight = 3\n', "box[0].weight: there is no such key here"),
    (HEAD + '[[area]]\npoints = [[0, 0], [1, 0], [0.1, 0.1], [0, 1]]\n', "the corners must go round without a dent"),
    (HEAD + '[[area]]\nrectangle = [0, 0, -1, 1]\n', "width and height must be more than 0"),
    (HEAD + '[robot.chassis]\ntrack_m = 0.5\n', "is 0.5; the wheels must be on the chassis, at most 0.16 m"),
    (
        HEAD + '[[robot.part]]\nslot = "eye"\non = "nek"\n[[robot.part]]\nslot = "neck"\n',
        '"nek" is no other part of this robot',
    ),
    (HEAD + '[[robot.part]]\nslot = "eye"\n[[robot.part]]\nslot = "eye"\n', 'slot "eye" has a place already'),
    (HEAD + '[[robot.part]]\nslot = "eye"\nlooks = "up there"\n', '"up there" is none of'),
    (HEAD + HEAD.partition("[[robot]]")[1] + '\nname = "robot"\nstart = [1, 0.5]\n', 'another robot "robot" already'),
]  # fmt: skip


@pytest.mark.parametrize(("text", "sentence"), MISTAKES)
def test_a_mistake_is_told_with_its_line_and_what_would_be_right(text: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_world(text)
    assert sentence in str(caught.value)


@pytest.mark.parametrize("name", shipped_worlds())
def test_the_worlds_that_msbot_brings_are_right_and_can_be_drawn(name: str) -> None:
    plan = open_world(name)
    picture = ET.fromstring(world_svg(plan))
    robots = [node for node in picture.iter() if node.get("class") == "arena-robot"]
    assert [node.get("data-name") for node in robots] == [robot.name for robot in plan.robots]
    assert len([node for node in picture.iter() if node.get("class") == "arena-box"]) == len(plan.boxes)


def test_a_smooth_line_goes_through_its_points_and_a_closed_one_ends_where_it_begins() -> None:
    plan = parse_world(HEAD + "[[line]]\nclosed = true\nsmooth = true\npoints = [[0.5, 0.5], [1, 0.2], [1.5, 0.5]]\n")
    assert {(0.5, 0.5), (1.0, 0.2), (1.5, 0.5)} <= set(plan.lines[0].points)
    assert plan.lines[0].points[0] == plan.lines[0].points[-1]


def test_there_are_six_worlds_and_two_robots_in_one_of_them() -> None:
    assert set(shipped_worlds()) == {"line", "maze", "parking", "sorting", "sumo", "warehouse"}
    assert len(open_world("warehouse").robots) == 2


def test_names_in_a_world_cannot_break_its_picture() -> None:
    plan = parse_world(HEAD.replace('"robot"', "'<b a=\"1\">&'"))
    assert "<b" not in world_svg(plan)


def test_the_command_lists_checks_and_shows(tmp_path: Path) -> None:
    run = CliRunner()
    assert run.invoke(msbot, ["arena", "list"]).output.count("\n") == 7  # the titles, and six worlds
    shown = run.invoke(msbot, ["arena", "show", "warehouse", "--svg", str(tmp_path / "w.svg")])
    assert "robot second: differential" in shown.output
    assert (tmp_path / "w.svg").read_text().startswith("<svg")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(HEAD.replace("[1, 0.5]", "[9, 9]"))
    assert '"line": 7' in run.invoke(msbot, ["arena", "check", str(wrong), "--json"]).output
    with pytest.raises(ConfigError, match="line 7, robot"):
        run.invoke(msbot, ["arena", "check", str(wrong)], catch_exceptions=False)
    with pytest.raises(ConfigError, match="or one of line, maze"):
        open_world("nowhere")
