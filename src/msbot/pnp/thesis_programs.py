"""The layouts and names of the thesis' own programs, which know neither leases nor UIDs (thesis 3.12.2).

A request is a buffer of 96 octets, zero filled: two CDR strings, the part number and the local name. The reply is a
buffer of the same size with one CDR string, the part number. Every request either registers the part or is its
heartbeat.

DEVIATION: the thesis' replier answers everybody; here a stranger gets no answer (R52), and only a registered part gets
    its number back.
"""

from __future__ import annotations

from struct import Struct

from msbot.errors import RemoteProtocolError
from msbot.pnp.model import Claim

BUFFER_BYTES = 96

SERVICE = "service_name"
REQUEST_TYPE = "request_type"
REPLY_TYPE = "reply_type"
REQUEST_TOPIC = "service_name_Request"
"""The topic of an XML requester with `service_name="service_name"` and no topic names (seen on the wire)."""
REPLY_TOPIC = "service_name_Reply"

_LENGTH = Struct("<I")


def decode_request(body: bytes) -> Claim:
    """Read a request.

    Raises:
        RemoteProtocolError: not 96 octets, or not two strings in them.
    """
    if len(body) != BUFFER_BYTES:
        raise RemoteProtocolError(f"request of {len(body)} octets, expected {BUFFER_BYTES}")
    part_number, offset = _read_string(body, 0)
    local_name, _ = _read_string(body, offset)
    return Claim(part_number=part_number, local_name=local_name, layout="compat")


def encode_request(part_number: str, local_name: str) -> bytes:
    """Build a request as the thesis' programs do.

    Raises:
        ValueError: the two strings do not fit.
    """
    return _filled(_string(part_number) + _string(local_name))


def decode_reply(body: bytes) -> str:
    """Read the part number from a reply.

    Raises:
        RemoteProtocolError: not 96 octets, or no string in them.
    """
    if len(body) != BUFFER_BYTES:
        raise RemoteProtocolError(f"reply of {len(body)} octets, expected {BUFFER_BYTES}")
    return _read_string(body, 0)[0]


def encode_reply(part_number: str) -> bytes:
    """Build the reply to a registered part.

    Raises:
        ValueError: the part number does not fit.
    """
    return _filled(_string(part_number))


def _read_string(body: bytes, offset: int) -> tuple[str, int]:
    if offset + 4 > len(body):
        raise RemoteProtocolError("no room for a string")
    (length,) = _LENGTH.unpack_from(body, offset)
    end = offset + 4 + length
    if length == 0 or end > len(body):
        raise RemoteProtocolError(f"string of {length} octets at offset {offset}")
    raw = body[offset + 4 : end]
    if raw[-1] != 0:
        raise RemoteProtocolError("string without its final NUL")
    try:
        text = raw[:-1].decode()
    except UnicodeDecodeError as error:
        raise RemoteProtocolError("string is not UTF-8") from error
    return text, -(-end // 4) * 4


def _string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    padding = -len(raw) % 4
    return _LENGTH.pack(len(raw)) + raw + bytes(padding)


def _filled(content: bytes) -> bytes:
    if len(content) > BUFFER_BYTES:
        raise ValueError(f"{len(content)} octets do not fit into {BUFFER_BYTES}")
    return content.ljust(BUFFER_BYTES, b"\0")
