"""What a relay and a master say to each other: packets of parts in envelopes, and a few words about the relay. Pure.

Every message begins with three octets that no message of DDS-XRCE has: session id 0 is for messages outside of
sessions, and those are never on a reliable stream. Numbers are big-endian.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final

from msbot_agent.text.sentence import printable
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass

MARK: Final = b"\x00\xffR"
"""How every message between a relay and a master begins."""
VERSION: Final = 1
BOOT_SIZE: Final = 8
"""Octets that tell one start of a relay from all others."""
ENVELOPE: Final = 8
"""Octets that carrying a packet to a part takes."""
MOST_WORDS: Final = 120
"""Octets of a text in a message; longer ones are cut off."""
MOST_EVENTS: Final = 16
"""Parts that came back or went in one beat; further ones are in the next."""
MOST_ROOMS: Final = 100


class RelayKind(IntEnum):
    """The fourth octet."""

    HELLO = 1
    UP = 2
    BEAT = 3
    ROOM = 4
    BYE = 5
    WELCOME = 17
    DOWN = 18
    HEARD = 19
    WHO = 20
    REFUSED = 21


class RelayEventKind(IntEnum):
    """What has happened to a part at the relay's link."""

    GONE = 1
    BACK = 2
    CAME = 3


@dataclass(frozen=True, slots=True)
class Hello:
    """A relay introduces itself, with every beat until it is welcomed."""

    boot: bytes
    name: str
    carried: str
    """Name of the link whose parts it carries."""
    mtu: int
    bits_per_second: int
    """0 = fast."""
    shared_bus: bool
    compresses: bool


@dataclass(frozen=True, slots=True)
class Up:
    """A packet from a part."""

    number: int
    words: str
    """Where the part is, in words; empty once the master has answered."""
    packet: bytes


@dataclass(frozen=True, slots=True)
class Event:
    """A part has come, gone, or is back."""

    number: int
    what: RelayEventKind
    words: str


@dataclass(frozen=True, slots=True)
class RelayBeat:
    """The relay is alive; repeats what the master has not confirmed."""

    count: int
    stops_said: int
    """Which STOP somebody said on the relay's link, counted from 1; 0 = none that the master has not confirmed."""
    words: str
    """The reason for the latest, in words."""
    events: tuple[Event, ...] = ()


@dataclass(frozen=True, slots=True)
class Room:
    """How far the relay has passed packets on: (part, number of its latest packet)."""

    handled: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Bye:
    """The relay ends."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """The master takes that relay; `stops` counts from here."""

    boot: bytes
    profile_hash: int
    stops: int


@dataclass(frozen=True, slots=True)
class Down:
    """A packet for a part; packets for it are counted modulo 65536."""

    number: int
    count: int
    packet: bytes


@dataclass(frozen=True, slots=True)
class Heard:
    """The master's answer to a beat; sent unasked, too, when somebody says STOP."""

    count: int
    """That of the beat."""
    stops_said: int
    """The latest that the master has heard of there."""
    stops: int
    """How often the master has said STOP."""
    reason: int
    """The reason of the latest, as on a CAN bus."""


@dataclass(frozen=True, slots=True)
class Who:
    """The master does not know who sends this: say HELLO."""


@dataclass(frozen=True, slots=True)
class Refused:
    """The master does not take the relay, and why."""

    words: str


Message = Hello | Up | RelayBeat | Room | Bye | Welcome | Down | Heard | Who | Refused

_HELLO = struct.Struct(f">B{BOOT_SIZE}sIIB")
_UP = struct.Struct(">HB")
_DOWN = struct.Struct(">HH")
_BEAT = struct.Struct(">HHBB")
_EVENT = struct.Struct(">HBB")
_ROOM = struct.Struct(">HH")
_WELCOME = struct.Struct(f">{BOOT_SIZE}sIH")
_HEARD = struct.Struct(">HHHB")
_HEAD = len(MARK) + 1


def encode(message: Message) -> bytes:
    """A message as octets."""
    match message:
        case Up(number, words, packet):
            text = _octets(words)
            return _head(RelayKind.UP) + _UP.pack(number, len(text)) + text + packet
        case Down(number, count, packet):
            return _head(RelayKind.DOWN) + _DOWN.pack(number, count) + packet
        case Hello():
            flags = message.shared_bus | message.compresses << 1
            fixed = _HELLO.pack(VERSION, message.boot, message.mtu, message.bits_per_second, flags)
            return _head(RelayKind.HELLO) + fixed + _text(message.name) + _text(message.carried)
        case RelayBeat(count, stops_said, words, events):
            text = _octets(words)
            octets = _head(RelayKind.BEAT) + _BEAT.pack(count, stops_said, len(text), len(events)) + text
            for event in events:
                text = _octets(event.words)
                octets += _EVENT.pack(event.number, event.what, len(text)) + text
            return octets
        case Room(handled):
            return _head(RelayKind.ROOM) + b"".join(_ROOM.pack(*one) for one in handled)
        case Welcome(boot, profile_hash, stops):
            return _head(RelayKind.WELCOME) + _WELCOME.pack(boot, profile_hash, stops)
        case Heard(count, stops_said, stops, reason):
            return _head(RelayKind.HEARD) + _HEARD.pack(count, stops_said, stops, reason)
        case Refused(words):
            return _head(RelayKind.REFUSED) + _text(words)
        case Bye():
            return _head(RelayKind.BYE)
        case Who():
            return _head(RelayKind.WHO)


def decode(octets: bytes) -> Message:
    """Read a message.

    Raises:
        RemoteProtocolError: it is not one.
    """
    try:
        return _decode(octets)
    except (struct.error, IndexError, ValueError) as error:
        raise RemoteProtocolError(f"relay message of {len(octets)} bytes cannot be read: {error}") from None


def _decode(octets: bytes) -> Message:
    if octets[: len(MARK)] != MARK:
        raise ValueError("it does not begin like one")
    match RelayKind(octets[len(MARK)]):
        case RelayKind.UP:
            number, size = _UP.unpack_from(octets, _HEAD)
            start = _HEAD + _UP.size + size
            if start >= len(octets):
                raise ValueError("there is no packet in it")
            return Up(number, _words(octets[_HEAD + _UP.size : start]), octets[start:])
        case RelayKind.DOWN:
            number, count = _DOWN.unpack_from(octets, _HEAD)
            return Down(number, count, octets[_HEAD + _DOWN.size :])
        case RelayKind.HELLO:
            return _hello(octets)
        case RelayKind.BEAT:
            return _beat(octets)
        case RelayKind.ROOM:
            if (len(octets) - _HEAD) % _ROOM.size or len(octets) > _HEAD + MOST_ROOMS * _ROOM.size:
                raise ValueError("a length that no report has")
            return Room(tuple(_ROOM.iter_unpack(octets[_HEAD:])))
        case RelayKind.WELCOME:
            return Welcome(*_WELCOME.unpack_from(octets, _HEAD))
        case RelayKind.HEARD:
            return Heard(*_HEARD.unpack_from(octets, _HEAD))
        case RelayKind.REFUSED:
            return Refused(_read_text(octets, _HEAD)[0])
        case RelayKind.BYE:
            return Bye()
        case RelayKind.WHO:
            return Who()


def _hello(octets: bytes) -> Hello:
    version, boot, mtu, bits_per_second, flags = _HELLO.unpack_from(octets, _HEAD)
    if version != VERSION:
        raise ValueError(f"version {version} is not {VERSION}")
    name, end = _read_text(octets, _HEAD + _HELLO.size)
    carried, _ = _read_text(octets, end)
    if not name or not carried:
        raise ValueError("a relay has a name")
    return Hello(boot, name, carried, mtu, bits_per_second, bool(flags & 1), bool(flags & 2))


def _beat(octets: bytes) -> RelayBeat:
    count, stops_said, size, many = _BEAT.unpack_from(octets, _HEAD)
    at = _HEAD + _BEAT.size + size
    words = _read_words(octets, at - size, at)
    events = []
    for _ in range(min(many, MOST_EVENTS)):
        number, what, size = _EVENT.unpack_from(octets, at)
        at += _EVENT.size + size
        events.append(Event(number, RelayEventKind(what), _read_words(octets, at - size, at)))
    return RelayBeat(count, stops_said, words, tuple(events))


def _head(kind: RelayKind) -> bytes:
    return MARK + bytes((kind,))


def _octets(words: str) -> bytes:
    return words.encode()[:MOST_WORDS]


def _text(words: str) -> bytes:
    octets = _octets(words)
    return bytes((len(octets),)) + octets


def _read_text(octets: bytes, at: int) -> tuple[str, int]:
    end = at + 1 + octets[at]
    return _read_words(octets, at + 1, end), end


def _read_words(octets: bytes, start: int, end: int) -> str:
    if end > len(octets):
        raise ValueError("a text is cut off")
    return _words(octets[start:end])


def _words(octets: bytes) -> str:
    """A text from the network, fit to be shown: no control characters."""
    return printable(octets[:MOST_WORDS].decode(errors="replace"))
