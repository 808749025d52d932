"""Names of nodes in ROS 2: `/ROVER/knob` is the node `knob` in the namespace `/ROVER`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msbot_agent.ros.ros_names import LONGEST, ros_word
from msbot_xrce.common.lazy_dataclass import dataclass


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
