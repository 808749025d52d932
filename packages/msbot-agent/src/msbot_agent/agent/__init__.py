"""The agent: serves DDS-XRCE clients on links and acts for them in a data space."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.agent.agent_settings import MOST_OBJECTS, AgentSettings
    from msbot_agent.agent.discovery import DiscoveryResponder, host_ipv6_addresses
    from msbot_agent.agent.gate import ClientInfo, Gate, OpenGate, client_key_in
    from msbot_agent.agent.reply_routing import client_key_of
    from msbot_agent.agent.server import Agent, AgentSignalHandler
    from msbot_agent.agent.statistics import (
        Acknowledgements,
        ClientView,
        Maximum,
        ObjectView,
        SessionFaultCounts,
        StreamView,
    )
    from msbot_agent.agent.status_reader import (
        MASTER,
        AgentStatus,
        LinkView,
        RunningProcess,
        read_statuses,
        running_processes,
    )
    from msbot_agent.agent.status_server import Control, StatusServer

_NAMES = {
    "msbot_agent.agent.discovery": (
        "DiscoveryResponder",
        "host_ipv6_addresses",
    ),
    "msbot_agent.agent.gate": (
        "ClientInfo",
        "Gate",
        "OpenGate",
        "client_key_in",
    ),
    "msbot_agent.agent.agent_settings": (
        "AgentSettings",
        "MOST_OBJECTS",
    ),
    "msbot_agent.agent.statistics": (
        "Acknowledgements",
        "ClientView",
        "ObjectView",
        "SessionFaultCounts",
        "StreamView",
        "Maximum",
    ),
    "msbot_agent.agent.reply_routing": ("client_key_of",),
    "msbot_agent.agent.server": (
        "Agent",
        "AgentSignalHandler",
    ),
    "msbot_agent.agent.status_reader": (
        "AgentStatus",
        "LinkView",
        "MASTER",
        "RunningProcess",
        "read_statuses",
        "running_processes",
    ),
    "msbot_agent.agent.status_server": (
        "Control",
        "StatusServer",
    ),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "MASTER",
    "MOST_OBJECTS",
    "Acknowledgements",
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
    "Maximum",
    "ObjectView",
    "OpenGate",
    "RunningProcess",
    "SessionFaultCounts",
    "StatusServer",
    "StreamView",
    "client_key_in",
    "client_key_of",
    "host_ipv6_addresses",
    "read_statuses",
    "running_processes",
]
