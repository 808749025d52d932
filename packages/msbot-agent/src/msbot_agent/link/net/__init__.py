"""Links over UDP, TCP and WebSocket."""

from msbot_agent.link.net.connection_budget import MAX_CONNECTIONS
from msbot_agent.link.net.tcp import TcpClientLink, TcpServerLink
from msbot_agent.link.net.udp import UdpClientLink, UdpServerLink
from msbot_agent.link.net.websocket_client import PART_PATH, WebSocketClientLink
from msbot_agent.link.net.websocket_server import SocketPeer, WebSocketServerLink

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
