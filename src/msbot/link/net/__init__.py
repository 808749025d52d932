"""Links over UDP, TCP and WebSocket."""

from msbot.link.net.connection_budget import MAX_CONNECTIONS
from msbot.link.net.tcp import TcpClientLink, TcpServerLink
from msbot.link.net.udp import UdpClientLink, UdpServerLink
from msbot.link.net.websocket_client import PART_PATH, WebSocketClientLink
from msbot.link.net.websocket_server import SocketPeer, WebSocketServerLink

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
