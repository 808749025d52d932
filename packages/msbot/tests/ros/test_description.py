"""The URDF file that a blueprint names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from msbot.config import Blueprint, RosOptions, blueprint_toml, differences, load_library, parse_blueprint
from msbot.ros.robot_in_ros import LARGEST, read_description
from msbot_xrce.errors import ConfigError

TEXT = """
[robot]
name = "ROVER"
[ros]
urdf = "rover.urdf"
clock = true
parameters = "read"
[[slot]]
name = "knob"
part = "POT-10K"
"""
LIBRARY = load_library()


def rover(folder: Path, text: str = TEXT) -> Blueprint:
    return replace(parse_blueprint(text, LIBRARY), source=folder / "robot.toml")


def test_the_description_is_the_file_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "rover.urdf").write_text('<?xml version="1.0"?>\n<robot name="rover"/>\n')
    assert read_description(rover(tmp_path)) == '<?xml version="1.0"?>\n<robot name="rover"/>\n'
    assert read_description(replace(rover(tmp_path), ros=RosOptions())) == ""


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        (None, "cannot be read (No such file or directory): name a URDF file beside the blueprint"),
        (b"robot", "is not XML in UTF-8"),
        (b"<robot>\xff</robot>", "is not XML in UTF-8"),
        (b"<sdf/>", "is not URDF: it begins with <sdf>, not with <robot>"),
        (b" " * (LARGEST + 1), f"has more than {LARGEST} bytes"),
    ],
)
def test_a_file_that_is_no_description_is_told_at_the_start(octets: bytes | None, words: str, tmp_path: Path) -> None:
    if octets is not None:
        (tmp_path / "rover.urdf").write_bytes(octets)
    with pytest.raises(ConfigError) as error:
        read_description(rover(tmp_path))
    assert str(error.value).startswith('[ros] urdf = "rover.urdf": ')
    assert words in str(error.value)


def test_the_options_survive_export_and_are_compared() -> None:
    blueprint = parse_blueprint(TEXT, LIBRARY)
    assert blueprint.ros == RosOptions("rover.urdf", clock=True, parameters="read")
    assert parse_blueprint(blueprint_toml(blueprint), LIBRARY).ros == blueprint.ros
    assert "[ros]" not in blueprint_toml(replace(blueprint, ros=RosOptions()))
    (change,) = differences(blueprint, replace(blueprint, ros=replace(blueprint.ros, parameters="set")))
    assert change.where == "ros, parameters"


def test_a_word_that_is_not_known_is_told() -> None:
    with pytest.raises(ConfigError, match="parameters"):
        parse_blueprint(TEXT.replace('"read"', '"write"'), LIBRARY)
