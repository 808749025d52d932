"""Sample robots in one process, on a simulated bus or over UDP: `msbot demo`."""

from msbot_school.demo.demo_links import (
    BusSnapshot,
    DemoLinkKind,
    DemoSnapshot,
    DemoStateChange,
    PartSnapshot,
    TopicSnapshot,
)
from msbot_school.demo.demo_robot import DemoRobot

__all__ = [
    "BusSnapshot",
    "DemoLinkKind",
    "DemoRobot",
    "DemoSnapshot",
    "DemoStateChange",
    "PartSnapshot",
    "TopicSnapshot",
]
