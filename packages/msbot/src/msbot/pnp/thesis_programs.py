"""The layouts and names of the thesis' own programs, which know neither leases nor UIDs (thesis 3.12.2).

A request is a buffer of 96 octets, zero filled: two CDR strings, the part number and the local name. The reply is a
buffer of the same size with one CDR string, the part number. Every request either registers the part or is its
heartbeat.

DEVIATION: the thesis' replier answers everybody; here a stranger gets no answer (R52), and only a registered part gets
    its number back.
"""

from __future__ import annotations

from msbot.part.join.refusal import BUFFER_BYTES as BUFFER_BYTES  # noqa: PLC0414 - others look for it here
from msbot.part.join.refusal import REPLY_TYPE as REPLY_TYPE  # noqa: PLC0414
from msbot.part.join.refusal import REQUEST_TYPE as REQUEST_TYPE  # noqa: PLC0414
from msbot.part.join.refusal import SERVICE as SERVICE  # noqa: PLC0414
from msbot.part.join.refusal import encode_reply as encode_reply  # noqa: PLC0414
from msbot.part.join.refusal import encode_request as encode_request  # noqa: PLC0414
from msbot.part.join.refusal import is_probe_request as is_probe_request  # noqa: PLC0414
from msbot.part.join.refusal import read_string
from msbot.pnp.model import Claim
from msbot_xrce.errors import RemoteProtocolError

REQUEST_TOPIC = "service_name_Request"
"""The topic of an XML requester with `service_name="service_name"` and no topic names (seen on the wire)."""
REPLY_TOPIC = "service_name_Reply"


def decode_request(body: bytes) -> Claim:
    """Read a request.

    Raises:
        RemoteProtocolError: not 96 octets, or not two strings in them.
    """
    if len(body) != BUFFER_BYTES:
        raise RemoteProtocolError(f"request of {len(body)} octets, expected {BUFFER_BYTES}")
    part_number, offset = read_string(body, 0)
    local_name, _ = read_string(body, offset)
    return Claim(part_number=part_number, local_name=local_name, layout="compat")


def decode_reply(body: bytes) -> str:
    """Read the part number from a reply.

    Raises:
        RemoteProtocolError: not 96 octets, or no string in them.
    """
    if len(body) != BUFFER_BYTES:
        raise RemoteProtocolError(f"reply of {len(body)} octets, expected {BUFFER_BYTES}")
    return read_string(body, 0)[0]
