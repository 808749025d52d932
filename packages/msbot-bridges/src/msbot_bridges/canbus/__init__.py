"""What the worlds on CAN share: buses of python-can, their addresses, and who may be on one bus"""

from msbot_bridges.canbus.bus import FrameSender, check_address, is_fd, open_bus
from msbot_bridges.canbus.fresh_reports import FreshReports
from msbot_bridges.canbus.heartbeats import Heartbeats
from msbot_bridges.canbus.held_bus import held_bus
from msbot_bridges.canbus.neighbours import BEACON_ID, Neighbours
from msbot_bridges.canbus.one_bus import OnBus, check_one_bus, robot_on_bus

__all__ = [
    "BEACON_ID",
    "FrameSender",
    "FreshReports",
    "Heartbeats",
    "Neighbours",
    "OnBus",
    "check_address",
    "check_one_bus",
    "held_bus",
    "is_fd",
    "open_bus",
    "robot_on_bus",
]
