"""Links over serial ports and pseudo terminals."""

from msbot.link.serial.port import SerialClientLink, SerialServerLink
from msbot.link.serial.pty import PtyServerLink

__all__ = [
    "PtyServerLink",
    "SerialClientLink",
    "SerialServerLink",
]
