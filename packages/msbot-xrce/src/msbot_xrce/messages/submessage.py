"""What all submessages share: the 4 octets in front, and how their payload is checked."""

from __future__ import annotations

import struct

from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from msbot_xrce.messages.ids import SubmessageId

LITTLE_ENDIAN = 0x01
"""Flag of all submessages: the payload is little endian (the length in the header always is)."""

HEADER_SIZE = 4
SUBMESSAGE_HEADER = struct.Struct("<BBH")
"""Kind, flags, and the length of what follows."""
# Plain ints: comparing with a member of an IntEnum costs several times as much.
_TO_THE_END = (SubmessageId.WRITE_DATA.value, SubmessageId.DATA.value)
MAX_LENGTH = 0xFFFF
"""Largest payload in octets."""


def frame(submessage_id: int, payload: bytes, flags: int = LITTLE_ENDIAN) -> bytes:
    """The submessage with that payload, header in front (XRCE 1.0 §8.3.4).

    Raises:
        LocalProtocolError: the payload is longer than 65535 octets.
    """
    length = len(payload)
    if length > MAX_LENGTH:
        name = SubmessageId(submessage_id).name
        raise LocalProtocolError(f"{name} of {length} octets: a submessage has {MAX_LENGTH} at most")
    return bytes((submessage_id, flags, length & 0xFF, length >> 8)) + payload


def need(start: int, end: int, size: int) -> None:
    """Refuse a payload that is too short.

    Raises:
        RemoteProtocolError: fewer than `size` octets.
    """
    if end - start < size:
        raise RemoteProtocolError(f"{end - start} octets where {size} are needed")


def locate(packet: bytes, start: int) -> tuple[int, int, int]:
    """`(kind, flags, end)` of the submessage whose contents begin at `start`.

    If the submessage is cut short, its end lies beyond the packet. A sample of length 0 reaches to the end of the
    packet: it is too long for the length field (seen on the wire, beyond 64 KiB).
    """
    kind, flags, length = SUBMESSAGE_HEADER.unpack_from(packet, start - HEADER_SIZE)
    return kind, flags, start + length if length else end_of_empty(kind, packet, start)


def end_of_empty(kind: int, packet: bytes, start: int) -> int:
    """Where a submessage ends whose length is 0; see `locate`."""
    return len(packet) if kind in _TO_THE_END else start
