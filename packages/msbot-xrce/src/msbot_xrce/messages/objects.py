"""Submessages that create, delete and answer for objects (XRCE 1.0 §8.3.5.2, §8.3.5.4, §8.3.5.6)."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import ClassVar, Self

from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.cdr import CdrReader, CdrWriter
from msbot_xrce.messages.ids import Format, ObjectKind, SubmessageId
from msbot_xrce.messages.submessage import LITTLE_ENDIAN, frame, need

REUSE = 0x02
REPLACE = 0x04

_IDS = struct.Struct(">HH")
_STATUS = struct.Struct(">BBHHHBB")
_STATUS_PAYLOAD = struct.Struct(">HHBB")
_STATUS_ID = SubmessageId.STATUS.value

_WITH_PARENT = frozenset(range(ObjectKind.TOPIC, ObjectKind.REPLIER + 1))
_WITHOUT_REFERENCE = (ObjectKind.PUBLISHER, ObjectKind.SUBSCRIBER)
_DESCRIBED_ONLY = (ObjectKind.TYPE, ObjectKind.QOSPROFILE, ObjectKind.APPLICATION)


@dataclass(frozen=True, slots=True)
class ObjectVariant:
    """The description of an object in a CREATE, not parsed yet: `parse_variant` does that."""

    kind: int
    """What to create; the kind in the object id does not count (seen on the wire)."""
    format: int
    """1 reference, 2 XML, 3 binary; others have no contents and cannot be parsed."""
    text: str | None = None
    """The reference or the XML."""
    blob: bytes | None = None
    """The binary form: CDR of its own, in the byte order of the CREATE."""
    parent_id: int = 0
    """Publisher of a writer, subscriber of a reader, participant of all others."""
    domain_id: int = 0
    """Domain of a participant; 255 = the agent's own."""

    def write(self, writer: CdrWriter) -> None:
        """Append it."""
        writer.u8(self.kind)
        writer.u8(self.format)
        if self.text is not None:
            writer.string(self.text)
        elif self.blob is not None:
            writer.octet_sequence(self.blob)
        if self.kind == ObjectKind.PARTICIPANT:
            writer.i16(self.domain_id)
        elif self.kind in _WITH_PARENT:
            writer.octets(self.parent_id.to_bytes(2, "big"))

    @classmethod
    def read(cls, reader: CdrReader) -> Self:
        """Read one; kinds that cannot be created (agent, client, unknown ones) have no contents.

        Raises:
            RemoteProtocolError: the octets do not make sense.
        """
        kind = reader.u8()
        described = kind == ObjectKind.PARTICIPANT or kind in _WITH_PARENT
        if not described and kind not in _DESCRIBED_ONLY:
            return cls(kind, 0)
        form = reader.u8()
        text = blob = None
        if form == Format.XML or (form == Format.REFERENCE and kind not in _WITHOUT_REFERENCE):
            text = reader.string()
        elif form == Format.BINARY and described:
            blob = reader.octet_sequence()
        parent_id = domain_id = 0
        if kind == ObjectKind.PARTICIPANT:
            domain_id = reader.i16()
        elif described:
            parent_id = int.from_bytes(reader.octets(2), "big")
        return cls(kind, form, text, blob, parent_id, domain_id)


KEPT = 256
"""Descriptions that are read once: parts of one kind, and parts that come again, describe their objects alike."""

KEPT_OCTETS = 1024
"""Longer descriptions are read each time."""


def _read_variant(octets: bytes, little_endian: bool) -> ObjectVariant:
    return ObjectVariant.read(CdrReader(octets, little_endian=little_endian))


_kept_variant = lru_cache(KEPT)(_read_variant)


@dataclass(slots=True)
class Create:
    """A client wants an object (XRCE 1.0 §8.3.5.2); answered by STATUS."""

    ID: ClassVar[int] = SubmessageId.CREATE

    request_id: int
    object_id: int
    variant: ObjectVariant
    reuse: bool = False
    """An equal object with this id may stay (OK_MATCHED)."""
    replace: bool = False
    """A different object with this id may be deleted."""
    little_endian: bool = True
    """Byte order of the submessage, and with it of the variant's blob."""

    def encode(self) -> bytes:
        """The whole submessage, in its own byte order."""
        writer = CdrWriter(self.little_endian)
        writer.octets(_IDS.pack(self.request_id, self.object_id))
        self.variant.write(writer)
        flags = int(self.little_endian) | (REUSE if self.reuse else 0) | (REPLACE if self.replace else 0)
        return frame(self.ID, writer.finish(), flags)

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: the octets do not make sense.
        """
        request_id, object_id, variant = read_create(packet, start, end, flags)
        reuse, replace = bool(flags & REUSE), bool(flags & REPLACE)
        return cls(request_id, object_id, variant, reuse, replace, bool(flags & LITTLE_ENDIAN))


def read_create(packet: bytes, start: int, end: int, flags: int) -> tuple[int, int, ObjectVariant]:
    """Request id, object id and description of a `Create` in `packet[start:end]`.

    Raises:
        RemoteProtocolError: the octets do not make sense.
    """
    if end - start < 5:
        need(start, end, 5)
    request_id, object_id = _IDS.unpack_from(packet, start)
    read = _kept_variant if end - start <= KEPT_OCTETS else _read_variant
    return request_id, object_id, read(packet[start + 4 : end], flags & LITTLE_ENDIAN != 0)


@dataclass(slots=True)
class Delete:
    """A client wants an object gone, or with `OBJECT_CLIENT` leaves itself (XRCE 1.0 §8.3.5.4); answered by STATUS."""

    ID: ClassVar[int] = SubmessageId.DELETE

    request_id: int
    object_id: int

    def encode(self) -> bytes:
        """The whole submessage."""
        return frame(self.ID, _IDS.pack(self.request_id, self.object_id))

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:  # noqa: ARG003 - octets only
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: it is too short.
        """
        need(start, end, 4)
        request_id, object_id = _IDS.unpack_from(packet, start)
        return cls(request_id, object_id)


@dataclass(slots=True)
class StatusReply:
    """How a request ended (XRCE 1.0 §8.3.5.6); the ids are those of the request."""

    ID: ClassVar[int] = SubmessageId.STATUS

    request_id: int
    object_id: int
    status: int
    implementation_status: int = 0

    def encode(self) -> bytes:
        """The whole submessage."""
        return write_status(self.request_id, self.object_id, self.status, self.implementation_status)

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:  # noqa: ARG003 - octets only
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: it is too short.
        """
        need(start, end, 6)
        return cls(*_STATUS_PAYLOAD.unpack_from(packet, start))


def write_status(request_id: int, object_id: int, status: int, implementation_status: int = 0) -> bytes:
    """The whole submessage of a `StatusReply`, without creating an object for each."""
    return _STATUS.pack(_STATUS_ID, LITTLE_ENDIAN, 0x0600, request_id, object_id, status, implementation_status)
