"""Links over serial ports and pseudo terminals."""

from msbot_agent.link.serial.port import SerialClientLink, SerialServerLink
from msbot_agent.link.serial.pty import PtyServerLink

__all__ = [
    "PtyServerLink",
    "SerialClientLink",
    "SerialServerLink",
]
