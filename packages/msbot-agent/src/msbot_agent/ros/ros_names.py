"""Names in ROS 2: of nodes, and of the topics of a robot, which live in its namespace."""

from __future__ import annotations

import re

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
