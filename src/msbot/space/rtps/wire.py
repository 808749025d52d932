"""The messages of DDSI-RTPS 2.3 (§8.3, §9.4): octets to submessages and back. Pure.

A datagram is a header and submessages. What a submessage is for (another participant, another time) is said by
submessages before it. Whatever is not used here (security, batches of others) is skipped by its length.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from struct import Struct
from struct import error as StructError

from msbot.errors import RemoteProtocolError
from msbot.runtime.lazy_dataclass import dataclass

Prefix = bytes
"""The first 12 octets of a GUID: the participant."""
EntityId = bytes
"""The last 4 octets of a GUID: the writer or reader within the participant."""

PROTOCOL = b"\x02\x03"
VENDOR = b"\x00\x00"
"""No number has been assigned to MsBOT: the unknown vendor."""
NOBODY = bytes(4)
ANYBODY = bytes(12)
HEADER_SIZE = 20

MOST_BITS = 256
"""Sequence numbers that one ACKNACK or GAP can name."""
FRAGMENT = 1344
"""Octets of a sample in one DATA_FRAG; a datagram with it fits into an Ethernet frame."""
LARGEST_SAMPLE = 1 << 20
"""Octets of a request or reply; larger ones are refused."""

PAD, ACKNACK, HEARTBEAT, GAP, INFO_TS, INFO_SRC, INFO_DST = 0x01, 0x06, 0x07, 0x08, 0x09, 0x0C, 0x0E
NACK_FRAG, HEARTBEAT_FRAG, DATA, DATA_FRAG = 0x12, 0x13, 0x15, 0x16

SENTINEL, STATUS_INFO, KEY_HASH, RELATED, RELATED_OF_FAST = 0x0001, 0x0071, 0x0070, 0x0083, 0x800F
"""Parameters of inline QoS. Fast DDS had its own number for the related sample identity before DDS-RPC gave it one."""

_SUB = Struct("<BBH")
_SN = {True: Struct("<iI"), False: Struct(">iI")}
_U32 = {True: Struct("<I"), False: Struct(">I")}
_PARAMETER = {True: Struct("<HH"), False: Struct(">HH")}
_DATA = {True: Struct("<HH4s4siI"), False: Struct(">HH4s4siI")}
_FRAG = {True: Struct("<IHHI"), False: Struct(">IHHI")}
_HEARTBEAT = {True: Struct("<4s4siIiII"), False: Struct(">4s4siIiII")}
_IDS = Struct("<4s4s")
_IDENTITY = Struct("<16siI")
_LITTLE = 1


@dataclass(frozen=True, slots=True)
class Inline:
    """What travels beside the payload of a sample."""

    related: tuple[bytes, int] | None = None
    """For a reply the request that it answers; in a request of Fast DDS, the reader that awaits the reply."""
    status: int = 0
    """1: disposed, 2: unregistered."""
    key: bytes = b""


NOTHING = Inline()


@dataclass(frozen=True, slots=True)
class Data:
    """A sample, or a fragment of one."""

    reader: EntityId
    writer: EntityId
    number: int
    inline: Inline
    payload: bytes
    """With its encapsulation header; of a fragment, a part."""
    is_key: bool = False
    first: int = 0
    """The number of the first fragment; 0: it is whole."""
    fragments: int = 0
    fragment_size: int = 0
    size: int = 0


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """What a writer has."""

    reader: EntityId
    writer: EntityId
    first: int
    last: int
    count: int
    final: bool


@dataclass(frozen=True, slots=True)
class Numbers:
    """Sequence numbers, or numbers of fragments, from `base` on."""

    base: int
    set: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Gap:
    """Numbers from `start` to before the base, and those of the set, that will not come."""

    reader: EntityId
    writer: EntityId
    start: int
    numbers: Numbers


@dataclass(frozen=True, slots=True)
class AckNack:
    """A reader has everything below the base and asks for what is in the set."""

    reader: EntityId
    writer: EntityId
    numbers: Numbers
    count: int
    final: bool


@dataclass(frozen=True, slots=True)
class NackFrag:
    """A reader asks for fragments of one sample."""

    reader: EntityId
    writer: EntityId
    number: int
    fragments: Numbers
    count: int


Submessage = Data | Heartbeat | Gap | AckNack | NackFrag


# Reading.


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


def _data(body: bytes, flags: int, little: bool) -> Data | None:
    _, to_inline, reader, writer, high, low = _DATA[little].unpack_from(body)
    inline, at = _inline(body, 4 + to_inline, little) if flags & 2 else (NOTHING, 4 + to_inline)
    if not flags & 0x0C:
        return Data(reader, writer, _number(high, low), inline, b"")
    return Data(reader, writer, _number(high, low), inline, body[at:], is_key=bool(flags & 8))


def _data_frag(body: bytes, flags: int, little: bool) -> Data:
    _, to_inline, reader, writer, high, low = _DATA[little].unpack_from(body)
    first, count, each, size = _FRAG[little].unpack_from(body, 20)
    inline, at = _inline(body, 4 + to_inline, little) if flags & 2 else (NOTHING, 4 + to_inline)
    if not first or not count or not each or not size:
        raise RemoteProtocolError("a fragment of nothing")
    return Data(reader, writer, _number(high, low), inline, body[at:], bool(flags & 4), first, count, each, size)


def _heartbeat(body: bytes, flags: int, little: bool) -> Heartbeat:
    reader, writer, high, low, last_high, last_low, count = _HEARTBEAT[little].unpack_from(body)
    first, last = _number(high, low), _number(last_high, last_low)
    if first < 1 or last < first - 1:
        raise RemoteProtocolError(f"a heartbeat from {first} to {last}")
    return Heartbeat(reader, writer, first, last, count, bool(flags & 2))


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
    return NackFrag(reader, writer, number, Numbers(base, set_), _U32[little].unpack_from(body, at)[0])


def _numbers(body: bytes, at: int, little: bool) -> tuple[Numbers, int]:
    base = _number(*_SN[little].unpack_from(body, at))
    if base < 0:
        raise RemoteProtocolError("a sequence number below 0")
    set_, at = _bits(body, at + 8, base, little)
    return Numbers(base, set_), at


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
        if name in (RELATED, RELATED_OF_FAST) and len(value) >= _IDENTITY.size:
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


# Writing: always little endian.


def header(prefix: Prefix) -> bytes:
    """What every datagram of a participant begins with."""
    return b"RTPS" + PROTOCOL + VENDOR + prefix


def parameter(name: int, value: bytes) -> bytes:
    """One parameter, padded to a multiple of 4 octets."""
    padded = value + bytes(-len(value) & 3)
    return _PARAMETER[True].pack(name, len(padded)) + padded


END_OF_PARAMETERS = _PARAMETER[True].pack(SENTINEL, 0)


def info_dst(prefix: Prefix) -> bytes:
    """What follows is for that participant."""
    return _sub(INFO_DST, 0, prefix)


def info_ts(epoch_ns: int) -> bytes:
    """What follows was written at that time."""
    seconds, rest = divmod(epoch_ns, 1_000_000_000)
    return _sub(INFO_TS, 0, _PAIR.pack(seconds & 0xFFFFFFFF, (rest << 32) // 1_000_000_000))


def inline_octets(inline: Inline) -> bytes:
    """Inline QoS as a list of parameters; nothing if there is none."""
    found = b""
    if inline.related is not None:
        guid, number = inline.related
        identity = _IDENTITY.pack(guid, number >> 32, number & 0xFFFFFFFF)
        found += parameter(RELATED_OF_FAST, identity) + parameter(RELATED, identity)
    if inline.status:
        found += parameter(KEY_HASH, inline.key) + parameter(STATUS_INFO, bytes((0, 0, 0, inline.status)))
    return found + END_OF_PARAMETERS if found else b""


def data(reader: EntityId, writer: EntityId, number: int, inline: Inline, payload: bytes) -> Iterator[bytes]:
    """A sample as one submessage, or as fragments; the payload of one that is disposed is its key."""
    beside = inline_octets(inline)
    flags = 2 if beside else 0
    if len(payload) <= FRAGMENT:
        yield _sub(
            DATA,
            flags | (8 if inline.status else 4),
            _DATA[True].pack(0, 16, reader, writer, number >> 32, number & 0xFFFFFFFF) + beside + payload,
        )
        return
    for index in range(-(-len(payload) // FRAGMENT)):
        yield data_frag(reader, writer, number, beside, payload, index + 1)


def data_frag(  # noqa: PLR0917 - the fields in the order of the standard
    reader: EntityId, writer: EntityId, number: int, beside: bytes, payload: bytes, fragment: int
) -> bytes:
    """One fragment of a sample, counted from 1."""
    part = payload[(fragment - 1) * FRAGMENT : fragment * FRAGMENT]
    return _sub(
        DATA_FRAG,
        2 if beside else 0,
        _DATA[True].pack(0, 28, reader, writer, number >> 32, number & 0xFFFFFFFF)
        + _FRAG[True].pack(fragment, 1, FRAGMENT, len(payload))
        + beside
        + part,
    )


def heartbeat(beat: Heartbeat) -> bytes:
    """What a writer has."""
    return _sub(
        HEARTBEAT,
        2 if beat.final else 0,
        _HEARTBEAT[True].pack(
            beat.reader,
            beat.writer,
            beat.first >> 32,
            beat.first & 0xFFFFFFFF,
            beat.last >> 32,
            beat.last & 0xFFFFFFFF,
            beat.count,
        ),
    )


def gap(reader: EntityId, writer: EntityId, start: int, base: int, more: Iterable[int] = ()) -> bytes:
    """The numbers from `start` to before `base`, and `more` behind it, will not come."""
    return _sub(GAP, 0, _IDS.pack(reader, writer) + _sn(start) + _sn(base) + _set(base, more))


def acknack(said: AckNack) -> bytes:
    """What a reader has and misses."""
    numbers = said.numbers
    return _sub(
        ACKNACK,
        2 if said.final else 0,
        _IDS.pack(said.reader, said.writer)
        + _sn(numbers.base)
        + _set(numbers.base, numbers.set)
        + _U32[True].pack(said.count),
    )


def nack_frag(said: NackFrag) -> bytes:
    """Which fragments of a sample a reader misses."""
    base = said.fragments.base
    return _sub(
        NACK_FRAG,
        0,
        _IDS.pack(said.reader, said.writer)
        + _sn(said.number)
        + _U32[True].pack(base)
        + _set(base, said.fragments.set)
        + _U32[True].pack(said.count),
    )


_PAIR = Struct("<II")


def _sub(kind: int, flags: int, body: bytes) -> bytes:
    padding = -len(body) & 3
    size = len(body) + padding
    return _SUB.pack(kind, flags | _LITTLE, size) + body + bytes(padding)


def _sn(number: int) -> bytes:
    return _SN[True].pack(number >> 32, number & 0xFFFFFFFF)


def _set(base: int, numbers: Iterable[int]) -> bytes:
    offsets = [number - base for number in numbers if 0 <= number - base < MOST_BITS]
    count = max(offsets) + 1 if offsets else 0
    words = [0] * ((count + 31) // 32)
    for offset in offsets:
        words[offset // 32] |= 1 << (31 - offset % 32)
    return _U32[True].pack(count) + b"".join(_U32[True].pack(word) for word in words)
