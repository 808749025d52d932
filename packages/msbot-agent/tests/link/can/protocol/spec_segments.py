"""Segments of the CAN link as docs/reference/can.md describes them, written from that page alone.

Nothing here knows `msbot`: a message in progress is the list of its frames, judged as a whole when its last one is
there; what was heard before is a list that is searched from its beginning. Only the words of the page's table are here.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

COUNTERS = 64
PAUSE_S = 0.25
FD_SIZES = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


def spec_check_byte(message: bytes) -> int:
    """CRC-8/AUTOSAR by long division: the remainder of the message's polynomial, octet by octet and bit by bit."""
    register = 0xFF
    for bit in (octet >> (7 - place) & 1 for octet in message for place in range(8)):
        out = register >> 7 ^ bit
        register = (register << 1 & 0xFF) ^ (0x2F if out else 0)
    return register ^ 0xFF


def spec_segments(message: bytes, counter: int, *, fd: bool) -> list[bytes]:
    """The data fields of the frames of a message, of which the first has that counter."""
    in_one, full = (62, 63) if fd else (7, 7)
    if len(message) <= in_one:
        pieces = [message]
    else:
        whole = message + bytes([spec_check_byte(message)])
        pieces = [whole[at : at + full] for at in range(0, len(whole), full)]
        if fd and len(pieces[-1]) == full:
            pieces.append(b"")
    frames = []
    for number, piece in enumerate(pieces):
        is_first, is_last = number == 0, number == len(pieces) - 1
        header = 0x80 * is_first + 0x40 * is_last + (counter + number) % COUNTERS
        said = bytes([len(piece)]) if is_last and len(piece) > 7 else b""
        octets = bytes([header]) + said + piece
        frames.append(octets.ljust(min(size for size in FD_SIZES if size >= len(octets)), b"\0"))
    return frames


@dataclass
class SpecReceiver:
    """One node in one direction."""

    longest: int
    repeat_s: float
    counted: Counter[str]
    heard: list[tuple[float, bytes]] = field(default_factory=list)
    """All frames but repeated ones."""
    message: list[bytes] | None = None
    """The frames of the message in progress."""
    given_up: bool = False
    """Whether the frames that come belong to a message that was dropped, so that they are not counted again."""

    def hear(self, octets: bytes, now: float) -> bytes | None:
        """A frame; the message that it completes, if any."""
        if not octets:
            self.counted["frame without a segment header"] += 1
            return None
        alike = [one for one in self.heard[-63:] if one[1][0] % COUNTERS == octets[0] % COUNTERS]
        if alike and octets == alike[-1][1] and now - alike[-1][0] < self.repeat_s:
            self.counted["frame repeated by the bus"] += 1
            return None
        before = self.heard[-1] if self.heard else None
        self.heard.append((now, octets))
        is_first, is_last, counter = octets[0] >= 128, octets[0] % 128 >= 64, octets[0] % 64
        skips = before is not None and counter != (before[1][0] + 1) % COUNTERS
        paused = before is not None and now - before[0] > PAUSE_S
        if self.message is not None and (skips or paused or is_first):
            self._give_up(
                "a frame of the message is missing"
                if skips
                else "too long a pause inside a message"
                if paused
                else "a new message began before the last was complete"
            )
        elif is_first and skips and not self.given_up:
            self.counted["frames are missing between two messages"] += 1
        elif self.message is None and not is_first and not self.given_up:
            self._give_up("message without its first frame")
        if is_first:
            self.message, self.given_up = [], False
        found = None
        if self.message is not None:
            self.message.append(octets)
            if is_last:
                found = self._judge(self.message)
            elif sum(len(one) - 1 for one in self.message) > self.longest + 1:
                self._give_up("message is longer than the link allows")
        if is_last:
            self.message, self.given_up = None, False
        return found

    def _give_up(self, reason: str) -> None:
        self.counted[reason] += 1
        self.message, self.given_up = None, True

    def _judge(self, frames: list[bytes]) -> bytes | None:
        """What a whole message says."""
        last = frames[-1]
        if len(last) > 8:
            length = last[1]
            if length <= 6 or length > 62 or len(last) != min(size for size in FD_SIZES if size >= length + 2):
                self.counted["length byte does not fit the frame"] += 1
                return None
            last = last[:1] + last[2 : 2 + length]
        octets = b"".join(one[1:] for one in [*frames[:-1], last])
        message, check = (octets, b"") if len(frames) == 1 else (octets[:-1], octets[-1:])
        if check and check[0] != spec_check_byte(message):
            self.counted["check byte is wrong"] += 1
        elif not message:
            self.counted["message without content"] += 1
        elif len(message) > self.longest:
            self.counted["message is longer than the link allows"] += 1
        else:
            return message
        return None
