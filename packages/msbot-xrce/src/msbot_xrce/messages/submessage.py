"""What all submessages share: the 4 octets in front, and how their payload is checked."""

from __future__ import annotations

import struct
from functools import lru_cache

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
        raise LocalProtocolError(f"{name} of {length} bytes: a submessage has {MAX_LENGTH} at most")
    return bytes((submessage_id, flags, length & 0xFF, length >> 8)) + payload


def need(start: int, end: int, size: int) -> None:
    """Refuse a payload that is too short.

    Raises:
        RemoteProtocolError: fewer than `size` octets.
    """
    if end - start < size:
        raise RemoteProtocolError(f"{end - start} bytes where {size} are needed")


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


# Headers around contents: turns samples into submessages, and bodies into messages (XRCE 1.0 §8.3.2).


_MESSAGE_HEADER = struct.Struct("<BBH")
_DATA_HEAD = struct.Struct(">BBHHH")
_LITTLE_ENDIAN = 0x01

MTU_MIN = 24
"""Smallest message size a session works with: header 8, submessage header 4, and a STATUS or a piece of 12 bytes."""


class Envelope:
    """Puts bodies into messages of one session."""

    __slots__ = ("_key_octets", "_pads", "_session_id", "capacity", "mtu")

    def __init__(self, session_id: int, client_key: int, mtu: int, *, pads: bool) -> None:
        """Prepare for messages of at most `mtu` bytes, header included.

        The client key is part of the header if the session id is below 0x80 (XRCE 1.0 §8.3.2). `pads` pads the messages
        of streams to a multiple of 4, as C clients do and agents do not.
        """
        self._session_id = session_id
        self._key_octets = client_key.to_bytes(4, "big") if session_id < 0x80 else b""
        self._pads = pads
        self.mtu = mtu & ~3 if pads else mtu
        """Largest message in bytes."""
        self.capacity = self.mtu - _MESSAGE_HEADER.size - len(self._key_octets)
        """Largest body in bytes."""

    def seal(self, stream_id: int, sequence_nr: int, body: bytes) -> bytes:
        """The message with that body."""
        packet = _MESSAGE_HEADER.pack(self._session_id, stream_id, sequence_nr) + self._key_octets + body
        if self._pads and stream_id and len(packet) & 3:
            packet += bytes(-len(packet) & 3)
        return packet


def append_submessage(body: bytes, submessage: bytes) -> bytes:
    """The body with one more submessage appended, starting at a multiple of 4."""
    padding = -len(body) & 3
    return body + bytes(padding) + submessage if padding else body + submessage


def data_submessage(submessage_id: int, request_id: int, object_id: int, payload: bytes) -> bytes:
    """A WRITE_DATA or DATA; above 65531 bytes of payload its length is 0, and it must be the last of its message."""
    return _data_head(submessage_id, request_id, object_id, len(payload)) + payload


def _data_head(submessage_id: int, request_id: int, object_id: int, size: int) -> bytes:
    length = size + 4
    # Length 0 means "to the end of the message" (seen on the wire for WRITE_DATA; between our own peers for DATA too).
    swapped = (length & 0xFF) << 8 | length >> 8 if length <= 0xFFFF else 0  # low octet first, unlike the ids
    return _DATA_HEAD.pack(submessage_id, _LITTLE_ENDIAN, swapped, request_id, object_id)


kept_data_head = lru_cache(2048)(_data_head)
"""What precedes a payload of that many octets in a DATA, `(submessage id, request id, object id, octets)`: all samples
of a read have the same ids, and mostly the same size."""
