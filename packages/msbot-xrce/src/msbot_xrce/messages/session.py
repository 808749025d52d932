"""Submessages about the session itself: logging in, asking for an agent, comparing clocks (XRCE 1.0 §8.3.5).

Every class here and in the sister files knows its id, encodes itself as a whole submessage (header and payload, little
endian, no padding after it) and decodes itself from `packet[start:end]`, the payload, given the flags of its header.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import ClassVar, Self

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.cdr import CdrReader, CdrWriter
from msbot_xrce.messages.ids import COOKIE, VENDOR, VERSION, ObjectKind, SubmessageId
from msbot_xrce.messages.submessage import LITTLE_ENDIAN, frame, need

_SECOND_NS = 1_000_000_000
_CREATE_CLIENT_LENGTH = 16
_LOGIN = struct.Struct(">4s2s2sIB")
_MTUS = (struct.Struct(">H"), struct.Struct("<H"))
_PLAIN_LOGIN_SIZE = _LOGIN.size + 3
"""Octets of a login without properties: an octet that says so, and the MTU, follow."""
_IDS = struct.Struct(">HH")
_MASKS = (struct.Struct(">I"), struct.Struct("<I"))
_TIMES = (struct.Struct(">iI"), struct.Struct("<iI"))
_TIME_OUT = struct.Struct("<II")


@dataclass(slots=True)
class CreateClient:
    """A client logs in (XRCE 1.0 §8.3.5.1); answered by STATUS_AGENT."""

    ID: ClassVar[int] = SubmessageId.CREATE_CLIENT

    client_key: int
    """Big-endian number of the four key octets; 0 is refused."""
    session_id: int
    """The session id that the client wants."""
    mtu: int
    """Largest message in octets, header included, that may be sent to the client (eProsima; at the very end)."""
    properties: tuple[tuple[str, str], ...] | None = None
    cookie: bytes = COOKIE
    version: bytes = VERSION
    vendor: bytes = VENDOR

    def encode(self) -> bytes:
        """The whole submessage; its length field is always 16, as C clients send it (seen on the wire)."""
        writer = CdrWriter()
        writer.octets(self.cookie + self.version + self.vendor + self.client_key.to_bytes(4, "big"))
        writer.u8(self.session_id)
        writer.boolean(self.properties is not None)
        if self.properties is not None:
            writer.u32(len(self.properties))
            for name, value in self.properties:
                writer.string(name)
                writer.string(value)
        writer.u16(self.mtu)
        header = bytes((self.ID, LITTLE_ENDIAN, _CREATE_CLIENT_LENGTH, 0))
        return header + writer.finish()

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: the octets do not make sense.
        """
        return cls.decode_by_content(packet, start, end, flags)[0]

    @classmethod
    def decode_by_content(cls, packet: bytes, start: int, end: int, flags: int) -> tuple[Self, int]:
        """Read it without trusting its length; returns the submessage and where it ends.

        C clients leave the properties out of the length (seen on the wire).

        Raises:
            RemoteProtocolError: the octets do not make sense.
        """
        if start + _PLAIN_LOGIN_SIZE <= end <= len(packet) and packet[start + _LOGIN.size] == 0:
            cookie, version, vendor, client_key, session_id = _LOGIN.unpack_from(packet, start)
            (mtu,) = _MTUS[flags & 1].unpack_from(packet, start + _LOGIN.size + 1)
            return cls(client_key, session_id, mtu, None, cookie, version, vendor), start + _PLAIN_LOGIN_SIZE
        reader = CdrReader(packet, start, end, little_endian=bool(flags & LITTLE_ENDIAN))
        cookie, version, vendor, client_key, session_id = _LOGIN.unpack(reader.octets(_LOGIN.size))
        properties = _read_properties(reader) if reader.boolean() else None
        mtu = reader.u16()
        return cls(client_key, session_id, mtu, properties, cookie, version, vendor), reader.offset


def _read_properties(reader: CdrReader) -> tuple[tuple[str, str], ...]:
    count = reader.u32()
    if count * 8 > reader.remaining:
        raise RemoteProtocolError(f"{count} properties do not fit {reader.remaining} bytes")
    return tuple((reader.string(), reader.string()) for _ in range(count))


@dataclass(slots=True)
class StatusAgent:
    """The agent's answer to a login (XRCE 1.0 §8.3.5.5, with eProsima's ResultStatus in front)."""

    ID: ClassVar[int] = SubmessageId.STATUS_AGENT

    status: int
    implementation_status: int = 0
    cookie: bytes = COOKIE
    version: bytes = VERSION
    vendor: bytes = VENDOR

    def encode(self) -> bytes:
        """The whole submessage."""
        status = bytes((self.status, self.implementation_status))
        return frame(self.ID, status + self.cookie + self.version + self.vendor + b"\0")

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:  # noqa: ARG003 - octets only
        """Read it from `packet[start:end]`; the agent's properties are ignored (as by C clients).

        Raises:
            RemoteProtocolError: the octets do not make sense.
        """
        need(start, end, 11)
        return cls(
            packet[start],
            packet[start + 1],
            packet[start + 2 : start + 6],
            packet[start + 6 : start + 8],
            packet[start + 8 : start + 10],
        )


@dataclass(slots=True)
class GetInfo:
    """Who are you? Ping, discovery, and the agent's probe of a silent client (XRCE 1.0 §8.3.5.3)."""

    ID: ClassVar[int] = SubmessageId.GET_INFO

    request_id: int
    object_id: int
    mask: int
    """1 = configuration, 2 = activity, 3 = both."""

    def encode(self) -> bytes:
        """The whole submessage."""
        return frame(self.ID, _IDS.pack(self.request_id, self.object_id) + _MASKS[1].pack(self.mask))

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: it is too short.
        """
        need(start, end, 8)
        request_id, object_id = _IDS.unpack_from(packet, start)
        return cls(request_id, object_id, _MASKS[flags & 1].unpack_from(packet, start + 4)[0])


class LocatorFormat(IntEnum):
    """How a transport address is written (XRCE 1.0 §7.7.11)."""

    SMALL = 0
    """2 octets address, 1 octet port."""
    MEDIUM = 1
    """IPv4 and port."""
    LARGE = 2
    """IPv6 and port."""
    STRING = 3


_ADDRESS_OCTETS = {LocatorFormat.SMALL: 2, LocatorFormat.MEDIUM: 4, LocatorFormat.LARGE: 16}


@dataclass(frozen=True, slots=True)
class Locator:
    """Where an agent can be reached."""

    format: LocatorFormat
    address: bytes
    """The octets of the address; for STRING the text as UTF-8."""
    port: int = 0

    @property
    def describe(self) -> str:
        """The address for a person, `127.0.0.1:2018`."""
        match self.format:
            case LocatorFormat.MEDIUM:
                return f"{'.'.join(map(str, self.address))}:{self.port}"
            case LocatorFormat.LARGE:
                return f"[{self.address.hex(':', 2)}]:{self.port}"
            case LocatorFormat.STRING:
                return self.address.decode(errors="replace")
        return f"{self.address.hex(' ')}:{self.port}"

    def write(self, writer: CdrWriter) -> None:
        """Append it."""
        writer.u8(self.format)
        match self.format:
            case LocatorFormat.SMALL:
                writer.octets(self.address)
                writer.u8(self.port)
            case LocatorFormat.MEDIUM:
                writer.octets(self.address)
                writer.u16(self.port)
            case LocatorFormat.LARGE:
                writer.octets(self.address)
                writer.u32(self.port)
            case LocatorFormat.STRING:
                writer.string(self.address.decode())

    @classmethod
    def read(cls, reader: CdrReader) -> Self:
        """Read one.

        Raises:
            RemoteProtocolError: an unknown format, or octets are missing.
        """
        number = reader.u8()
        if number == LocatorFormat.STRING:
            return cls(LocatorFormat.STRING, reader.string().encode())
        if number not in _ADDRESS_OCTETS:
            raise RemoteProtocolError(f"a locator of format {number}: 0 to 3 are known")
        locator_format = LocatorFormat(number)
        address = reader.octets(_ADDRESS_OCTETS[locator_format])
        match locator_format:
            case LocatorFormat.SMALL:
                return cls(locator_format, address, reader.u8())
            case LocatorFormat.MEDIUM:
                return cls(locator_format, address, reader.u16())
        return cls(locator_format, address, reader.u32())


@dataclass(slots=True)
class Info:
    """The answer to GET_INFO (XRCE 1.0 §8.3.5.7); configuration first, then activity, as eProsima sends them.

    Last submessage of its message: C clients do not read the locators, so they would misread whatever followed (seen on
    the wire).
    """

    ID: ClassVar[int] = SubmessageId.INFO

    request_id: int
    object_id: int
    status: int = 0
    implementation_status: int = 0
    """1: the agent knows a session of the asking address; 0: it does not (seen on the wire)."""
    has_agent: bool = True
    """Whether the agent's description (cookie, version, vendor) is there; a client's own answer leaves it out."""
    availability: int | None = 1
    """Above 0: the agent takes clients. None: no activity part."""
    locators: tuple[Locator, ...] = ()
    """Where the agent can be reached; only in answers to discovery."""
    version: bytes = VERSION
    vendor: bytes = VENDOR

    def encode(self) -> bytes:
        """The whole submessage."""
        writer = CdrWriter()
        writer.octets(_IDS.pack(self.request_id, self.object_id) + bytes((self.status, self.implementation_status)))
        writer.boolean(self.has_agent)
        if self.has_agent:
            writer.u8(ObjectKind.AGENT)
            writer.octets(COOKIE + self.version + self.vendor + b"\0")
        writer.boolean(self.availability is not None)
        if self.availability is not None:
            writer.u8(ObjectKind.AGENT)
            writer.i16(self.availability)
            writer.u32(len(self.locators))
            for locator in self.locators:
                locator.write(writer)
        return frame(self.ID, writer.finish())

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: the octets do not make sense, or it is about something other than an agent.
        """
        reader = CdrReader(packet, start, end, little_endian=bool(flags & LITTLE_ENDIAN))
        request_id, object_id = _IDS.unpack(reader.octets(4))
        info = cls(request_id, object_id, reader.u8(), reader.u8(), has_agent=reader.boolean(), availability=None)
        if info.has_agent:
            _need_agent(reader)
            reader.octets(4)
            info.version = reader.octets(2)
            info.vendor = reader.octets(2)
            if reader.boolean():
                _read_properties(reader)
        if reader.boolean():
            _need_agent(reader)
            info.availability = reader.i16()
            info.locators = _read_locators(reader)
        return info


def _need_agent(reader: CdrReader) -> None:
    kind = reader.u8()
    if kind != ObjectKind.AGENT:
        raise RemoteProtocolError(f"about kind 0x{kind:02X}: only agents are described (0x0D)")


def _read_locators(reader: CdrReader) -> tuple[Locator, ...]:
    count = reader.u32()
    if count * 4 > reader.remaining:
        raise RemoteProtocolError(f"{count} locators do not fit {reader.remaining} bytes")
    return tuple(Locator.read(reader) for _ in range(count))


@dataclass(slots=True)
class Timestamp:
    """The client's clock (XRCE 1.0 §8.3.5.15), in nanoseconds since 1970; answered by TIMESTAMP_REPLY."""

    ID: ClassVar[int] = SubmessageId.TIMESTAMP

    transmit_ns: int

    def encode(self) -> bytes:
        """The whole submessage."""
        return frame(self.ID, _pack_time(self.transmit_ns))

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: it is too short, or its nanoseconds are a second or more.
        """
        need(start, end, 8)
        return cls(_read_time(packet, start, flags))


@dataclass(slots=True)
class TimestampReply:
    """The agent's clock (XRCE 1.0 §8.3.5.16), in nanoseconds since 1970."""

    ID: ClassVar[int] = SubmessageId.TIMESTAMP_REPLY

    transmit_ns: int
    """When this reply was made."""
    receive_ns: int
    """When the request came; at most `transmit_ns`."""
    originate_ns: int
    """The client's time, as it was in the request."""

    def encode(self) -> bytes:
        """The whole submessage."""
        times = _pack_time(self.transmit_ns) + _pack_time(self.receive_ns) + _pack_time(self.originate_ns)
        return frame(self.ID, times)

    @classmethod
    def decode(cls, packet: bytes, start: int, end: int, flags: int) -> Self:
        """Read it from `packet[start:end]`.

        Raises:
            RemoteProtocolError: it is too short, or nanoseconds are a second or more.
        """
        need(start, end, 24)
        return cls(*(_read_time(packet, start + at, flags) for at in (0, 8, 16)))


def _pack_time(time_ns: int) -> bytes:
    seconds, nanoseconds = divmod(time_ns, _SECOND_NS)
    # The 32 bits of seconds wrap in 2038; both sides compute with differences, so wrapped times stay usable.
    return _TIME_OUT.pack(seconds & 0xFFFFFFFF, nanoseconds)


def _read_time(packet: bytes, offset: int, flags: int) -> int:
    seconds, nanoseconds = _TIMES[flags & 1].unpack_from(packet, offset)
    if nanoseconds >= _SECOND_NS:
        raise RemoteProtocolError(f"a time stamp with {nanoseconds} nanoseconds: a second has 10^9")
    return int(seconds * _SECOND_NS + nanoseconds)
