"""The names of a robot's topics in DDS: in its own partition, and those that the blueprint shares with others."""

from __future__ import annotations

from contextlib import AbstractContextManager

from msbot.config import Binding, Blueprint, Library
from msbot.sim.message_classes import message_class
from msbot_agent.space import DdsTopic, DdsTopicsOf, Space, SpaceAddress, Topic, open_space, robot_partition
from msbot_xrce.errors import ConfigError

EVERYBODY = ""
"""The partition without a name, used by programs that name none."""


def robot_space(address: SpaceAddress, blueprint: Blueprint, library: Library) -> AbstractContextManager[Space]:
    """The data space for a robot, to be used with `with` on a running event loop.

    In DDS and Zenoh all its topics are in a partition of their own, so that robots do not hear each other.

    Raises:
        ConfigError: DDS is not available here, or a binding asks for something impossible in ROS 2; the text says what
            to do.
    """
    partition = robot_partition(address, blueprint.robot.name)
    return open_space(address, partition=partition, dds_topics_of=dds_topics_of(blueprint, library, partition))


def dds_topics_of(blueprint: Blueprint, library: Library, partition: str) -> DdsTopicsOf:
    """The names of each topic of a robot; in ROS 2 they are in its namespace, unless its blueprint says otherwise.

    Raises:
        ConfigError: ROS 2 has no form for a topic that should be shared with it; the text names topic and remedy.
    """
    known: dict[str, tuple[DdsTopic, ...]] = {}
    for binding in blueprint.bindings:
        if binding.topic not in known:
            known[binding.topic] = _dds_topics(binding, library, partition, blueprint.robot.name)

    def find(topic: Topic) -> tuple[DdsTopic, ...]:
        return known.get(topic.name) or (DdsTopic(topic.name, topic.type_name),)

    return find


def _dds_topics(binding: Binding, library: Library, partition: str, robot: str) -> tuple[DdsTopic, ...]:
    wish = binding.in_dds
    partitions = (partition, EVERYBODY) if wish.export else None
    found = [DdsTopic(binding.topic, binding.type_name, partitions)]
    if wish.ros:
        from msbot.ros_forms import form_of, topic_name  # with all messages of ROS 2, which few robots need

        try:
            form = form_of(message_class(library.messages[binding.type_name]), wish.ros_type, dict(wish.ros_fields))
            name = topic_name(robot, wish.ros_topic or binding.topic)
        except ConfigError as error:
            raise ConfigError(f'the binding of "{binding.topic}" with ros = true: {error}') from None
        found.append(DdsTopic(name, form.theirs.type_name, (EVERYBODY,), form.outward, form.inward))
    return tuple(found)
