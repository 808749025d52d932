"""The protocol between programs on a simulated bus and the one that serves it: short messages over TCP.

Each message is 2 octets of length (little endian), 1 octet of kind, and its fields. One connection is one controller.
It sends `Hello` and gets `Welcome` or `Refused`. Then it sends `BusFrame`s, and gets a `FrameSent` or `FrameRejected`
for each, the frames of others, its state, and the number of frames it lost because it did not read. Times are those of
the computer's monotonic clock, in seconds.
"""

from __future__ import annotations

import struct
from typing import Final

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame, check_frame
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

VERSION: Final = 1
MAX_MESSAGE: Final = 512
"""Largest message in octets, not counting its length field."""
MAX_WORDS: Final = 400
"""Longest text in a message, in octets."""

_MAGIC = b"MsSB"
_LENGTH = struct.Struct("<H")
_HELLO = struct.Struct("<4sBB16s")
_WELCOME = struct.Struct("<BBII")
_FRAME = struct.Struct("<IdIBB")
_SENT = struct.Struct("<Id")
_TAG = struct.Struct("<I")
_STATE = struct.Struct("<dBHH")

_LISTEN_ONLY, _CLASSIC = 1, 2
_EXTENDED, _FD, _BRS, _REMOTE, _ESI = 1, 2, 4, 8, 16
_STATES = (BusState.ACTIVE, BusState.PASSIVE, BusState.OFF)


@dataclass(frozen=True, slots=True)
class Hello:
    """First message of a program."""

    key: bytes
    """16 octets, from the file of the bus."""
    name: str
    """The controller's name, for people."""
    listen_only: bool = False
    """Whether it neither sends nor acknowledges."""
    classic: bool = False
    """Whether the controller lacks CAN FD."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """The program is on the bus."""

    bitrate: int
    data_bitrate: int | None
    fd: bool


@dataclass(frozen=True, slots=True)
class Refused:
    """The program is not on the bus; the connection ends."""

    words: str


@dataclass(slots=True)
class BusFrame:
    """A frame to be sent, or one that was received."""

    frame: Frame
    tag: int = 0
    """Chosen by the sender; returned in `FrameSent` or `FrameRejected`."""
    at: float = 0.0
    """End of a frame that was received."""


@dataclass(frozen=True, slots=True)
class FrameSent:
    """A frame was acknowledged and has left the controller."""

    tag: int
    at: float


@dataclass(frozen=True, slots=True)
class FrameRejected:
    """The controller did not accept a frame."""

    tag: int
    words: str


@dataclass(frozen=True, slots=True)
class StateTold:
    """The controller's fault confinement state has changed."""

    state: BusState
    at: float
    transmit_errors: int
    receive_errors: int
    words: str


@dataclass(frozen=True, slots=True)
class FramesLost:
    """This many frames could not be handed over because the program did not read."""

    count: int


@dataclass(frozen=True, slots=True)
class Restart:
    """The program wants its controller back on the bus after bus-off."""


Message = Hello | Welcome | Refused | BusFrame | FrameSent | FrameRejected | StateTold | FramesLost | Restart

_KINDS: Final = (Hello, Welcome, Refused, BusFrame, FrameSent, FrameRejected, StateTold, FramesLost, Restart)
_NUMBERS: Final = {kind: number for number, kind in enumerate(_KINDS, 1)}


def encode(message: Message) -> bytes:
    """A message as it is sent.

    Raises:
        LocalProtocolError: a key that is not 16 octets.
    """
    body = _body(message)
    return _LENGTH.pack(len(body) + 1) + bytes((_NUMBERS[type(message)],)) + body


class Splitter:
    """Splits the octets of one connection into messages."""

    def __init__(self) -> None:
        """Start empty."""
        self._buffer = bytearray()

    def receive(self, data: bytes) -> list[Message]:
        """Take octets as they come; returns the messages they complete.

        Raises:
            RemoteProtocolError: they make no sense; the connection cannot be used any more.
        """
        try:
            return self._take(data)
        except RemoteProtocolError:
            self._buffer.clear()
            raise

    def _take(self, data: bytes) -> list[Message]:
        buffer = self._buffer
        buffer += data
        messages: list[Message] = []
        start = 0
        while len(buffer) - start >= _LENGTH.size:
            (size,) = _LENGTH.unpack_from(buffer, start)
            if not 1 <= size <= MAX_MESSAGE:
                raise RemoteProtocolError("message of an impossible length")
            if len(buffer) - start < _LENGTH.size + size:
                break
            start += _LENGTH.size
            messages.append(decode(bytes(buffer[start : start + size])))
            start += size
        del buffer[:start]
        return messages


def decode(octets: bytes) -> Message:
    """Decode a message without its length: kind and fields.

    Raises:
        RemoteProtocolError: it is not a message.
    """
    if not octets or not 1 <= octets[0] <= len(_KINDS):
        raise RemoteProtocolError("message of an unknown kind")
    kind, body = _KINDS[octets[0] - 1], octets[1:]
    try:
        return _read(kind, body)
    except (struct.error, UnicodeDecodeError, IndexError):
        raise RemoteProtocolError(f"{kind.__name__} message that makes no sense") from None
    except LocalProtocolError as error:
        raise RemoteProtocolError(f"impossible frame: {error}") from None


def _body(message: Message) -> bytes:
    match message:
        case BusFrame():
            return _frame_body(message)
        case FrameSent():
            return _SENT.pack(message.tag, message.at)
        case Hello():
            if len(message.key) != 16:
                raise LocalProtocolError(f"the key of a bus has 16 bytes, not {len(message.key)}")
            flags = message.listen_only * _LISTEN_ONLY | message.classic * _CLASSIC
            return _HELLO.pack(_MAGIC, VERSION, flags, message.key) + _text(message.name)
        case Welcome():
            return _WELCOME.pack(VERSION, message.fd, message.bitrate, message.data_bitrate or 0)
        case Refused():
            return _text(message.words)
        case FrameRejected():
            return _TAG.pack(message.tag) + _text(message.words)
        case StateTold():
            counters = min(message.transmit_errors, 0xFFFF), min(message.receive_errors, 0xFFFF)
            return _STATE.pack(message.at, _STATES.index(message.state), *counters) + _text(message.words)
        case FramesLost():
            return _TAG.pack(min(message.count, 0xFFFFFFFF))
        case Restart():
            return b""


def _frame_body(message: BusFrame) -> bytes:
    frame = message.frame
    flags = frame.extended * _EXTENDED | frame.fd * _FD | frame.brs * _BRS | frame.remote * _REMOTE | frame.esi * _ESI
    code = frame.remote_length | frame.long_dlc << 4
    return _FRAME.pack(message.tag, message.at, frame.can_id, flags, code) + frame.data


def _read(kind: type[Message], body: bytes) -> Message:
    if kind is BusFrame:
        return _read_frame(body)
    if kind is FrameSent:
        return FrameSent(*_SENT.unpack(body))
    if kind is Hello:
        magic, version, flags, key = _HELLO.unpack_from(body)
        if magic != _MAGIC:
            raise RemoteProtocolError("Hello of another protocol")
        if version != VERSION:
            raise RemoteProtocolError(f"Hello of version {version}, here it is {VERSION}")
        name = _words(body[_HELLO.size :])
        return Hello(key, name, bool(flags & _LISTEN_ONLY), bool(flags & _CLASSIC))
    if kind is Welcome:
        version, fd, bitrate, data_bitrate = _WELCOME.unpack(body)
        if version != VERSION or not bitrate:
            raise RemoteProtocolError(f"Welcome of version {version}, here it is {VERSION}")
        return Welcome(bitrate, data_bitrate or None, bool(fd))
    if kind is Refused:
        return Refused(_words(body))
    if kind is FrameRejected:
        (tag,) = _TAG.unpack_from(body)
        return FrameRejected(tag, _words(body[_TAG.size :]))
    if kind is StateTold:
        at, state, transmit, receive = _STATE.unpack_from(body)
        return StateTold(_STATES[state], at, transmit, receive, _words(body[_STATE.size :]))
    if kind is FramesLost:
        return FramesLost(*_TAG.unpack(body))
    return Restart()


def _read_frame(body: bytes) -> BusFrame:
    tag, at, can_id, flags, code = _FRAME.unpack_from(body)
    frame = Frame(
        can_id,
        body[_FRAME.size :],
        bool(flags & _EXTENDED),
        bool(flags & _FD),
        bool(flags & _BRS),
        bool(flags & _REMOTE),
        esi=bool(flags & _ESI),
        remote_length=code & 0x0F,
        long_dlc=code >> 4,
    )
    check_frame(frame)
    return BusFrame(frame, tag, at)


def _text(words: str) -> bytes:
    return words.encode()[:MAX_WORDS]


def _words(octets: bytes) -> str:
    return octets.decode(errors="ignore")
