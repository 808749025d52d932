"""The data space: where the writers and readers of an agent meet, in this process' memory or over DDS.

`contract` says what a space is; `open_space` makes one from an address (`memory`, `dds`, `dds:5`).
"""

from __future__ import annotations

from msbot.space.contract import (
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
from msbot.space.dds_topics import DdsTopic, DdsTopicsOf
from msbot.space.memory import MemorySpace
from msbot.space.space_address import MEMORY, SpaceAddress, open_space, parse_space

__all__ = [
    "MEMORY",
    "THIS_PROGRAM",
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
    "Topic",
    "Writer",
    "open_space",
    "parse_space",
]
