"""The data space: writers and readers in memory, over DDS or over Zenoh.

`contract` says what a space is; `open_space` makes one from an address (`memory`, `dds:5`, `zenoh:tcp/host:7447`).
"""

from __future__ import annotations

from msbot_agent.space.contract import (
    THIS_PROGRAM,
    Deliver,
    Guid,
    OwnEndpoint,
    Owner,
    Qos,
    Reader,
    Sample,
    SharedSpace,
    Space,
    Topic,
    Writer,
)
from msbot_agent.space.dds_topics import DdsTopic, DdsTopicsOf
from msbot_agent.space.memory import MemorySpace
from msbot_agent.space.network_options import TlsFiles
from msbot_agent.space.service_names import crosses as is_service_topic
from msbot_agent.space.space_address import (
    DDS,
    MEMORY,
    ZENOH,
    ZENOH_HERE,
    SpaceAddress,
    SpaceKind,
    brought_kinds,
    check_endpoint,
    open_space,
    parse_space,
    robot_partition,
)

__all__ = [
    "DDS",
    "MEMORY",
    "THIS_PROGRAM",
    "ZENOH",
    "ZENOH_HERE",
    "DdsTopic",
    "DdsTopicsOf",
    "Deliver",
    "Guid",
    "MemorySpace",
    "OwnEndpoint",
    "Owner",
    "Qos",
    "Reader",
    "Sample",
    "SharedSpace",
    "Space",
    "SpaceAddress",
    "SpaceKind",
    "TlsFiles",
    "Topic",
    "Writer",
    "brought_kinds",
    "check_endpoint",
    "is_service_topic",
    "open_space",
    "parse_space",
    "robot_partition",
]
