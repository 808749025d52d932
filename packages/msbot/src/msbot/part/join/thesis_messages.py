"""The messages between the thesis' own parts and their master, and how a part recognizes such a master.

A request is a buffer of 96 octets, zero filled: two CDR strings, the part number and the local name. The reply is a
buffer of the same size with one CDR string, the part number.

That master publishes the same profile as one of MsBOT, but knows neither leases nor configurations: on a service of
its own it answers every request of 96 octets with the part number in it, and gives nobody a place (thesis 3.12.2). So
a part whose claims nobody answers asks there, too, to be able to say what it has found. It asks as the thesis' parts
do, with a mark in the octets that they leave free, so that an inventory of MsBOT, which serves those parts as well,
drops it.
"""

from __future__ import annotations

from struct import Struct

from msbot_xrce.errors import RemoteProtocolError

BUFFER_BYTES = 96

SERVICE = "service_name"
REQUEST_TYPE = "request_type"
REPLY_TYPE = "reply_type"
REQUEST_TOPIC = "service_name_Request"
"""The topic of an XML requester with `service_name="service_name"` and no topic names (seen on the wire)."""
REPLY_TOPIC = "service_name_Reply"

DOES_NOT_JOIN = (
    "this is the master of the thesis' own programs, which gives no part a place or a configuration: a part of MsBOT "
    "does not join it; run `msbot master` in its place, which serves the thesis' parts, too"
)

_MARK = b"?MsBOT"
_LENGTH = Struct("<I")


def probe_request(part_number: str, local_name: str) -> bytes | None:
    """The request; None if the names are too long for a request of the thesis."""
    content = _string(part_number) + _string(local_name)
    if len(content) + len(_MARK) > BUFFER_BYTES:
        return None
    return content.ljust(BUFFER_BYTES - len(_MARK), b"\0") + _MARK


def is_probe_request(request: bytes) -> bool:
    """Whether a request in the thesis' layout is one that only asks who answers."""
    return len(request) == BUFFER_BYTES and request.endswith(_MARK)


def encode_request(part_number: str, local_name: str) -> bytes:
    """A request as the thesis' parts make it.

    Raises:
        ValueError: the two strings do not fit.
    """
    return _filled(_string(part_number) + _string(local_name))


def encode_reply(part_number: str) -> bytes:
    """The reply to it.

    Raises:
        ValueError: the part number does not fit.
    """
    return _filled(_string(part_number))


def decode_reply(body: bytes) -> str:
    """Read the part number from a reply.

    Raises:
        RemoteProtocolError: not 96 octets, or no string in them.
    """
    if len(body) != BUFFER_BYTES:
        raise RemoteProtocolError(f"reply of {len(body)} bytes, expected {BUFFER_BYTES}")
    return read_string(body, 0)[0]


def read_string(body: bytes, offset: int) -> tuple[str, int]:
    """A string and where the next one begins.

    Raises:
        RemoteProtocolError: there is none.
    """
    if offset + 4 > len(body):
        raise RemoteProtocolError("no room for a string")
    (length,) = _LENGTH.unpack_from(body, offset)
    end = offset + 4 + length
    if length == 0 or end > len(body):
        raise RemoteProtocolError(f"string of {length} bytes at offset {offset}")
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
        raise ValueError(f"{len(content)} bytes do not fit into {BUFFER_BYTES}")
    return content.ljust(BUFFER_BYTES, b"\0")
