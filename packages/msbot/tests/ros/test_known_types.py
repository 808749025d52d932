"""A typo in the name of a ROS 2 type is found where the names are known; else it is said what cannot be known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot import Switch, Text
from msbot.cli.blueprint.files import check_command
from msbot.part.messages.standard import Distance
from msbot.ros2 import known_types
from msbot.ros2.forms import form_of
from msbot.ros2.service_forms import service_form
from msbot_xrce.errors import ConfigError

HERE = {"house_msgs": frozenset({"msg/Door", "srv/Open"}), "sensor_msgs": frozenset({"msg/Range", "srv/SetCameraInfo"})}


@pytest.fixture
def _house(monkeypatch: pytest.MonkeyPatch) -> None:
    """ROS 2 is on this computer, with a package of the user's own."""
    monkeypatch.setattr(known_types, "here", lambda: HERE)


@pytest.fixture
def _no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(known_types, "here", dict)


@pytest.mark.usefixtures("_no_ros")
@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("sensor_msgs/msg/Rnge", "did you mean sensor_msgs/msg/Range?"),
        ("sensor_msg/msg/Range", "did you mean sensor_msgs/msg/Range?"),
        ("snesor_msgs/Range", "did you mean sensor_msgs/msg/Range?"),
        ("nav_msgs/msg/Range", "did you mean sensor_msgs/msg/Range?"),
        ("msbot_msg/msg/Distance", "did you mean msbot_msgs/msg/Distance?"),
    ],
)
@pytest.mark.parametrize("fields", [None, {"metres": "range"}])
def test_a_typo_in_a_message_type(name: str, meant: str, fields: dict[str, str] | None) -> None:
    with pytest.raises(ConfigError) as caught:
        form_of(Distance, name, fields)
    assert meant in str(caught.value)


@pytest.mark.usefixtures("_no_ros")
def test_names_that_may_be_right_are_taken() -> None:
    """`nav2_msgs` is a package of others, and MsBOT knows `nav_msgs`."""
    for name in ("nav2_msgs/msg/Costmap", "my_sensor_msgs/msg/Range", "house_msgs/msg/Door"):
        assert form_of(Distance, name).theirs.type_name == f"{name.replace('/', '::').replace('msg::', 'msg::dds_::')}_"


@pytest.mark.usefixtures("_no_ros")
@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("std_srv/srv/SetBool", "did you mean std_srvs/srv/SetBool?"),
        ("rcl_interfaces/srv/SetParametres", "did you mean rcl_interfaces/srv/SetParameters?"),
        ("msbot_msg/srv/SwitchToText", "did you mean msbot_msgs/srv/SwitchToText?"),
    ],
)
def test_a_typo_in_a_service_type(name: str, meant: str) -> None:
    with pytest.raises(ConfigError) as caught:
        service_form(Switch, Text, name)
    assert meant in str(caught.value)


@pytest.mark.usefixtures("_house")
def test_a_package_on_this_computer_is_known() -> None:
    assert form_of(Distance, "house_msgs/msg/Door").type_hash
    assert service_form(Switch, Text, "house_msgs/srv/Open").reply.type_hash
    with pytest.raises(ConfigError, match=r"no msg/Dor in it; did you mean house_msgs/msg/Door\?"):
        form_of(Distance, "house_msgs/msg/Dor")
    with pytest.raises(ConfigError, match=r"no srv/Opn in it; did you mean house_msgs/srv/Open\?"):
        service_form(Switch, Text, "house_msgs/srv/Opn")
    with pytest.raises(ConfigError, match=r"knows a package hose_msgs; did you mean house_msgs/msg/Door\?"):
        form_of(Distance, "hose_msgs/msg/Door")
    with pytest.raises(ConfigError, match="no msg/Table in it; `ros2 interface package house_msgs` lists"):
        form_of(Distance, "house_msgs/msg/Table")


ROBOT = """
[robot]
name = "ROVER"
[[slot]]
name = "eye"
part = "HC-SR04"
[[binding]]
topic = "near"
type = "Distance"
from = "eye.distance"
to = []
ros = true
ros_type = "{type}"
"""


def check(folder: Path, type_name: str) -> dict[str, list[str]]:
    (folder / "robot.toml").write_text(ROBOT.format(type=type_name))
    done = CliRunner().invoke(check_command, [str(folder / "robot.toml"), "--json"])
    told: dict[str, list[str]] = json.loads(done.output)
    return told


@pytest.mark.usefixtures("_no_ros")
def test_check_finds_the_typo_or_says_what_cannot_be_known(tmp_path: Path) -> None:
    (problem,) = check(tmp_path, "sensor_msg/msg/Range")["problems"]
    assert "robot.toml" in str(problem)
    assert "did you mean sensor_msgs/msg/Range?" in str(problem)
    (hint,) = check(tmp_path, "house_msgs/msg/Door")["hints"]
    assert hint.startswith("house_msgs/msg/Door: neither MsBOT nor this computer has the package house_msgs, so")
    for known in ("sensor_msgs/msg/Range", "msbot_msgs/msg/Distance"):
        assert check(tmp_path, known) == {"problems": [], "hints": []}
