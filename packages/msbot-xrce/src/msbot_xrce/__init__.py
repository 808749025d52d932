"""DDS-XRCE 1.0 as eProsima's client and agent speak it: octets, messages, streams, sessions. Pure: no clock, no socket.

Times are handed in as `now` in seconds of the caller's monotonic clock; octets go in, events and octets come out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_xrce.compression import compress, decompress
    from msbot_xrce.layout import Envelope, Form, FoundField, LaidField, read_fields
    from msbot_xrce.message_words import explain
    from msbot_xrce.messages.ids import Status
    from msbot_xrce.messages.message import is_whole
    from msbot_xrce.objects.references import References
    from msbot_xrce.sessions.agent import AgentSession
    from msbot_xrce.sessions.client import ClientSession, ClientState
    from msbot_xrce.streams.receiving_in_order import GIVEN_UP
    from msbot_xrce.streams.settings import AgentSessionSettings, ClientSessionSettings
    from msbot_xrce.wireshark import dissector

_NAMES = {
    "msbot_xrce.compression": (
        "compress",
        "decompress",
    ),
    "msbot_xrce.message_words": ("explain",),
    "msbot_xrce.layout": (
        "Envelope",
        "Form",
        "FoundField",
        "LaidField",
        "read_fields",
    ),
    "msbot_xrce.messages.ids": ("Status",),
    "msbot_xrce.messages.message": ("is_whole",),
    "msbot_xrce.objects.references": ("References",),
    "msbot_xrce.sessions.agent": ("AgentSession",),
    "msbot_xrce.sessions.client": (
        "ClientSession",
        "ClientState",
    ),
    "msbot_xrce.streams.settings": (
        "AgentSessionSettings",
        "ClientSessionSettings",
    ),
    "msbot_xrce.streams.receiving_in_order": ("GIVEN_UP",),
    "msbot_xrce.wireshark": ("dissector",),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "GIVEN_UP",
    "AgentSession",
    "AgentSessionSettings",
    "ClientSession",
    "ClientSessionSettings",
    "ClientState",
    "Envelope",
    "Form",
    "FoundField",
    "LaidField",
    "References",
    "Status",
    "compress",
    "decompress",
    "dissector",
    "explain",
    "is_whole",
    "read_fields",
]
