"""Header compression on CAN: shortens a message and restores it (docs/reference/can.md, "Header compression").

Exact and without memory: `decompress(compress(packet)) == packet` for all octets. It reads all forms, and writes those
that matter to a part: samples, requests, acknowledgements, logins. It reads forms compressed by DEFLATE; of its own
messages it deflates only the longest, a part's first, which is always the same.
"""

import struct

from micropython import const

from .errors import RemoteProtocolError
from .running import load, once
from .xrce import BEST_EFFORT, RELIABLE, submessage

_ESCAPE = const(0x1F)
_DEFLATED = const(0x5F)
_OFTEN = const(32)  # uses, after which the module that squeezes is not forgotten any more
_LOGIN_HEAD = b"\x80\0\0\0\0\1\x10\0XRCE\1\0\1\x0f"


_FIRST_SIZE = const(320)  # octets of a part's first message on a shared bus (`squeeze`)
_uses = 0
_INFO = b"\x06\x01\x1c\x00\x00\x0a\xff\xfd\x00%c\x01\x0dXRCE\x01\x00\x01\x0f\x00\x01\x0d\x00\x01\x00" + bytes(6)
FIXED = (
    b"\x04\x01\x0b\x00\x00\x00XRCE\x01\x00\x01\x0f\x00",
    b"\x02\x01\x08\x00\x00\x0a\xff\xfd\x02\x00\x00\x00",
    _INFO.replace(b"%c", b"\x00"),
    _INFO.replace(b"%c", b"\x01"),
    b"\x02\x01\x08\x00\x00\x00\xff\xfe\x01\x00\x00\x00",
    b"\x06\x01\x08\x00\x00\x00\xff\xfe\x00\x00\x00\x00",
    b"\x03\x01\x04\x00\x00\x02\xff\xfe",
    b"\x05\x01\x06\x00\x00\x02\xff\xfe\x00\x00",
    b"\x0c\x01\x00\x00",
)
"""Messages outside streams that are always the same, by number."""


def compress(packet):
    """A short form of a message; never longer than the packet and one octet."""
    session = packet[0] if packet else 0
    if session < 0x80:
        return bytes((_ESCAPE,)) + packet
    if len(packet) < 8 or session > 0x82 or packet[1] not in (0, BEST_EFFORT, RELIABLE):
        return packet
    code = 0x40 if session == 0x82 else 0
    if packet[1] == 0:
        return _shorten_outside(packet, code, packet[4:]) if packet[2:4] == b"\0\0" else packet
    if session == 0x80:
        return packet
    code |= 0x20 if packet[1] == RELIABLE else 0
    kind, flags, length, request_id, object_id = struct.unpack("<BBH", packet[4:8]) + _ids(packet)
    end = 8 + length
    ruled = (0xA000 if code & 0x20 else 0x8000) | (packet[2] | packet[3] << 8) & 0x1FFF
    is_whole = length >= 4 and len(packet) == end + 3 & ~3 and not any(packet[end:])
    if kind == 7 and flags == 1 and is_whole and request_id == ruled and object_id >> 4:
        number = (object_id >> 4) - 1
        if (object_id & 15 == 5 and number < 8) or (object_id & 15 == 7 and number < 2):
            form = number if object_id & 15 == 5 else 16 + number
            return bytes((code | form,)) + packet[2:4] + packet[12:end]
    code |= 25
    return _squeeze().first(packet, code) if len(packet) == _FIRST_SIZE else bytes((code,)) + packet[2:]


def _ids(packet):
    return struct.unpack(">HH", packet[8:12]) if len(packet) >= 12 else (0, 0)


def _shorten_outside(packet, code, body):
    if packet[:16] == _LOGIN_HEAD and len(packet) == 24 and packet[20] in (0x81, 0x82) and packet[21] == 0:
        return bytes(((packet[20] - 0x81) << 6 | 28,)) + packet[16:20] + packet[22:]
    if body in FIXED:
        return bytes((code | 29, FIXED.index(body) | (0x80 if packet[0] == 0x80 else 0)))
    if packet[0] == 0x80:
        return packet
    if len(body) == 9 and body[:4] in (b"\x0a\1\5\0", b"\x0b\1\5\0") and body[8] == RELIABLE:
        expected = b"\0\0" if body[0] == 0x0A else body[4:6]
        return bytes((code | body[0] + 16,)) + (body[4:6] if body[6:8] == expected else body[4:8])
    return bytes((code | 30,)) + body


def decompress(data):
    """The message that `data` is a short form of; raises RemoteProtocolError when it is not one."""
    if data[:1] == b"\x5f":
        data = _squeeze().inflate(data[1:])
    code = data[0] if data else _DEFLATED
    if code >= 0x80:
        return data
    if code == _ESCAPE:
        return data[1:]
    form, session = code & 0x1F, 0x81 + (code >> 6)
    if form <= 25 and len(data) >= 3:
        return _expand_on_stream(form, bytes((session, RELIABLE if code & 0x20 else BEST_EFFORT)) + data[1:3], data[3:])
    if form > 30 or form <= 25 or code & 0x20:
        raise RemoteProtocolError("compressed message: code 0x{:02X} is not in use".format(code))
    return _expand_outside(form, session, data[1:])


def _need(condition):
    if not condition:
        raise RemoteProtocolError("compressed message: the bytes do not fit their form")


def _expand_on_stream(form, header, data):
    if form == 25:
        return header + data
    if form >= 23:
        return header + submessage(13, data, 3 if form == 24 else 1)
    if form == 22:
        _need(len(data) in (3, 4, 6))
        status = data[:2] + b"\0" + data[2:] if len(data) == 3 else data
        return header + submessage(5, status + bytes(6 - len(status)))
    if form >= 20:
        _need(len(data) >= 4)
        object_id = 0
    elif form >= 16:
        object_id = (form & 1) + 1 << 4 | 7
    else:
        object_id = (form & 7) + 1 << 4 | (5 if form < 8 else 6)
    is_data = 8 <= form < 16 or form in (18, 19, 21)
    if form in (18, 19):
        _need(len(data) >= 2)
        related = data[0] | data[1] << 8
        data = struct.pack(">HH", 0x8000 | related & 0x3FFF, object_id) + data[2:] + bytes(related >> 14)
    if object_id:
        ruled = (0xA000 if header[1] == RELIABLE else 0x8000) | (header[2] | header[3] << 8) & 0x1FFF
        data = struct.pack(">HH", 0xC000 | object_id if is_data else ruled, object_id) + data
    packet = header + submessage(9 if is_data else 7, data)
    return packet if is_data else packet + bytes(-len(packet) & 3)


def _expand_outside(form, session, data):
    size = len(data)
    header = bytes((session, 0, 0, 0))
    if form == 30:
        return header + data
    if form == 29:
        _need(size == 1 and data[0] & 0x7F < len(FIXED))
        return (b"\x80\0\0\0" if data[0] & 0x80 else header) + FIXED[data[0] & 0x7F]
    if form == 28:
        _need(size == 6)
        return _LOGIN_HEAD + data[:4] + bytes((session, 0)) + data[4:]
    _need(size in (2, 4, 5))
    if size == 2:
        data += b"\0\0" if form == 26 else data
    return header + bytes((form - 16, 1, 5, 0)) + data + (b"" if size == 5 else b"\x80")


def _squeeze():
    """The module that squeezes, which is seldom needed: for a part's first message, and configurations."""
    global _uses  # noqa: PLW0603 - of all parts of a board
    _uses += 1
    return load("squeeze") if _uses > _OFTEN else once("squeeze")
