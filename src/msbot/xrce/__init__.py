"""DDS-XRCE 1.0 as eProsima's client and agent speak it: octets, messages, streams, sessions. Pure: no clock, no socket.

Times are handed in as `now` in seconds of the caller's monotonic clock; octets go in, events and octets come out.
"""

from msbot.xrce.compression.header_compression import compress, decompress
from msbot.xrce.explain import explain
from msbot.xrce.layout import FoundField, read_fields
from msbot.xrce.messages.ids import Status
from msbot.xrce.messages.whole import is_whole
from msbot.xrce.objects.references import References
from msbot.xrce.sessions.agent import AgentSession
from msbot.xrce.sessions.client import ClientSession
from msbot.xrce.sessions.client_state import ClientState
from msbot.xrce.sessions.settings import AgentSessionSettings, ClientSessionSettings
from msbot.xrce.streams.receiving_in_order import GIVEN_UP
from msbot.xrce.wireshark import dissector

__all__ = [
    "GIVEN_UP",
    "AgentSession",
    "AgentSessionSettings",
    "ClientSession",
    "ClientSessionSettings",
    "ClientState",
    "FoundField",
    "References",
    "Status",
    "compress",
    "decompress",
    "dissector",
    "explain",
    "is_whole",
    "read_fields",
]
