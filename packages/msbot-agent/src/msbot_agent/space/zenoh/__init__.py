"""Zenoh through Eclipse's library (extra `msbot-agent[zenoh]`): the data space for wide networks, and its router."""

from msbot_agent.space.zenoh.router import Allowed, Router
from msbot_agent.space.zenoh.router_connection import check_files, unreachable
from msbot_agent.space.zenoh.zenoh_library import load
from msbot_agent.space.zenoh.zenoh_space import ZenohSpace

__all__ = ["Allowed", "Router", "ZenohSpace", "check_files", "load", "unreachable"]
