"""The messages of DDSI-RTPS 2.3 (§8.3, §9.4): what they are made of, and how they are written. Pure.

A datagram is a header and submessages. What a submessage is for (another participant, another time) is said by
submessages before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from struct import Struct

from msbot_xrce.lazy import dataclass

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
_SN = Struct("<iI")
_U32 = Struct("<I")
_PARAMETER = Struct("<HH")
_DATA = Struct("<HH4s4siI")
_FRAG = Struct("<IHHI")
_HEARTBEAT = Struct("<4s4siIiII")
_IDS = Struct("<4s4s")
IDENTITY = Struct("<16siI")
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
class RtpsData:
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
class RtpsHeartbeat:
    """What a writer has."""

    reader: EntityId
    writer: EntityId
    first: int
    last: int
    count: int
    final: bool


@dataclass(frozen=True, slots=True)
class NumberSet:
    """Sequence numbers, or numbers of fragments, from `base` on."""

    base: int
    set: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Gap:
    """NumberSet from `start` to before the base, and those of the set, that will not come."""

    reader: EntityId
    writer: EntityId
    start: int
    numbers: NumberSet


@dataclass(frozen=True, slots=True)
class AckNack:
    """A reader has everything below the base and asks for what is in the set."""

    reader: EntityId
    writer: EntityId
    numbers: NumberSet
    count: int
    final: bool


@dataclass(frozen=True, slots=True)
class NackFrag:
    """A reader asks for fragments of one sample."""

    reader: EntityId
    writer: EntityId
    number: int
    fragments: NumberSet
    count: int


Submessage = RtpsData | RtpsHeartbeat | Gap | AckNack | NackFrag


# Writing: always little endian.


def header(prefix: Prefix) -> bytes:
    """What every datagram of a participant begins with."""
    return b"RTPS" + PROTOCOL + VENDOR + prefix


def parameter(name: int, value: bytes) -> bytes:
    """One parameter, padded to a multiple of 4 octets."""
    padded = value + bytes(-len(value) & 3)
    return _PARAMETER.pack(name, len(padded)) + padded


END_OF_PARAMETERS = _PARAMETER.pack(SENTINEL, 0)


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
        identity = IDENTITY.pack(guid, number >> 32, number & 0xFFFFFFFF)
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
            _DATA.pack(0, 16, reader, writer, number >> 32, number & 0xFFFFFFFF) + beside + payload,
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
        _DATA.pack(0, 28, reader, writer, number >> 32, number & 0xFFFFFFFF)
        + _FRAG.pack(fragment, 1, FRAGMENT, len(payload))
        + beside
        + part,
    )


def heartbeat(beat: RtpsHeartbeat) -> bytes:
    """What a writer has."""
    return _sub(
        HEARTBEAT,
        2 if beat.final else 0,
        _HEARTBEAT.pack(
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
        + _U32.pack(said.count),
    )


def nack_frag(said: NackFrag) -> bytes:
    """Which fragments of a sample a reader misses."""
    base = said.fragments.base
    return _sub(
        NACK_FRAG,
        0,
        _IDS.pack(said.reader, said.writer)
        + _sn(said.number)
        + _U32.pack(base)
        + _set(base, said.fragments.set)
        + _U32.pack(said.count),
    )


_PAIR = Struct("<II")


def _sub(kind: int, flags: int, body: bytes) -> bytes:
    padding = -len(body) & 3
    size = len(body) + padding
    return _SUB.pack(kind, flags | _LITTLE, size) + body + bytes(padding)


def _sn(number: int) -> bytes:
    return _SN.pack(number >> 32, number & 0xFFFFFFFF)


def _set(base: int, numbers: Iterable[int]) -> bytes:
    offsets = [number - base for number in numbers if 0 <= number - base < MOST_BITS]
    count = max(offsets) + 1 if offsets else 0
    words = [0] * ((count + 31) // 32)
    for offset in offsets:
        words[offset // 32] |= 1 << (31 - offset % 32)
    return _U32.pack(count) + b"".join(_U32.pack(word) for word in words)
