"""Header compression: lossless, stateless.

Theory of operation. Given the CAN identifier pair, most of a message can be predicted: whose it is, that one submessage
fills it, and, if our own client chose it, the request id. The first octet of the short form, the *code*, says which
form it is; ordinary messages begin with a session id of 0x80 or more there, so they pass as they are. A form that is
still longer than one classic frame is then compressed by DEFLATE with a dictionary of what every robot says. A step
that does not apply is left out, so `decompress(compress(packet)) == packet` for all octets.

::

    code bit 7     1: an ordinary message, this is its session id
    code bit 6     session id: 0 = 0x81, 1 = 0x82
    code bit 5     stream: 0 = 0x01 (or none, from `ACKNACK` on), 1 = 0x80
    code bits 4-0  the form; docs/reference/can.md has the table
"""

from __future__ import annotations

import struct
import zlib
from typing import Final

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages.data import DeliveryControl, ReadData
from msbot_xrce.messages.ids import (
    COOKIE,
    OBJECT_AGENT,
    OBJECT_CLIENT,
    REQUEST_LOGOUT,
    REQUEST_NONE,
    REQUEST_PING,
    SESSION_DEFAULT,
    SESSION_NONE,
    STREAM_BEST_EFFORT,
    STREAM_NONE,
    STREAM_RELIABLE,
    VENDOR,
    VERSION,
    ObjectKind,
    SubmessageId,
    make_object_id,
    read_request_id,
    write_request_id,
)
from msbot_xrce.messages.message import Submessage
from msbot_xrce.messages.objects import Create, Delete, ObjectVariant, StatusReply
from msbot_xrce.messages.session import GetInfo, Info, StatusAgent
from msbot_xrce.messages.streams import Reset
from msbot_xrce.messages.submessage import HEADER_SIZE, LITTLE_ENDIAN, MAX_LENGTH, append_submessage
from msbot_xrce.objects.binary import (
    participant_variant,
    publisher_variant,
    reader_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)

# What both ends of header compression know in advance: the DEFLATE dictionary, and messages that never change.
#
# Part of the wire format: both ends must have the same octets, so the CRC-32 of the dictionary is given here and in
# docs/reference/can.md, and another dictionary would need a capability bit of its own. It holds only what every robot
# says, nothing specific to one of them: a part's first message (`msbot.part.Membership`), and the messages that create
# and read ports.


CHECK: Final = 0xE99DCCC5
"""CRC-32 of the dictionary."""

_PARTICIPANT = 0x0011
_SERVICE = requester_variant(
    "msbot_inventory",
    "msbot_inventory_request",
    "msbot_inventory_reply",
    "msbot_inventory_Request",
    "msbot_inventory_Reply",
    _PARTICIPANT,
)
_MASK_CONFIGURATION = 1
_MASK_ACTIVITY = 2


def _create(request_id: int, object_id: int, variant: ObjectVariant) -> Create:
    return Create(request_id, object_id, variant, reuse=True, replace=True)


def _read(object_id: int, stream_id: int) -> ReadData:
    return ReadData(read_request_id(object_id), object_id, stream_id, DeliveryControl())


_SET_UP: tuple[Submessage, ...] = (
    _create(10, 0x0011, participant_variant("")),
    _create(11, 0x0014, subscriber_variant(_PARTICIPANT)),
    _create(12, 0x0012, topic_variant("msbot_masterTopic", "msbot_master", _PARTICIPANT)),
    _create(13, 0x0016, reader_variant(0x0012, 0x0014)),
    _create(14, 0x0017, _SERVICE),
    _read(0x0016, STREAM_RELIABLE),
    _read(0x0017, STREAM_RELIABLE),
)
_PORTS: tuple[Submessage, ...] = (
    _create(15, 0x0022, topic_variant("/", "", _PARTICIPANT)),
    _create(16, 0x0013, publisher_variant(_PARTICIPANT)),
    _create(17, 0x0015, writer_variant(0x0022, 0x0013)),
    _create(18, 0x0032, topic_variant("/", "", _PARTICIPANT)),
    _create(19, 0x0026, reader_variant(0x0032, 0x0014)),
    _read(0x0017, STREAM_BEST_EFFORT),
    _read(0x0026, STREAM_RELIABLE),
)


def _join(submessages: tuple[Submessage, ...]) -> bytes:
    body = b""
    for submessage in submessages:
        body = append_submessage(body, submessage.encode())
    return body + bytes(-len(body) & 3)


DICTIONARY: Final = _join(_SET_UP) + _join(_PORTS)
"""504 octets."""

FIXED: Final = tuple(
    submessage.encode()
    for submessage in (
        StatusAgent(0),
        GetInfo(REQUEST_PING, OBJECT_AGENT, _MASK_ACTIVITY),
        Info(REQUEST_PING, OBJECT_AGENT, implementation_status=0),
        Info(REQUEST_PING, OBJECT_AGENT, implementation_status=1),
        GetInfo(REQUEST_NONE, OBJECT_CLIENT, _MASK_CONFIGURATION),
        Info(REQUEST_NONE, OBJECT_CLIENT, has_agent=False, availability=None),
        Delete(REQUEST_LOGOUT, OBJECT_CLIENT),
        StatusReply(REQUEST_LOGOUT, OBJECT_CLIENT, 0),
        Reset(),
    )
)
"""Messages outside streams that are always the same, without their header, by number."""


SECOND_SESSION: Final = 0x40
RELIABLE: Final = 0x20
FORM: Final = 0x1F

WRITER: Final = 0
"""To 7: WRITE_DATA of data writer 1 to 8 with the request id by rule."""
READER: Final = 8
"""To 15: DATA for data reader 1 to 8 with the request id by rule."""
REQUEST: Final = 16
"""And 17: WRITE_DATA of requester 1 and 2 with the request id by rule."""
REPLY: Final = 18
"""And 19: DATA for requester 1 and 2, all request ids by rule; zeros at the end left out."""
WRITE_DATA: Final = 20
DATA: Final = 21
STATUS: Final = 22
FRAGMENT: Final = 23
LAST_FRAGMENT: Final = 24
ON_STREAM: Final = 25
"""Any submessages on a stream."""
ACKNACK: Final = 26
HEARTBEAT: Final = 27
LOGIN: Final = 28
"""CREATE_CLIENT without properties."""
ALWAYS_THE_SAME: Final = 29
"""A message of `FIXED`, by number; with `OUTSIDE` for session id 0x80."""
NO_STREAM: Final = 30
"""Any submessages outside of streams."""

ESCAPE: Final = 0x1F
"""The message follows as it is; needed when its first octet is below 0x80."""
DEFLATED: Final = 0x5F
"""Another form follows, compressed by DEFLATE (RFC 1951, with `DICTIONARY` before it)."""
OUTSIDE: Final = 0x80

ONE_FRAME: Final = 7
"""Octets that one classic CAN frame carries; forms up to this length are not compressed by DEFLATE."""
LARGEST: Final = 1 << 16
"""Longer messages are not compressed by DEFLATE, and it never produces more octets than this."""

_SUBMESSAGE = struct.Struct("<BBH")
_IDS = struct.Struct(">HH")
_U16 = struct.Struct("<H")
_LAST = 0x02
_STATUS_LENGTH = 6
_REPORT_LENGTH = 5
_MOST_ZEROS = 3
"""Zeros that the REPLY form can leave out."""

_WRITE_DATA_ID = SubmessageId.WRITE_DATA.value
_DATA_ID = SubmessageId.DATA.value
_STATUS_ID = SubmessageId.STATUS.value
_FRAGMENT_ID = SubmessageId.FRAGMENT.value

_REPORT_HEADS = {
    ACKNACK: _SUBMESSAGE.pack(SubmessageId.ACKNACK, LITTLE_ENDIAN, _REPORT_LENGTH),
    HEARTBEAT: _SUBMESSAGE.pack(SubmessageId.HEARTBEAT, LITTLE_ENDIAN, _REPORT_LENGTH),
}
_LOGIN_HEAD = (
    bytes((SESSION_NONE, STREAM_NONE, 0, 0))
    + _SUBMESSAGE.pack(SubmessageId.CREATE_CLIENT, LITTLE_ENDIAN, 16)
    + COOKIE
    + VERSION
    + VENDOR
)
_LOGIN_SIZE = len(_LOGIN_HEAD) + 8
_NO_STREAM_HEAD = bytes(3)
_FIXED_NUMBERS = {body: number for number, body in enumerate(FIXED)}

_WRITE_FORMS = {make_object_id(1 + n, ObjectKind.DATAWRITER): WRITER + n for n in range(8)} | {
    make_object_id(1 + n, ObjectKind.REQUESTER): REQUEST + n for n in range(2)
}
_DATA_FORMS = {make_object_id(1 + n, ObjectKind.DATAREADER): READER + n for n in range(8)} | {
    make_object_id(1 + n, ObjectKind.REQUESTER): REPLY + n for n in range(2)
}
_OBJECTS = {form: object_id for object_id, form in (*_WRITE_FORMS.items(), *_DATA_FORMS.items())}

_DEFLATE = zlib.compressobj(9, zlib.DEFLATED, -13, 4, zlib.Z_FIXED, zdict=DICTIONARY)
"""A template, never used itself: copying it is three times as fast as making a new one."""


def compress(packet: bytes) -> bytes:
    """The shortest form of a message, or of any octets at all; never longer than the packet and one octet."""
    short = _shorten(packet)
    if ONE_FRAME < len(short) < LARGEST:
        squeezer = _DEFLATE.copy()
        squeezed = squeezer.compress(short) + squeezer.flush()
        if len(squeezed) + 1 < len(short):
            return bytes((DEFLATED,)) + squeezed
    return short


def decompress(data: bytes) -> bytes:
    """The message that `data` is a short form of.

    Raises:
        RemoteProtocolError: it is not a short form.
    """
    if data[:1] == b"\x5f":
        data = _inflate(data)
    if not data:
        raise RemoteProtocolError("compressed message: nothing in it")
    code = data[0]
    if code >= SESSION_NONE:
        return data
    if code == ESCAPE:
        return data[1:]
    form = code & FORM
    session_id = SESSION_DEFAULT + (code >> 6)
    if form <= ON_STREAM:
        return _expand_on_stream(form, session_id, STREAM_RELIABLE if code & RELIABLE else STREAM_BEST_EFFORT, data)
    if code & RELIABLE or form > NO_STREAM:
        raise RemoteProtocolError(f"compressed message: code 0x{code:02X} is not in use")
    return _expand_outside(form, session_id, data[1:])


def _shorten(packet: bytes) -> bytes:
    session_id = packet[0] if packet else 0
    if session_id < SESSION_NONE:
        return bytes((ESCAPE,)) + packet
    if len(packet) >= 2 * HEADER_SIZE:
        code = (session_id - SESSION_DEFAULT) << 6
        if session_id == SESSION_NONE:
            return _shorten_without_session(packet)
        if code <= SECOND_SESSION:
            stream_id = packet[1]
            if stream_id == STREAM_BEST_EFFORT:
                return _shorten_on_stream(packet, code, stream_id)
            if stream_id == STREAM_RELIABLE:
                return _shorten_on_stream(packet, code | RELIABLE, stream_id)
            if packet[1:4] == _NO_STREAM_HEAD:
                return _shorten_outside(packet, code)
    return packet


def _shorten_on_stream(packet: bytes, code: int, stream_id: int) -> bytes:
    kind, flags, length = _SUBMESSAGE.unpack_from(packet, 4)
    size = len(packet)
    end = 8 + length
    if kind == _WRITE_DATA_ID:
        # Clients pad to a multiple of 4, agents do not.
        if flags == LITTLE_ENDIAN and length >= 4 and size == (end + 3) & ~3 and packet[end:] == bytes(size - end):
            return _shorten_write(packet[:end], code, stream_id)
    elif end == size:
        if kind == _DATA_ID and flags == LITTLE_ENDIAN and length >= 4:
            return _shorten_data(packet, code)
        if kind == _STATUS_ID and flags == LITTLE_ENDIAN and length == _STATUS_LENGTH:
            return bytes((code | STATUS,)) + packet[2:4] + _shorten_status(packet)
        if kind == _FRAGMENT_ID and flags | _LAST == LITTLE_ENDIAN | _LAST:
            form = LAST_FRAGMENT if flags & _LAST else FRAGMENT
            return bytes((code | form, packet[2], packet[3])) + packet[8:]
    return bytes((code | ON_STREAM,)) + packet[2:]


def _shorten_write(packet: bytes, code: int, stream_id: int) -> bytes:
    request_id, object_id = _IDS.unpack_from(packet, 8)
    low, high = packet[2], packet[3]
    form = _WRITE_FORMS.get(object_id)
    if form is not None and request_id == write_request_id(stream_id, high << 8 | low):
        return bytes((code | form, low, high)) + packet[12:]
    return bytes((code | WRITE_DATA, low, high)) + packet[8:]


def _shorten_data(packet: bytes, code: int) -> bytes:
    request_id, object_id = _IDS.unpack_from(packet, 8)
    form = _DATA_FORMS.get(object_id)
    if form is not None and request_id == read_request_id(object_id):
        if form < REPLY:
            return bytes((code | form, packet[2], packet[3])) + packet[12:]
        # The request it answers comes first: its request id, and the requester once more.
        if len(packet) >= 16 and packet[12] >> 6 == 2 and packet[14:16] == packet[10:12]:
            body = packet[16:].rstrip(b"\0")
            zeros = min(len(packet) - 16 - len(body), _MOST_ZEROS)
            related = (packet[12] & 0x3F) << 8 | packet[13] | zeros << 14
            return bytes((code | form, packet[2], packet[3])) + _U16.pack(related) + packet[16 : len(packet) - zeros]
    return bytes((code | DATA, packet[2], packet[3])) + packet[8:]


def _shorten_status(packet: bytes) -> bytes:
    if packet[12] or packet[13]:
        return packet[8:]
    return packet[8:10] + packet[11:12] if packet[10] == 0 else packet[8:12]


def _shorten_outside(packet: bytes, code: int) -> bytes:
    if len(packet) == 8 + _REPORT_LENGTH:
        for form, head in _REPORT_HEADS.items():
            if packet[4:8] == head:
                return bytes((code | form,)) + _shorten_report(form, packet[8:])
    number = _FIXED_NUMBERS.get(packet[4:])
    if number is not None:
        return bytes((code | ALWAYS_THE_SAME, number))
    return bytes((code | NO_STREAM,)) + packet[4:]


def _shorten_report(form: int, report: bytes) -> bytes:
    if report[4] != STREAM_RELIABLE:
        return report
    expected = b"\0\0" if form == ACKNACK else report[:2]
    return report[:2] if report[2:4] == expected else report[:4]


def _shorten_without_session(packet: bytes) -> bytes:
    if len(packet) == _LOGIN_SIZE and packet.startswith(_LOGIN_HEAD) and packet[21] == 0:
        code = (packet[20] - SESSION_DEFAULT) << 6
        if code in (0, SECOND_SESSION):
            return bytes((code | LOGIN,)) + packet[16:20] + packet[22:]
    number = _FIXED_NUMBERS.get(packet[4:])
    if number is not None and packet[1:4] == _NO_STREAM_HEAD:
        return bytes((ALWAYS_THE_SAME, number | OUTSIDE))
    return packet


def _expand_on_stream(form: int, session_id: int, stream_id: int, data: bytes) -> bytes:
    if len(data) < 3:
        raise RemoteProtocolError("compressed message: without a sequence number")
    header = bytes((session_id, stream_id)) + data[1:3]
    if form == ON_STREAM:
        return header + data[3:]
    if form == STATUS:
        return header + _submessage(_STATUS_ID, _expand_status(data[3:]))
    if form == FRAGMENT:
        return header + _submessage(_FRAGMENT_ID, data[3:])
    if form == LAST_FRAGMENT:
        return header + _submessage(_FRAGMENT_ID, data[3:], LITTLE_ENDIAN | _LAST)
    kind = _DATA_ID if READER <= form < REQUEST or REPLY <= form < WRITE_DATA or form == DATA else _WRITE_DATA_ID
    if form >= WRITE_DATA:
        contents = data[3:]
        if len(contents) < 4:
            raise RemoteProtocolError("compressed message: a sample without ids")
    else:
        object_id = _OBJECTS[form]
        if kind == _WRITE_DATA_ID:
            contents = _IDS.pack(write_request_id(stream_id, data[1] | data[2] << 8), object_id) + data[3:]
        else:
            payload = data[3:] if form < REQUEST else _expand_reply(object_id, data)
            contents = _IDS.pack(read_request_id(object_id), object_id) + payload
    packet = header + _submessage(kind, contents)
    return packet if kind == _DATA_ID else packet + bytes(-len(packet) & 3)


def _expand_reply(object_id: int, data: bytes) -> bytes:
    if len(data) < 5:
        raise RemoteProtocolError("compressed message: a reply without its request")
    related = data[3] | data[4] << 8
    return _IDS.pack(0x8000 | related & 0x3FFF, object_id) + data[5:] + bytes(related >> 14)


def _expand_status(data: bytes) -> bytes:
    match len(data):
        case 3:
            return data[:2] + b"\0" + data[2:] + b"\0\0"
        case 4:
            return data + b"\0\0"
        case 6:
            return data
    raise RemoteProtocolError(f"compressed STATUS of {len(data)} bytes")


def _expand_outside(form: int, session_id: int, data: bytes) -> bytes:
    size = len(data)
    header = bytes((session_id,)) + _NO_STREAM_HEAD
    if form == NO_STREAM:
        return header + data
    if form == ALWAYS_THE_SAME:
        if size != 1 or data[0] & ~OUTSIDE >= len(FIXED):
            raise RemoteProtocolError(
                f"compressed message: no message has the number {data.hex() or 'that is missing'}"
            )
        first = bytes((SESSION_NONE,)) if data[0] & OUTSIDE else header[:1]
        return first + _NO_STREAM_HEAD + FIXED[data[0] & ~OUTSIDE]
    if form == LOGIN:
        if size != 6:
            raise RemoteProtocolError(f"compressed CREATE_CLIENT of {size} bytes")
        return _LOGIN_HEAD + data[:4] + bytes((session_id, 0)) + data[4:]
    if size not in (2, 4, 5):
        raise RemoteProtocolError(f"compressed {'ACKNACK' if form == ACKNACK else 'HEARTBEAT'} of {size} bytes")
    if size == 2:
        data += b"\0\0" if form == ACKNACK else data
    return header + _REPORT_HEADS[form] + data + (b"" if size == 5 else bytes((STREAM_RELIABLE,)))


def _submessage(kind: int, contents: bytes, flags: int = LITTLE_ENDIAN) -> bytes:
    if len(contents) > MAX_LENGTH:
        raise RemoteProtocolError(f"compressed message: a submessage of {len(contents)} bytes")
    return _SUBMESSAGE.pack(kind, flags, len(contents)) + contents


def _inflate(data: bytes) -> bytes:
    inflater = zlib.decompressobj(-13, zdict=DICTIONARY)
    try:
        short = inflater.decompress(data[1:], LARGEST)
    except zlib.error:
        raise RemoteProtocolError("compressed message: DEFLATE cannot read it") from None
    if not inflater.eof or inflater.unused_data:
        raise RemoteProtocolError("compressed message: it does not end where DEFLATE ends")
    if short[:1] == b"\x5f":
        raise RemoteProtocolError("compressed message: squeezed twice")
    return short
