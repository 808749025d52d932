"""Links over UDP, TCP and WebSocket."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.link.net.connection_budget import MAX_CONNECTIONS
    from msbot_agent.link.net.tcp import TcpClientLink, TcpServerLink
    from msbot_agent.link.net.udp import UdpClientLink, UdpServerLink
    from msbot_agent.link.net.websocket_client import PART_PATH, WebSocketClientLink
    from msbot_agent.link.net.websocket_server import SocketPeer, WebSocketServerLink

_NAMES = {
    "msbot_agent.link.net.connection_budget": ("MAX_CONNECTIONS",),
    "msbot_agent.link.net.tcp": (
        "TcpClientLink",
        "TcpServerLink",
    ),
    "msbot_agent.link.net.udp": (
        "UdpClientLink",
        "UdpServerLink",
    ),
    "msbot_agent.link.net.websocket_client": (
        "PART_PATH",
        "WebSocketClientLink",
    ),
    "msbot_agent.link.net.websocket_server": (
        "SocketPeer",
        "WebSocketServerLink",
    ),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "MAX_CONNECTIONS",
    "PART_PATH",
    "SocketPeer",
    "TcpClientLink",
    "TcpServerLink",
    "UdpClientLink",
    "UdpServerLink",
    "WebSocketClientLink",
    "WebSocketServerLink",
]
