"""Submessages that run a stream: acknowledge, announce, start over, carry a piece (XRCE 1.0 §8.3.5.11 to 14)."""

from __future__ import annotations

import struct
from typing import ClassVar, Self

from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.ids import SubmessageId
from msbot_xrce.messages.submessage import LITTLE_ENDIAN, frame, need

LAST_FRAGMENT = 0x02

# The bitmap is two octets, high one first, whatever the byte order of the payload (seen on the wire).
_ACKNACK = (struct.Struct(">HBBB"), struct.Struct("<HBBB"))
_ACKNACK_OUT = struct.Struct("<BBHHBBB")
_ACKNACK_ID = SubmessageId.ACKNACK.value
_HEARTBEAT = (struct.Struct(">HHB"), struct.Struct("<HHB"))
_HEARTBEAT_OUT = struct.Struct("<BBHHHB")


@dataclass(slots=True)
class Acknack:
    """What a receiver has and is missing on a reliable stream (XRCE 1.0 §8.3.5.11); always sent on stream NONE."""

    ID: ClassVar[int] = SubmessageId.ACKNACK

    first_unacked: int
    """All messages with lower sequence numbers have arrived."""
    bitmap: int
    """Bit i set: `first_unacked + i` is missing."""
    stream_id: int

    def encode(self) -> bytes:
        """The whole submessage."""
        return write_acknack(self.first_unacked, self.bitmap, self.stream_id)

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: it is too short.
        """
        return cls(*read_acknack(packet, start, end, flags))


def read_acknack(packet: bytes, start: int, end: int, flags: int) -> tuple[int, int, int]:
    """The fields of an `Acknack` in `packet[start:end]`, without creating an object for every message that was sent.

    Raises:
        RemoteProtocolError: it is too short.
    """
    if end - start < 5:
        need(start, end, 5)
    first, high, low, stream_id = _ACKNACK[flags & 1].unpack_from(packet, start)
    return first, high << 8 | low, stream_id


def write_acknack(first_unacked: int, bitmap: int, stream_id: int) -> bytes:
    """The whole submessage of an `Acknack`, without creating an object for every message that was received."""
    return _ACKNACK_OUT.pack(_ACKNACK_ID, LITTLE_ENDIAN, 5, first_unacked, bitmap >> 8, bitmap & 0xFF, stream_id)


@dataclass(slots=True)
class Heartbeat:
    """The messages that a sender keeps for a reliable stream (XRCE 1.0 §8.3.5.12); on stream NONE, answered by
    ACKNACK."""

    ID: ClassVar[int] = SubmessageId.HEARTBEAT

    first: int
    """First sequence number not acknowledged."""
    last: int
    stream_id: int

    def encode(self) -> bytes:
        """The whole submessage."""
        return _HEARTBEAT_OUT.pack(self.ID, LITTLE_ENDIAN, 5, self.first, self.last, self.stream_id)

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: it is too short.
        """
        if end - start < 5:
            need(start, end, 5)
        first, last, stream_id = _HEARTBEAT[flags & 1].unpack_from(packet, start)
        return cls(first, last, stream_id)


@dataclass(slots=True)
class Reset:
    """All streams of the session start over (XRCE 1.0 §8.3.5.13); objects stay; there is no answer."""

    ID: ClassVar[int] = SubmessageId.RESET

    def encode(self) -> bytes:
        """The whole submessage."""
        return frame(self.ID, b"")

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:  # noqa: ARG003 - empty
        """Nothing to read."""
        return cls()


@dataclass(slots=True)
class Fragment:
    """A piece of submessages that do not fit into one message (XRCE 1.0 §8.3.5.14); reliable streams only."""

    ID: ClassVar[int] = SubmessageId.FRAGMENT

    payload: bytes
    last: bool = False

    def encode(self) -> bytes:
        """The whole submessage."""
        flags = LITTLE_ENDIAN | LAST_FRAGMENT if self.last else LITTLE_ENDIAN
        return frame(self.ID, self.payload, flags)

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`; an empty piece is valid."""
        return cls(packet[start:end], bool(flags & LAST_FRAGMENT))
