"""The gateway between the data spaces of sites, and its files."""

from msbot_agent.wide.gateway import BridgeDirection, BridgedTopic, Gateway, GatewayRules, read_gateway_file
from msbot_agent.wide.router_file import RouterRules, read_router_file

__all__ = [
    "BridgeDirection",
    "BridgedTopic",
    "Gateway",
    "GatewayRules",
    "RouterRules",
    "read_gateway_file",
    "read_router_file",
]
