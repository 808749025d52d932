"""Real CAN controllers, by the kernel's SocketCAN or by python-can."""

from msbot.link.can.adapters.driver import CanDriver
from msbot.link.can.adapters.python_can import frame_of, message_of

__all__ = [
    "CanDriver",
    "frame_of",
    "message_of",
]
