"""Real CAN controllers, by the kernel's SocketCAN or by python-can."""

from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.adapters.interface import CanInterface, CanTotals, can_interfaces, find_interface
from msbot_agent.link.can.adapters.python_can import frame_of, message_of
from msbot_agent.link.can.adapters.remedies import Wanted, up_commands, why_not

__all__ = [
    "CanDriver",
    "CanInterface",
    "CanTotals",
    "Wanted",
    "can_interfaces",
    "find_interface",
    "frame_of",
    "message_of",
    "up_commands",
    "why_not",
]
