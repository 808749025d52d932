"""The agent: serves DDS-XRCE clients on any number of links and acts for them in a data space."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot.runtime.lazy_face import lazy_face

if TYPE_CHECKING:
    from msbot.agent.agent_settings import MOST_OBJECTS, AgentSettings
    from msbot.agent.discovery import DiscoveryResponder, host_ipv6_addresses
    from msbot.agent.gate import ClientInfo, Gate, OpenGate
    from msbot.agent.latency import Acknowledgements, Worst
    from msbot.agent.logins import client_key_in
    from msbot.agent.pending_requests import client_key_of
    from msbot.agent.server import Agent, AgentSignalHandler
    from msbot.agent.statistics import ClientView, ObjectView, SessionWear, StreamView
    from msbot.agent.status_reader import (
        MASTER,
        AgentStatus,
        LinkView,
        RunningProcess,
        read_statuses,
        running_processes,
    )
    from msbot.agent.status_server import Control, StatusServer

_NAMES = {
    "msbot.agent.discovery": (
        "DiscoveryResponder",
        "host_ipv6_addresses",
    ),
    "msbot.agent.gate": (
        "ClientInfo",
        "Gate",
        "OpenGate",
    ),
    "msbot.agent.agent_settings": ("MOST_OBJECTS", "AgentSettings"),
    "msbot.agent.latency": (
        "Acknowledgements",
        "Worst",
    ),
    "msbot.agent.logins": ("client_key_in",),
    "msbot.agent.pending_requests": ("client_key_of",),
    "msbot.agent.server": (
        "Agent",
        "AgentSignalHandler",
    ),
    "msbot.agent.statistics": (
        "ClientView",
        "ObjectView",
        "SessionWear",
        "StreamView",
    ),
    "msbot.agent.status_reader": (
        "MASTER",
        "AgentStatus",
        "LinkView",
        "RunningProcess",
        "read_statuses",
        "running_processes",
    ),
    "msbot.agent.status_server": (
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
    "ObjectView",
    "OpenGate",
    "RunningProcess",
    "SessionWear",
    "StatusServer",
    "StreamView",
    "Worst",
    "client_key_in",
    "client_key_of",
    "host_ipv6_addresses",
    "read_statuses",
    "running_processes",
]
