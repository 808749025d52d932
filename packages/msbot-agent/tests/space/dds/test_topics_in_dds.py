"""What a blueprint gives to others: topics in the open partition, and topics as ROS 2 has them."""

from __future__ import annotations

import re
import sys

import pytest

from msbot.config import Blueprint, load_library, parse_blueprint
from msbot.master import robot_space
from msbot.part.messages.standard import Level
from msbot_agent.space import Qos, Topic, parse_space
from msbot_agent.space.dds import DdsSpace
from msbot_xrce.errors import ConfigError
from tests.space.dds.foreign_programs import SOURCES
from tests.space.dds.peers import Inbox, program, until

LIBRARY = load_library()
NODE = (sys.executable, str(SOURCES / "ros_topic.py"))
RELIABLE = Qos(depth=64)


def rover(wishes: str) -> Blueprint:
    """A robot with a knob whose level is on the topic `power`."""
    return parse_blueprint(
        f"""
        [robot]
        name = "ROVER"
        [[slot]]
        name = "knob"
        part = "POT-10K"
        [[binding]]
        topic = "power"
        type = "Level"
        from = "knob.level"
        to = []
        {wishes}
        """,
        LIBRARY,
    )


async def test_an_exported_topic_is_in_the_robots_partition_and_in_the_open_one() -> None:
    inside, outside, hidden = Inbox(), Inbox(), Inbox()
    with (
        robot_space(parse_space("dds"), rover("export = true"), LIBRARY) as robot,
        DdsSpace(partition="msbot/ROVER") as member,
        DdsSpace() as stranger,
    ):
        power, secret = Topic("power", "Level"), Topic("secret", "Level")
        member.reader(power, RELIABLE, inside)
        stranger.reader(power, RELIABLE, outside)
        stranger.reader(secret, RELIABLE, hidden)
        own = robot.writer(power, RELIABLE, bytes(16))
        private = robot.writer(secret, RELIABLE, bytes(15) + b"\1")
        await until(lambda: (own.write(b"x"), private.write(b"y"), inside.samples and outside.samples)[2])
        assert hidden.samples == []


async def test_a_level_is_a_float32_for_ros_nodes_both_ways() -> None:
    pytest.importorskip("cyclonedds")
    inbox = Inbox()
    with robot_space(parse_space("dds"), rover("ros = true"), LIBRARY) as robot:
        power = Topic("power", "Level")
        writer = robot.writer(power, RELIABLE, bytes(16))
        async with program(*NODE, "echo", "ROVER/power") as node:
            await until(lambda: (writer.write(Level(percent=42.5).encode()), node.heard)[1])
            assert set(node.heard) == {"got 42.5"}
        robot.reader(power, RELIABLE, inbox)
        async with program(*NODE, "pub", "ROVER/power", "-7.25"):
            await until(lambda: inbox.samples)
        assert Level.decode(inbox.payloads[0]) == Level(percent=-7.25)
        assert writer.troubles() == ()


@pytest.mark.parametrize(
    ("wish", "topic"),
    [("", "rt/ROVER/power"), ('ros_topic = "arm/push"', "rt/ROVER/arm/push"), ('ros_topic = "/push"', "rt/push")],
)
async def test_a_topic_is_in_the_robots_namespace_unless_it_is_named_otherwise(wish: str, topic: str) -> None:
    inbox = Inbox()
    with robot_space(parse_space("dds"), rover(f"ros = true\n{wish}"), LIBRARY) as robot, DdsSpace() as node:
        node.reader(Topic(topic, "std_msgs::msg::dds_::Float32_"), RELIABLE, inbox)
        writer = robot.writer(Topic("power", "Level"), RELIABLE, bytes(16))
        await until(lambda: (writer.write(Level(percent=1.0).encode()), inbox.samples)[1])


async def test_a_message_of_ros_that_makes_no_sense_is_dropped_and_told() -> None:
    inbox = Inbox()
    with robot_space(parse_space("dds"), rover("ros = true"), LIBRARY) as robot, DdsSpace() as node:
        reader = robot.reader(Topic("power", "Level"), RELIABLE, inbox)
        writer = node.writer(Topic("rt/ROVER/power", "std_msgs::msg::dds_::Float32_"), RELIABLE, bytes(16))
        await until(lambda: (writer.write(b"\0"), reader.troubles())[1])
        assert re.fullmatch(r"rt/ROVER/power: \d+ samples of DDS peers made no sense", reader.troubles()[0])
        assert inbox.samples == []


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        (
            'ros = true\nros_type = "std_msgs/String"',
            'the binding of "power" with ros = true: Level.percent is float32, std_msgs::msg::dds_::String_ has str at '
            "data: a number goes with a number and a text with a text",
        ),
        ('ros = true\nros_fields = { per_cent = "data" }', "Level has no field 'per_cent'; it has percent"),
        (
            'ros = true\nros_type = "Float"',
            "'Float' is not a message type of ROS 2: write it like std_msgs/msg/Float32",
        ),
    ],
)
async def test_what_a_binding_says_wrongly_is_told_at_the_start(wishes: str, words: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(words)):
        robot_space(parse_space("dds"), rover(wishes), LIBRARY)
