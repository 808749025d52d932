"""What a topic is in DDS or Zenoh: its names, its type, its partitions, and the form of its samples."""

from __future__ import annotations

from collections.abc import Callable

from msbot_agent.space.contract import Topic
from msbot_xrce.lazy import dataclass

ROBOTS = "msbot/"
"""Prefix of the DDS partitions of robots; the robot's name follows."""

Convert = Callable[[bytes], bytes]
"""Converts a payload from one form to another; raises RemoteProtocolError for one that makes no sense."""


@dataclass(frozen=True, slots=True)
class DdsTopic:
    """One of the names that a topic has in DDS."""

    name: str
    type_name: str
    partitions: tuple[str, ...] | None = None
    """Its partitions; None: those of the client, if it names any, else those of the space."""
    outward: Convert | None = None
    """From the client's form to the form in DDS; None = they are the same."""
    inward: Convert | None = None
    type_hash: str = ""
    """Of its type in ROS 2, for one that is in no list of ours; empty: there is none, or it is known."""


DdsTopicsOf = Callable[[Topic], tuple[DdsTopic, ...]]


def as_it_is(topic: Topic) -> tuple[DdsTopic, ...]:
    """Names and types verbatim, as for an agent without a blueprint."""
    return (DdsTopic(topic.name, topic.type_name),)
