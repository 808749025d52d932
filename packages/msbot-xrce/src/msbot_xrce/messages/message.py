"""Messages: a header and one or more submessages (XRCE 1.0 §8.3.2).

One packet is one message. Each submessage begins at a multiple of 4; its length field is always little endian, its
payload has the byte order its flag gives. The genuine peers do not use the length to find the next submessage. It is
used here, so that unknown submessages can be skipped, with two exceptions for the sake of stock clients:

* CREATE_CLIENT is read by its contents: C clients leave the properties out of the length;
* WRITE_DATA of length 0 reaches to the end of the message: eProsima's way to carry more than 64 KiB. Between our own
  peers DATA does the same.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from typing import Final, TypeAlias

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.data import Data, DeliveryControl, ReadData, WriteData
from msbot_xrce.messages.ids import COOKIE, SESSION_NONE, SubmessageId
from msbot_xrce.messages.objects import Create, Delete, ObjectVariant, StatusReply
from msbot_xrce.messages.session import (
    CreateClient,
    GetInfo,
    Info,
    Locator,
    LocatorFormat,
    StatusAgent,
    Timestamp,
    TimestampReply,
)
from msbot_xrce.messages.streams import Acknack, Fragment, Heartbeat, Reset
from msbot_xrce.messages.submessage import HEADER_SIZE, locate

__all__ = [
    "Acknack",
    "Create",
    "CreateClient",
    "Data",
    "Delete",
    "DeliveryControl",
    "Fragment",
    "GetInfo",
    "Header",
    "Heartbeat",
    "Info",
    "Locator",
    "LocatorFormat",
    "ObjectVariant",
    "ReadData",
    "Reset",
    "StatusAgent",
    "StatusReply",
    "Submessage",
    "Timestamp",
    "TimestampReply",
    "WriteData",
    "decode_header",
    "encode_message",
    "first_submessage",
    "is_whole",
    "iter_submessages",
]

Submessage: TypeAlias = (
    CreateClient
    | Create
    | GetInfo
    | Delete
    | StatusAgent
    | StatusReply
    | Info
    | WriteData
    | ReadData
    | Data
    | Acknack
    | Heartbeat
    | Reset
    | Fragment
    | Timestamp
    | TimestampReply
)

_HEADER = struct.Struct("<BBH")

_CREATE_CLIENT = int(CreateClient.ID)

_Decode: TypeAlias = Callable[[bytes, int, int, int], Submessage]
_DECODERS: dict[int, _Decode] = {
    Create.ID: Create.decode,
    GetInfo.ID: GetInfo.decode,
    Delete.ID: Delete.decode,
    StatusAgent.ID: StatusAgent.decode,
    StatusReply.ID: StatusReply.decode,
    Info.ID: Info.decode,
    WriteData.ID: WriteData.decode,
    ReadData.ID: ReadData.decode,
    Data.ID: Data.decode,
    Acknack.ID: Acknack.decode,
    Heartbeat.ID: Heartbeat.decode,
    Reset.ID: Reset.decode,
    Fragment.ID: Fragment.decode,
    Timestamp.ID: Timestamp.decode,
    TimestampReply.ID: TimestampReply.decode,
}


@dataclass(slots=True)
class Header:
    """The first 4 or 8 octets of a message."""

    session_id: int
    stream_id: int = 0
    sequence_nr: int = 0
    client_key: int | None = None
    """Present in the octets exactly if the session id is below 0x80."""

    @property
    def size(self) -> int:
        """Its octets, 4 or 8: where the first submessage begins."""
        return 8 if self.session_id < SESSION_NONE else 4

    def encode(self) -> bytes:
        """Its octets; a missing key counts as 0."""
        octets = _HEADER.pack(self.session_id, self.stream_id, self.sequence_nr)
        return octets + (self.client_key or 0).to_bytes(4, "big") if self.session_id < SESSION_NONE else octets


def decode_header(packet: bytes) -> Header:
    """Read the header of a message.

    Raises:
        RemoteProtocolError: fewer than 4 octets, or fewer than 8 where the header has a client key.
    """
    if len(packet) < 4:
        raise RemoteProtocolError(f"a message of {len(packet)} bytes: the header alone has 4")
    session_id, stream_id, sequence_nr = _HEADER.unpack_from(packet)
    if session_id >= SESSION_NONE:
        return Header(session_id, stream_id, sequence_nr)
    if len(packet) < 8:
        raise RemoteProtocolError(f"a message of {len(packet)} bytes: the header with client key has 8")
    return Header(session_id, stream_id, sequence_nr, int.from_bytes(packet[4:8], "big"))


def iter_submessages(packet: bytes, offset: int) -> Iterator[Submessage]:
    """Yield the submessages from `offset` on (`Header.size`; 0 for rejoined fragments), in order.

    Unknown ones are skipped, and so are up to 3 octets of padding at the end.

    Raises:
        RemoteProtocolError: at the first one that makes no sense; the earlier ones have been yielded by then.
    """
    return (submessage for submessage, _ in located_submessages(packet, offset) if submessage is not None)


def first_submessage(packet: bytes, offset: int) -> Submessage | None:
    """The first one that `iter_submessages` would yield; None: there is none.

    Raises:
        RemoteProtocolError: it, or one before it, makes no sense.
    """
    start = offset + HEADER_SIZE
    if start <= len(packet) and packet[offset] == _CREATE_CLIENT:
        try:
            return CreateClient.decode_by_content(packet, start, len(packet), packet[offset + 1])[0]
        except RemoteProtocolError as error:
            raise RemoteProtocolError(f"{_name(_CREATE_CLIENT)}: {error}") from None
    return next(iter_submessages(packet, offset), None)


def located_submessages(packet: bytes, offset: int) -> Iterator[tuple[Submessage | None, int]]:
    """Like `iter_submessages`, but with the end of each, and None for an unknown one."""
    size = len(packet)
    start = offset + HEADER_SIZE
    while start <= size:
        kind, flags, end = locate(packet, start)
        submessage: Submessage | None = None
        try:
            if kind == _CREATE_CLIENT:
                submessage, end = CreateClient.decode_by_content(packet, start, size, flags)
            elif end > size:
                raise RemoteProtocolError(f"{end - start} bytes announced where {size - start} are left")
            elif (decode := _DECODERS.get(kind)) is not None:
                submessage = decode(packet, start, end, flags)
        except RemoteProtocolError as error:
            raise RemoteProtocolError(f"{_name(kind)}: {error}") from None
        yield submessage, end
        start = (end + 7) & ~3


def _name(submessage_id: int) -> str:
    known = submessage_id in _DECODERS or submessage_id == _CREATE_CLIENT
    return SubmessageId(submessage_id).name if known else f"submessage 0x{submessage_id:02X}"


def encode_message(header: Header, submessages: Iterable[Submessage], *, pad_end: bool) -> bytes:
    """The octets of a message; `pad_end` pads the last submessage to a multiple of 4, too.

    Agents do not pad the end; C clients pad what they send on a stream (seen on the wire). Every peer accepts both.
    """
    packet = bytearray(header.encode())
    for submessage in submessages:
        packet += bytes(-len(packet) & 3)
        packet += submessage.encode()
    if pad_end:
        packet += bytes(-len(packet) & 3)
    return bytes(packet)


# Tells a whole message from one that lost its beginning or its end, for framings that cannot (the CAN framing of the
# thesis' firmware has neither a length nor a checksum).


HEADERLESS_ANSWER: Final = 12
"""Octets of a C client's answer to GET_INFO, which has no submessage header (seen on the wire)."""


def is_whole(packet: bytes) -> bool:
    """Whether the octets are exactly one message, without a client key in its header.

    Its submessages are all known, make sense and fill it to the last octet. This is never true of a message of up to 32
    KiB that lost its first 7 octets: the rest begins with the high half of a length, which is not a session id.
    """
    if len(packet) < 2 * HEADER_SIZE or packet[0] < SESSION_NONE:
        return False
    if len(packet) == HEADERLESS_ANSWER and not any(packet[6:]):
        return True
    end = HEADER_SIZE
    try:
        for submessage, end in located_submessages(packet, HEADER_SIZE):  # noqa: B007 - the last one counts
            if submessage is None or (isinstance(submessage, CreateClient) and submessage.cookie != COOKIE):
                return False
    except RemoteProtocolError:
        return False
    return (end + 3) & ~3 >= len(packet)
