"""The agent: serves DDS-XRCE clients on any number of links and acts for them in a data space."""

from msbot.agent.discovery import DISCOVERY_GROUP, DISCOVERY_PORT, DiscoveryResponder, host_addresses
from msbot.agent.gate import ClientInfo, Gate, OpenGate
from msbot.agent.rpc import client_key_of
from msbot.agent.server import Agent, AgentSignalHandler
from msbot.agent.settings import AgentSettings
from msbot.agent.stats import ClientView, ObjectView, StreamView
from msbot.agent.status import Control, StatusServer
from msbot.agent.status_reader import AgentStatus, LinkView, RunningProcess, read_statuses, running_processes

__all__ = [
    "DISCOVERY_GROUP",
    "DISCOVERY_PORT",
    "Agent",
    "AgentSettings",
    "AgentSignalHandler",
    "AgentStatus",
    "ClientInfo",
    "ClientView",
    "Control",
    "DiscoveryResponder",
    "Gate",
    "LinkView",
    "ObjectView",
    "OpenGate",
    "RunningProcess",
    "StatusServer",
    "StreamView",
    "client_key_of",
    "host_addresses",
    "read_statuses",
    "running_processes",
]
