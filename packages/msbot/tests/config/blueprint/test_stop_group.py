"""A robot's STOP group: written in its blueprint, kept in its database, changed at once, and no matter of a class."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from msbot.config import SAMPLE_ROBOT_TOML, blueprint_mark, load_library, parse_blueprint
from msbot.config.blueprint.blueprint_file_writer import blueprint_toml
from msbot.config.blueprint.differences import differences
from msbot.registry import open_registry
from msbot_xrce.errors import ConfigError

LIBRARY = load_library()
PLAIN = parse_blueprint(SAMPLE_ROBOT_TOML, LIBRARY)
GROUPED_TOML = SAMPLE_ROBOT_TOML.replace("manufacturer =", 'stop_group = "bench-1"\nmanufacturer =', 1)
GROUPED = parse_blueprint(GROUPED_TOML, LIBRARY)


def test_it_is_read_written_and_kept(tmp_path: Path) -> None:
    assert (PLAIN.robot.stop_group, GROUPED.robot.stop_group) == ("", "bench-1")
    assert "stop_group" not in blueprint_toml(PLAIN)
    assert parse_blueprint(blueprint_toml(GROUPED), LIBRARY).robot == GROUPED.robot
    with open_registry(tmp_path / "robot.db") as registry:
        for blueprint in (GROUPED, PLAIN, GROUPED):
            record = registry.robots.apply_blueprint(blueprint, LIBRARY)
            assert registry.robots.blueprint(record).robot.stop_group == blueprint.robot.stop_group


def test_it_holds_at_once_and_is_no_difference_between_robots_of_a_class() -> None:
    (one,) = differences(PLAIN, GROUPED)
    assert "bench-1" in str(one)
    assert one.consequence == ""
    assert blueprint_mark(PLAIN) == blueprint_mark(GROUPED)
    (name,) = differences(PLAIN, replace(PLAIN, robot=replace(PLAIN.robot, version="other")))
    assert name.consequence != ""


@pytest.mark.parametrize("group", ["bench 1", "a" * 25, "bänk", "a/b", "a.b"])
def test_what_is_no_name_for_one_is_said_with_its_line(group: str) -> None:
    with pytest.raises(
        ConfigError, match=r"robot.stop_group: .* is no name for a STOP group: it has at most 24 letters"
    ):
        parse_blueprint(GROUPED_TOML.replace("bench-1", group), LIBRARY)
