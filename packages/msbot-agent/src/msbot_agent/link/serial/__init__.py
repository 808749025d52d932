"""Links over serial ports and pseudo terminals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.link.serial.pty import PtyServerLink
    from msbot_agent.link.serial.serial_port import SerialClientLink, SerialServerLink

_NAMES = {
    "msbot_agent.link.serial.serial_port": (
        "SerialClientLink",
        "SerialServerLink",
    ),
    "msbot_agent.link.serial.pty": ("PtyServerLink",),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "PtyServerLink",
    "SerialClientLink",
    "SerialServerLink",
]
