"""CAN frames, and how a whole packet travels in them: cut by `split`, put together by `FrameJoiner`.

Theory of operation. Byte 0 of every data frame is the segment header: S (first frame), E (last frame) and a 6-bit
counter `q` that continues across messages, per node and direction. A message of several frames ends with one check byte
over the whole message. CAN delivers the frames of one sender in order and acknowledges each, so nothing is repeated
here: a gap makes the receiver forget the message, count why, and start again at the next S. The reliable streams of
DDS-XRCE above repair losses, which is why this is not ISO-TP and needs no flow-control frame.

Classic CAN carries 7 data bytes a frame and no padding. CAN FD carries up to 63; since an FD frame can only have
certain lengths, a last frame longer than 8 bytes says after the header how many data bytes it holds
(docs/reference/can.md).
"""

from __future__ import annotations

from msbot_xrce.counting import Tally
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.lazy import dataclass

FIRST = 0x80
"""Segment header bit S: first frame of a message."""
LAST = 0x40
"""Segment header bit E: last frame of a message."""
COUNTER = 0x3F
"""Segment header bits of the frame counter."""

MTU = 4096
"""Largest packet in bytes that both ends accept by default."""
TIMEOUT_S = 0.25
"""Longest pause between two frames of one message."""
REPEAT_S = 0.005
"""A frame equal to one heard within this time, fewer than 64 frames ago, is CAN's own repetition. Shorter than 64 full
frames on any real bus (7.1 ms at 1 Mbit/s classic), so it cannot be a new frame whose counter has wrapped."""

FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Data lengths a CAN FD frame can have, by data length code (ISO 11898-1:2015 table 5)."""

EMPTY_FRAME = "frame without a segment header"
FRAME_LOST = "a frame of the message is missing"
MESSAGE_LOST = "frames are missing between two messages"
NO_FIRST_FRAME = "message without its first frame"
UNFINISHED = "a new message began before the last was complete"
WRONG_CHECK_BYTE = "check byte is wrong"
TOO_LONG = "message is longer than the link allows"
TOO_SLOW = "too long a pause inside a message"
WRONG_LENGTH = "length byte does not fit the frame"
EMPTY_MESSAGE = "message without content"
REPEATED = "frame repeated by the bus"

_FD_SLOT = tuple(min(length for length in FD_LENGTHS if length >= size) for size in range(65))
_HEADERS = tuple(bytes((value,)) for value in range(256))


@dataclass(slots=True)
class Frame:
    """One CAN frame as a controller takes or gives it."""

    can_id: int
    """11 bits, or 29 when `extended`."""
    data: bytes = b""
    """0 to 8 bytes; with `fd` a length of `FD_LENGTHS`."""
    extended: bool = False
    fd: bool = False
    brs: bool = False
    """The data phase is sent at the data bit rate (FD only)."""
    remote: bool = False
    """Remote transmission request; carries no data."""
    error: bool = False
    """A report of the controller about a bus error, not a frame from the bus."""
    esi: bool = False
    """Error state indicator: the transmitter was error-passive (FD only)."""
    remote_length: int = 0
    """Bytes that a remote frame asks for, 0 to 8."""
    long_dlc: int = 0
    """Data length code 9 to 15 of a classic frame, which still means 8 bytes; 0 = the length itself."""


def check_frame(frame: Frame) -> None:
    """Make sure that a controller could send this frame.

    Raises:
        LocalProtocolError: it could not; the text says why.
    """
    limit = 0x1FFFFFFF if frame.extended else 0x7FF
    if not 0 <= frame.can_id <= limit:
        raise LocalProtocolError(f"CAN identifier {frame.can_id:#x} is outside 0 to {limit:#x}")
    if frame.error:
        raise LocalProtocolError("an error report is not a frame that can be sent")
    if frame.remote and (frame.fd or frame.data or not 0 <= frame.remote_length <= 8):
        raise LocalProtocolError("a remote frame is classic, carries no data and asks for 0 to 8 bytes")
    if frame.fd:
        if len(frame.data) not in FD_LENGTHS:
            raise LocalProtocolError(f"a CAN FD frame cannot carry {len(frame.data)} bytes: pad it with `pad_fd`")
    elif len(frame.data) > 8:
        raise LocalProtocolError(f"a classic CAN frame carries at most 8 bytes, not {len(frame.data)}")
    elif frame.brs or frame.esi:
        raise LocalProtocolError("only CAN FD frames have a bit-rate switch and an error state indicator")
    if frame.long_dlc:
        length = frame.remote_length if frame.remote else len(frame.data)
        if frame.fd or length != 8 or not 9 <= frame.long_dlc <= 15:
            raise LocalProtocolError("a data length code of 9 to 15 for 8 bytes is for classic frames of 8 bytes")


def pad_fd(data: bytes, fill: bytes = b"\0") -> bytes:
    """Pad data to the next length that a CAN FD frame can have.

    Raises:
        LocalProtocolError: more than 64 bytes.
    """
    if len(data) > 64:
        raise LocalProtocolError(f"a CAN FD frame carries at most 64 bytes, not {len(data)}")
    return data + fill * (_FD_SLOT[len(data)] - len(data))


def check_byte(message: bytes) -> int:
    """CRC-8/AUTOSAR of the message: polynomial 0x2F, initial and final 0xFF (check value 0xDF).

    The polynomial is (x + 1) times a primitive one of degree 7, so x^127 = 1 and blocks of 127 bytes may be added (XOR)
    before the division: that limits the loop below to 127 steps.
    """
    crc = 0xFF
    if len(message) > 127:
        # Blocks are aligned at the end of the message; the first, which takes the initial value, may be shorter.
        head = len(message) % 127 or 127
        total = int.from_bytes(message[:head], "big") ^ (0xFF << (8 * head - 8))
        for start in range(head, len(message), 127):
            total ^= int.from_bytes(message[start : start + 127], "big")
        message = total.to_bytes(127, "big")
        crc = 0
    table = _CHECK_TABLE
    for octet in message:
        crc = table[crc ^ octet]
    return crc ^ 0xFF


def split(packet: bytes, q: int, fd: bool) -> list[bytes]:
    """Cut a packet into the data fields of its frames; the counter of the first is `q`.

    Raises:
        LocalProtocolError: the packet is empty.
    """
    if not packet:
        raise LocalProtocolError("an empty packet cannot be sent on CAN")
    if fd:
        return _split_fd(packet, q)
    if len(packet) <= 7:
        return [_HEADERS[FIRST | LAST | q & COUNTER] + packet]
    body = packet + _HEADERS[check_byte(packet)]
    headers = _HEADERS
    frames = [headers[q + i & COUNTER] + body[7 * i : 7 * i + 7] for i in range((len(body) + 6) // 7)]
    frames[0] = headers[FIRST | q & COUNTER] + body[:7]
    last = len(frames) - 1
    frames[last] = headers[LAST | q + last & COUNTER] + body[7 * last :]
    return frames


class FrameJoiner:
    """Reassembles the frames of one node in one direction; never returns a partial or altered message."""

    __slots__ = (
        "_at",
        "_dropped",
        "_expected",
        "_heard",
        "_mtu",
        "_parts",
        "_recent",
        "_recent_at",
        "_recent_nr",
        "_repeat_s",
        "_size",
        "_stray",
    )

    def __init__(self, mtu: int = MTU, *, dropped: Tally | None = None, repeat_s: float = REPEAT_S) -> None:
        """Start without a message in progress.

        Args:
            mtu: largest packet in bytes.
            dropped: where drops are counted by reason in words; shared with the link's counters.
            repeat_s: see `REPEAT_S`; up to 64 frame times of the bus.
        """
        self._mtu = mtu
        self._dropped = Tally() if dropped is None else dropped
        self._repeat_s = repeat_s
        self.reset()

    def reset(self) -> None:
        """Forget everything: the node at the other end is new."""
        self._parts: list[bytes] | None = None
        self._size = 0
        self._at = 0.0
        self._expected = -1
        self._stray = False
        self._recent: list[bytes] = [b""] * 64
        self._recent_at = [0.0] * 64
        self._recent_nr = [0] * 64
        self._heard = 0

    def receive(self, data: bytes, now: float) -> bytes | None:
        """Take the data field of one frame; returns the packet it completes, if any."""
        if not data:
            self._dropped.count(EMPTY_FRAME)
            return None
        header = data[0]
        q = header & COUNTER
        if self._recent[q] == data and self._is_repeated(q, now):
            self._dropped.count(REPEATED)
            return None
        self._heard += 1
        self._recent[q] = data
        self._recent_at[q] = now
        self._recent_nr[q] = self._heard
        skipped = q != self._expected
        first_ever = self._expected < 0
        self._expected = q + 1 & COUNTER
        parts = self._parts
        if parts is not None:
            broken = ""
            if skipped:
                broken = FRAME_LOST
            elif now - self._at > TIMEOUT_S:
                broken = TOO_SLOW
            elif header & FIRST:
                broken = UNFINISHED
            if broken:
                self._drop(broken)
                parts = None
        elif skipped and not first_ever and header & FIRST and not self._stray:
            self._dropped.count(MESSAGE_LOST)
        if header & FIRST:
            self._stray = False
            self._parts = parts = []
            self._size = 0
        elif parts is None:
            self._ignore_stray(header)
            return None
        return self._take(parts, data, header, now)

    def _is_repeated(self, q: int, now: float) -> bool:
        # On a virtual bus 64 frames may pass in no time, hence the second condition.
        return now - self._recent_at[q] < self._repeat_s and self._heard - self._recent_nr[q] < 63

    def _take(self, parts: list[bytes], data: bytes, header: int, now: float) -> bytes | None:
        if header & LAST:
            if len(data) > 8:
                size = data[1]
                if size > 62 or _FD_SLOT[size + 2] != len(data):
                    self._drop(WRONG_LENGTH)
                    self._stray = False
                    return None
                parts.append(data[2 : size + 2])
            else:
                parts.append(data[1:])
            return self._finish(parts)
        parts.append(data[1:])
        self._size += len(data) - 1
        self._at = now
        if self._size > self._mtu + 1:
            self._drop(TOO_LONG)
        return None

    def _finish(self, parts: list[bytes]) -> bytes | None:
        self._parts = None
        if len(parts) == 1:
            packet = parts[0]
        else:
            body = b"".join(parts)
            packet = body[:-1]
            if body and check_byte(packet) != body[-1]:
                self._dropped.count(WRONG_CHECK_BYTE)
                return None
        if not packet:
            self._dropped.count(EMPTY_MESSAGE)
            return None
        if len(packet) > self._mtu:
            self._dropped.count(TOO_LONG)
            return None
        return packet

    def _ignore_stray(self, header: int) -> None:
        # The rest of a dropped message was counted with it; here only a message whose start was never seen is counted.
        if not self._stray:
            self._dropped.count(NO_FIRST_FRAME)
        self._stray = not header & LAST

    def _drop(self, reason: str) -> None:
        self._parts = None
        self._stray = True
        self._dropped.count(reason)


def _split_fd(packet: bytes, q: int) -> list[bytes]:
    body = packet if len(packet) <= 62 else packet + _HEADERS[check_byte(packet)]
    # A last frame holds at most 62 bytes (its length byte takes one place), possibly none.
    full = len(body) // 63
    frames = [_HEADERS[q + i & COUNTER] + body[63 * i : 63 * i + 63] for i in range(full)]
    rest = body[63 * full :]
    header = _HEADERS[LAST | q + full & COUNTER]
    frames.append(header + rest if len(rest) <= 7 else pad_fd(header + _HEADERS[len(rest)] + rest))
    frames[0] = _HEADERS[frames[0][0] | FIRST] + frames[0][1:]
    return frames


def _check_table() -> bytes:
    table = bytearray(256)
    for octet in range(256):
        crc = octet
        for _ in range(8):
            crc = (crc << 1 ^ 0x2F) & 0xFF if crc & 0x80 else crc << 1
        table[octet] = crc
    return bytes(table)


_CHECK_TABLE = _check_table()
