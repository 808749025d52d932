"""Submessages that carry samples, and the request for them (XRCE 1.0 §8.3.5.8 to §8.3.5.10).

Samples are opaque octets without an encapsulation header. Only the format DATA (one bare sample) is spoken: stock
clients send nothing else, and the genuine agent drops everything else.
"""

from __future__ import annotations

import struct
from typing import ClassVar, Self

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.cdr import CdrReader, CdrWriter
from msbot_xrce.messages.ids import SubmessageId
from msbot_xrce.messages.submessage import LITTLE_ENDIAN, MAX_LENGTH, frame

FORMAT_MASK = 0x0E
FORMAT_NAMES = {0x00: "DATA", 0x02: "SAMPLE", 0x08: "DATA_SEQ", 0x0A: "SAMPLE_SEQ", 0x0E: "PACKED_SAMPLES"}

_IDS = struct.Struct(">HH")
_DATA = struct.Struct("<BBHBBBB")


@dataclass(slots=True)
class WriteData:
    """A client writes a sample, a request or a reply (XRCE 1.0 §8.3.5.8); never answered."""

    ID: ClassVar[int] = SubmessageId.WRITE_DATA

    request_id: int
    object_id: int
    payload: bytes

    def encode(self) -> bytes:
        """The whole submessage; above 65531 octets its length is 0, and it must be the last of its message."""
        return _head(self.ID, len(self.payload) + 4, self.request_id, self.object_id) + self.payload

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: fewer than 4 octets (the genuine agent aborts), or a format other than DATA.
        """
        if flags & FORMAT_MASK or end - start < 4:
            raise _refused(end - start, flags)
        request_id, object_id = _IDS.unpack_from(packet, start)
        return cls(request_id, object_id, packet[start + 4 : end])


@dataclass(slots=True)
class Data:
    """The agent hands over a sample (XRCE 1.0 §8.3.5.10)."""

    ID: ClassVar[int] = SubmessageId.DATA

    request_id: int
    """The request id of the READ_DATA that asked for it."""
    object_id: int
    payload: bytes

    def encode(self) -> bytes:
        """The whole submessage; above 65531 octets its length is 0, and it must be the last of its message."""
        return _head(self.ID, len(self.payload) + 4, self.request_id, self.object_id) + self.payload

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: fewer than 4 octets, or a format other than DATA.
        """
        if flags & FORMAT_MASK or end - start < 4:
            raise _refused(end - start, flags)
        request_id, object_id = _IDS.unpack_from(packet, start)
        return cls(request_id, object_id, packet[start + 4 : end])


def _head(submessage_id: int, length: int, request_id: int, object_id: int) -> bytes:
    if length > MAX_LENGTH:
        # eProsima's way to exceed 64 KiB: length 0 means "to the end of the message" (seen on the wire).
        length = 0
    # One Struct for both headers: the ids are big endian, so they are packed octet by octet.
    return _DATA.pack(
        submessage_id, LITTLE_ENDIAN, length, request_id >> 8, request_id & 0xFF, object_id >> 8, object_id & 0xFF
    )


def _refused(length: int, flags: int) -> RemoteProtocolError:
    form = flags & FORMAT_MASK
    if form:
        words = FORMAT_NAMES.get(form, f"0x{form:02X}")
        return RemoteProtocolError(f"in format {words}: only DATA is spoken")
    return RemoteProtocolError(f"{length} bytes where 4 are needed")


@dataclass(frozen=True, slots=True)
class DeliveryControl:
    """How much a READ_DATA asks for (XRCE 1.0 §7.7.12)."""

    max_samples: int = 0xFFFF
    """0xFFFF = unlimited; 0 = stop reading."""
    max_elapsed_s: int = 0
    """Seconds; 0 = unlimited."""
    max_bytes_per_second: int = 0
    """0 = as fast as possible."""
    min_pace_ms: int = 0
    """Milliseconds between two samples; 0 = none."""


@dataclass(slots=True)
class ReadData:
    """A client asks for samples (XRCE 1.0 §8.3.5.9); answered by DATA, or by STATUS if it cannot be done."""

    ID: ClassVar[int] = SubmessageId.READ_DATA

    request_id: int
    object_id: int
    stream_id: int
    """Stream on which the samples should come."""
    delivery: DeliveryControl | None = None
    """None = exactly one sample."""
    data_format: int = 0
    content_filter: str | None = None

    def encode(self) -> bytes:
        """The whole submessage."""
        writer = CdrWriter()
        writer.octets(_IDS.pack(self.request_id, self.object_id))
        writer.u8(self.stream_id)
        writer.u8(self.data_format)
        writer.boolean(self.content_filter is not None)
        if self.content_filter is not None:
            writer.string(self.content_filter)
        writer.boolean(self.delivery is not None)
        if self.delivery is not None:
            control = self.delivery
            writer.u16(control.max_samples)
            writer.u16(control.max_elapsed_s)
            writer.u16(control.max_bytes_per_second)
            writer.u16(control.min_pace_ms)
        return frame(self.ID, writer.finish())

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: the octets do not make sense.
        """
        reader = CdrReader(packet, start, end, little_endian=bool(flags & LITTLE_ENDIAN))
        request_id, object_id = _IDS.unpack(reader.octets(4))
        stream_id = reader.u8()
        data_format = reader.u8()
        content_filter = reader.string() if reader.boolean() else None
        delivery = None
        if reader.boolean():
            delivery = DeliveryControl(reader.u16(), reader.u16(), reader.u16(), reader.u16())
        return cls(request_id, object_id, stream_id, delivery, data_format, content_filter)
