"""Sample robots in one process, on a simulated bus or over UDP: `msbot demo`."""

from msbot_school.demo.demo_links import BusSnapshot, DemoEvent, DemoLinkKind, DemoSnapshot, PartSnapshot, TopicSnapshot
from msbot_school.demo.demo_robot import DemoRobot

__all__ = [
    "BusSnapshot",
    "DemoEvent",
    "DemoLinkKind",
    "DemoRobot",
    "DemoSnapshot",
    "PartSnapshot",
    "TopicSnapshot",
]
