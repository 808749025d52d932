"""Links over UDP and TCP."""

from msbot.link.net.connection_budget import MAX_CONNECTIONS
from msbot.link.net.tcp import TcpClientLink, TcpServerLink
from msbot.link.net.udp import UdpClientLink, UdpServerLink

__all__ = [
    "MAX_CONNECTIONS",
    "TcpClientLink",
    "TcpServerLink",
    "UdpClientLink",
    "UdpServerLink",
]
