"""Names of nodes in ROS 2: `/ROVER/knob` is the node `knob` in the namespace `/ROVER`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from msbot_xrce.lazy import dataclass

# Names in ROS 2: of nodes, and of the topics of a robot, which live in its namespace.


LONGEST = 255
"""Longest name or namespace (rmw_dds_common)."""

GLOBAL_TOPICS = ("clock", "diagnostics", "robot_description")
"""What a robot tells of itself; the blueprint may give them the names that all robots share."""

_NOT_IN_A_WORD = re.compile(r"[^A-Za-z0-9_]")
_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


def ros_word(text: str) -> str:
    """The text as a word that ROS 2 accepts: letters, digits and underscores, no digit in front."""
    word = _NOT_IN_A_WORD.sub("_", text)[:LONGEST]
    return word if word and not word[0].isdigit() else f"_{word}"[:LONGEST]


def is_topic(name: str) -> bool:
    """Whether ROS 2 takes the name of a topic: `light`, or `/light` for the one that all robots share."""
    return _TOPIC.fullmatch(name) is not None


def topic_of(robot: str, name: str) -> str:
    """A topic in DDS: `light` of ROVER is `rt/ROVER/light`, and `/light` is `rt/light` whoever names it."""
    return f"rt{name}" if name.startswith("/") else f"rt/{ros_word(robot)}/{name}"


def service_of(robot: str, name: str) -> str:
    """A service by its whole name: `photo` of ROVER is `/ROVER/photo`, and `/photo` is itself whoever names it."""
    return topic_of(robot, name).removeprefix("rt")


@dataclass(frozen=True, slots=True)
class NodeName:
    """The name of a node."""

    namespace: str
    """`/`, or a path that begins with one."""
    name: str

    def __str__(self) -> str:
        """The whole name: `/ROVER/knob`."""
        return f"{self.namespace.rstrip('/')}/{self.name}"

    @property
    def topics(self) -> str:
        """What its own topics and services begin with in DDS, behind `rt`, `rq` or `rr`."""
        return str(self)


def node_named(text: str) -> NodeName:
    """The node that a participant's name stands for: `blinker`, or `/garden/blinker` as micro-ROS has it."""
    *path, name = [ros_word(word) for word in text.split("/") if word] or ["_"]
    return NodeName(f"/{'/'.join(path)}"[:LONGEST], name)


def robot_node(robot: str) -> NodeName:
    """The node of the robot itself."""
    return NodeName("/", ros_word(robot))


def slot_nodes(robot: str, slots: Iterable[str]) -> Mapping[str, NodeName]:
    """The node of each slot; slots whose names ROS 2 cannot tell apart get numbers."""
    namespace = f"/{ros_word(robot)}"
    found: dict[str, NodeName] = {}
    taken: set[str] = set()
    for slot in slots:
        word, number = ros_word(slot), 1
        name = word
        while name in taken:
            number += 1
            name = f"{word}_{number}"
        taken.add(name)
        found[slot] = NodeName(namespace, name)
    return found
