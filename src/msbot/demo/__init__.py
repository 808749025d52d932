"""The thesis' sample robot in one process, on a simulated bus or over UDP: what `msbot demo` shows."""

from msbot.demo.robot import DemoRobot
from msbot.demo.snapshot import BusSnapshot, DemoEvent, DemoSnapshot, PartSnapshot, TopicSnapshot
from msbot.demo.wiring import Wire

__all__ = [
    "BusSnapshot",
    "DemoEvent",
    "DemoRobot",
    "DemoSnapshot",
    "PartSnapshot",
    "TopicSnapshot",
    "Wire",
]
