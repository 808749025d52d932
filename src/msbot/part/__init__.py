"""What a part is made of: messages, the client of the agent, plug-and-play from the part's side."""

from __future__ import annotations

from msbot.part.hello import HelloWorld
from msbot.part.message import Field, Message, fields_of
from msbot.part.wire_types import (
    AtMost,
    Octets,
    float32,
    float64,
    int8,
    int16,
    int32,
    int64,
    uint8,
    uint16,
    uint32,
    uint64,
)

__all__ = [
    "AtMost",
    "Field",
    "HelloWorld",
    "Message",
    "Octets",
    "fields_of",
    "float32",
    "float64",
    "int8",
    "int16",
    "int32",
    "int64",
    "uint8",
    "uint16",
    "uint32",
    "uint64",
]
