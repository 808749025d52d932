"""The agent: serves DDS-XRCE clients on any number of links and acts for them in a data space."""

from msbot.agent.discovery import DISCOVERY_GROUP, DISCOVERY_PORT, DiscoveryResponder, host_addresses
from msbot.agent.gate import ClientInfo, Gate, OpenGate
from msbot.agent.rpc import client_key_of
from msbot.agent.server import Agent, AgentSignalHandler
from msbot.agent.settings import AgentSettings
from msbot.agent.stats import ClientView, ObjectView, StreamView
from msbot.agent.status import StatusServer
from msbot.agent.status_reader import AgentStatus, LinkView, read_statuses

__all__ = [
    "DISCOVERY_GROUP",
    "DISCOVERY_PORT",
    "Agent",
    "AgentSettings",
    "AgentSignalHandler",
    "AgentStatus",
    "ClientInfo",
    "ClientView",
    "DiscoveryResponder",
    "Gate",
    "LinkView",
    "ObjectView",
    "OpenGate",
    "StatusServer",
    "StreamView",
    "client_key_of",
    "host_addresses",
    "read_statuses",
]
