"""Services whose type is in the package that `msbot library ros-package` writes, or in another package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pytest

from msbot import Message, Switch, Text, ros2
from msbot.config import parse_blueprint
from msbot.master.robot_as_part import dds_topic_lookup
from msbot.part.messages.wire_types import AtMost, float32
from msbot.ros2.package_types import package_hash, service_hash
from msbot.ros2.service_forms import service_form
from msbot_agent.space import Topic
from msbot_agent.space.dds.ros_type_hashes import ROS_TYPE_HASHES
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from tests.cli.library.ros_packages import library


class Answer(Message):
    success: bool
    message: str
    metres: float32


class Short(Message):
    success: bool
    message: Annotated[str, AtMost(8)]


WITH_OCTETS = ("GetParameters_Response_", "SetParameters_Request_", "SetParametersAtomically_Request_")
"""A value of a parameter has a `byte[]`, for which our classes have uint8: the octets are the same, the hash is not."""
HALVES = sorted(name for name in ROS_TYPE_HASHES if "::srv::" in name and not name.endswith(WITH_OCTETS))


@pytest.mark.parametrize("name", HALVES)
def test_a_request_and_a_reply_have_the_hashes_that_ros_gives_them(name: str) -> None:
    assert package_hash(getattr(ros2, name.rpartition("::")[2].removesuffix("_"))) == ROS_TYPE_HASHES[name]


def test_there_are_services_to_compare() -> None:
    assert len(HALVES) >= 12


SERVICES = {
    "SetBool": "abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
    "Trigger": "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    "Empty": "5888399dedec5ccc85ea6451949fd2c9f97bfdf963f9a588821639fcd31b5d19",
}
"""As in `share/std_srvs/srv/SetBool.json` of ROS 2 Jazzy."""


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_as_a_whole_has_the_hash_that_ros_gives_it(name: str) -> None:
    assert service_hash(getattr(ros2, f"{name}_Request"), getattr(ros2, f"{name}_Response")) == SERVICES[name]


def test_the_hashes_are_those_of_the_messages_in_their_package() -> None:
    form = service_form(Switch, Text, "msbot_msgs/srv/SwitchToText")
    assert form.request_type == "msbot_msgs::srv::dds_::SwitchToText_Request_"
    assert form.reply_type == "msbot_msgs::srv::dds_::SwitchToText_Response_"
    other = service_form(Switch, Text, "house_msgs/srv/SwitchToText")
    hashes = {one.type_hash for form in (form, other) for one in (form.request, form.reply)}
    assert len(hashes) == 4
    assert {len(one) for one in hashes} == {64}
    known = service_form(Switch, Text)
    assert (known.request.type_hash, known.reply.type_hash) == ("", ""), (
        "those of std_srvs/srv/SetBool are in the table"
    )


def test_our_package_has_a_service_under_one_name() -> None:
    with pytest.raises(ConfigError, match="Switch -> Text is msbot_msgs/srv/SwitchToText there, not msbot_msgs/srv/L"):
        service_form(Switch, Text, "msbot_msgs/srv/Lamp")


def test_octets_are_the_same_and_are_looked_at() -> None:
    form = service_form(Switch, Answer, "house_msgs/srv/Lamp")
    asked, told = Switch(on=True).encode(), Answer(success=True, message="on", metres=1.5).encode()
    assert form.request_inward(asked) == form.request_outward(asked) == asked
    assert form.request_inward(asked + bytes(3)) == asked, "Fast DDS leaves some octets behind a message"
    assert form.reply_inward(told) == form.reply_outward(told) == told
    with pytest.raises(RemoteProtocolError):
        form.reply_inward(told[:3])


def test_a_refusal_is_told_where_a_reply_has_the_fields_for_it() -> None:
    octets = service_form(Switch, Answer, "house_msgs/srv/Lamp").refusal("STOP is in force")
    assert octets is not None
    assert Answer.decode(octets) == Answer(success=False, message="STOP is in force", metres=0.0)
    assert service_form(Switch, Short, "house_msgs/srv/Lamp").refusal("STOP is in force") is None, "8 octets at most"
    assert service_form(Switch, Text, "house_msgs/srv/Lamp").refusal("STOP is in force") is None


ROBOT = """
[robot]
name = "ROVER"
[[slot]]
name = "lamp"
part = "LAMP-1"
[[binding]]
topic = "light"
type = "Switch -> Text"
from = "lamp.light"
to = []
ros = true
ros_type = "msbot_msgs/srv/SwitchToText"
"""


def test_a_robot_tells_the_hashes_of_requests_and_replies(tmp_path: Path) -> None:
    types = library(tmp_path)
    find = dds_topic_lookup(parse_blueprint(ROBOT, types), types, "partition")
    form = service_form(Switch, Text, "msbot_msgs/srv/SwitchToText")
    for name, type_name, theirs in (
        ("rq/ROVER/lightRequest", form.request_type, form.request.type_hash),
        ("rr/ROVER/lightReply", form.reply_type, form.reply.type_hash),
    ):
        (found,) = find(Topic(name, type_name))
        assert (found.name, found.type_name, found.type_hash) == (name, type_name, theirs)
