"""Octets of DDSI-RTPS to submessages (§8.3, §9.4). Pure. What makes no sense is refused whole."""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct
from struct import error as StructError

from msbot_agent.space.rtps.rtps_messages import (
    ACKNACK,
    ANYBODY,
    DATA,
    DATA_FRAG,
    GAP,
    HEADER_SIZE,
    HEARTBEAT,
    IDENTITY,
    INFO_DST,
    INFO_SRC,
    INFO_TS,
    KEY_HASH,
    MOST_BITS,
    NACK_FRAG,
    NOTHING,
    PAD,
    PROTOCOL,
    RELATED,
    RELATED_OF_FAST,
    SENTINEL,
    STATUS_INFO,
    AckNack,
    Gap,
    Inline,
    NackFrag,
    NumberSet,
    Prefix,
    RtpsData,
    RtpsHeartbeat,
    Submessage,
)
from msbot_xrce.errors import RemoteProtocolError

_SN = {True: Struct("<iI"), False: Struct(">iI")}
_U32 = {True: Struct("<I"), False: Struct(">I")}
_PARAMETER = {True: Struct("<HH"), False: Struct(">HH")}
_DATA = {True: Struct("<HH4s4siI"), False: Struct(">HH4s4siI")}
_FRAG = {True: Struct("<IHHI"), False: Struct(">IHHI")}
_HEARTBEAT = {True: Struct("<4s4siIiII"), False: Struct(">4s4siIiII")}
_IDS = Struct("<4s4s")
_LITTLE = 1


def read(datagram: bytes) -> tuple[Prefix, list[tuple[Prefix, Prefix, Submessage]]]:
    """Who sent a datagram, and its submessages: (on whose behalf, for whom, what).

    Raises:
        RemoteProtocolError: it is no RTPS, or of another major version, or it makes no sense.
    """
    if len(datagram) < HEADER_SIZE or datagram[:4] != b"RTPS" or datagram[4] != PROTOCOL[0]:
        raise RemoteProtocolError("no RTPS 2")
    source = sender = datagram[8:20]
    target, found, at = ANYBODY, [], HEADER_SIZE
    try:
        while at + 4 <= len(datagram):
            kind, flags, size = datagram[at], datagram[at + 1], 0
            little = bool(flags & _LITTLE)
            size = int.from_bytes(datagram[at + 2 : at + 4], "little" if little else "big")
            at += 4
            end = len(datagram) if size == 0 and kind not in (PAD, INFO_TS) else at + size
            if end > len(datagram):
                raise RemoteProtocolError(f"submessage {kind:#x} ends behind the datagram")
            body, at = datagram[at:end], end
            if kind == INFO_DST:
                target = _exactly(body, 12)
            elif kind == INFO_SRC:
                source = _exactly(body[8:], 12)
            else:
                made = _READ[kind](body, flags, little) if kind in _READ else None
                if made is not None:
                    found.append((source, target, made))
    except (StructError, IndexError) as error:
        raise RemoteProtocolError(f"a submessage is too short ({error})") from error
    return sender, found


def _exactly(octets: bytes, size: int) -> bytes:
    if len(octets) < size:
        raise RemoteProtocolError("a submessage is too short")
    return octets[:size]


def _number(high: int, low: int) -> int:
    return (high << 32) | low


def _data(body: bytes, flags: int, little: bool) -> RtpsData | None:
    _, to_inline, reader, writer, high, low = _DATA[little].unpack_from(body)
    inline, at = _inline(body, 4 + to_inline, little) if flags & 2 else (NOTHING, 4 + to_inline)
    if not flags & 0x0C:
        return RtpsData(reader, writer, _number(high, low), inline, b"")
    return RtpsData(reader, writer, _number(high, low), inline, body[at:], is_key=bool(flags & 8))


def _data_frag(body: bytes, flags: int, little: bool) -> RtpsData:
    _, to_inline, reader, writer, high, low = _DATA[little].unpack_from(body)
    first, count, each, size = _FRAG[little].unpack_from(body, 20)
    inline, at = _inline(body, 4 + to_inline, little) if flags & 2 else (NOTHING, 4 + to_inline)
    if not first or not count or not each or not size:
        raise RemoteProtocolError("a fragment of nothing")
    return RtpsData(reader, writer, _number(high, low), inline, body[at:], bool(flags & 4), first, count, each, size)


def _heartbeat(body: bytes, flags: int, little: bool) -> RtpsHeartbeat:
    reader, writer, high, low, last_high, last_low, count = _HEARTBEAT[little].unpack_from(body)
    first, last = _number(high, low), _number(last_high, last_low)
    if first < 1 or last < first - 1:
        raise RemoteProtocolError(f"a heartbeat from {first} to {last}")
    return RtpsHeartbeat(reader, writer, first, last, count, bool(flags & 2))


def _gap(body: bytes, _flags: int, little: bool) -> Gap:
    reader, writer = _IDS.unpack_from(body)
    start = _number(*_SN[little].unpack_from(body, 8))
    numbers, _ = _numbers(body, 16, little)
    if start < 1:
        raise RemoteProtocolError("a gap from 0 on")
    return Gap(reader, writer, start, numbers)


def _acknack(body: bytes, flags: int, little: bool) -> AckNack:
    reader, writer = _IDS.unpack_from(body)
    numbers, at = _numbers(body, 8, little)
    return AckNack(reader, writer, numbers, _U32[little].unpack_from(body, at)[0], bool(flags & 2))


def _nack_frag(body: bytes, _flags: int, little: bool) -> NackFrag:
    reader, writer = _IDS.unpack_from(body)
    number = _number(*_SN[little].unpack_from(body, 8))
    base = _U32[little].unpack_from(body, 16)[0]
    set_, at = _bits(body, 20, base, little)
    return NackFrag(reader, writer, number, NumberSet(base, set_), _U32[little].unpack_from(body, at)[0])


def _numbers(body: bytes, at: int, little: bool) -> tuple[NumberSet, int]:
    base = _number(*_SN[little].unpack_from(body, at))
    if base < 0:
        raise RemoteProtocolError("a sequence number below 0")
    set_, at = _bits(body, at + 8, base, little)
    return NumberSet(base, set_), at


def _bits(body: bytes, at: int, base: int, little: bool) -> tuple[tuple[int, ...], int]:
    count = _U32[little].unpack_from(body, at)[0]
    if count > MOST_BITS:
        raise RemoteProtocolError(f"a set of {count} numbers")
    words = (count + 31) // 32
    found = []
    for index in range(words):
        word = _U32[little].unpack_from(body, at + 4 + 4 * index)[0]
        if word:
            found += [base + 32 * index + bit for bit in range(32) if word >> (31 - bit) & 1]
    return tuple(number for number in found if number < base + count), at + 4 + 4 * words


def _inline(body: bytes, at: int, little: bool) -> tuple[Inline, int]:
    related, status, key = None, 0, b""
    for name, value, after in parameters(body, at, little):
        at = after
        if name in (RELATED, RELATED_OF_FAST) and len(value) >= IDENTITY.size:
            high, low = _SN[little].unpack_from(value, 16)
            related = value[:16], _number(high, low)
        elif name == STATUS_INFO and len(value) >= 4:
            status = value[3] & 3
        elif name == KEY_HASH:
            key = value[:16]
    return Inline(related, status, key), at


def parameters(octets: bytes, at: int, little: bool) -> Iterator[tuple[int, bytes, int]]:
    """A list of parameters up to its end: (number, value, where the next one begins).

    Raises:
        RemoteProtocolError: it has no end.
    """
    while at + 4 <= len(octets):
        name, size = _PARAMETER[little].unpack_from(octets, at)
        at += 4
        if name == SENTINEL:
            yield name, b"", at
            return
        if at + size > len(octets):
            break
        yield name, octets[at : at + size], at + size
        at += size
    raise RemoteProtocolError("a list of parameters without an end")


_READ = {
    DATA: _data,
    DATA_FRAG: _data_frag,
    HEARTBEAT: _heartbeat,
    GAP: _gap,
    ACKNACK: _acknack,
    NACK_FRAG: _nack_frag,
}
