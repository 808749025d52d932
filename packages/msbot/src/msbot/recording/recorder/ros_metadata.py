"""What a recording tells of a topic that ROS 2 has, too: its name and type there, and which field is which.

So a program that has neither the robot's blueprint nor its library can write the messages as ROS 2 has them.
"""

from __future__ import annotations

import json
from typing import Final

from msbot.config import Blueprint, InDds
from msbot.part import Message
from msbot_agent.ros.ros_names import topic_of

ROS_TOPIC: Final = "ros_topic"
"""`/ROVER/power`"""
ROS_TYPE: Final = "ros_type"
"""`std_msgs/msg/Float32`"""
ROS_FIELDS: Final = "ros_fields"
"""`[[0, "data", 1.0]]`: position of our field, their field, theirs is ours times."""


def topics_in_ros(blueprint: Blueprint) -> dict[str, tuple[str, InDds]]:
    """The topics of a robot that ROS 2 has: their names there, and what the blueprint says about them."""
    robot = blueprint.robot.name
    return {
        one.topic: (topic_of(robot, one.in_dds.ros_topic or one.topic).removeprefix("rt"), one.in_dds)
        for one in blueprint.bindings if one.in_dds.ros
    }  # fmt: skip


def ros_metadata(shared: tuple[str, InDds], cls: type[Message]) -> dict[str, str]:
    """What a channel of such a topic says.

    Args:
        shared: as `topics_in_ros` has it.
        cls: the class of the topic's messages.

    Raises:
        ConfigError: ROS 2 has no form for it; a robot with such a blueprint does not start.
    """
    from msbot.recording.recorder.schemas import ros_name
    from msbot.ros_forms import form_of  # with all messages of ROS 2, which few robots need

    name, wish = shared
    form = form_of(cls, wish.ros_type, dict(wish.ros_fields))
    return {ROS_TOPIC: name, ROS_TYPE: ros_name(form.theirs.type_name), ROS_FIELDS: json.dumps(form.fields)}
