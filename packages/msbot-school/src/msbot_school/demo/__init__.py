"""The thesis' sample robot in one process, on a simulated bus or over UDP: what `msbot demo` shows."""

from msbot_school.demo.robot import DemoRobot
from msbot_school.demo.wiring import BusSnapshot, DemoEvent, DemoSnapshot, PartSnapshot, TopicSnapshot, Wire

__all__ = [
    "BusSnapshot",
    "DemoEvent",
    "DemoRobot",
    "DemoSnapshot",
    "PartSnapshot",
    "TopicSnapshot",
    "Wire",
]
