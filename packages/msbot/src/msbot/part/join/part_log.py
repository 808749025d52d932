"""What a part's program logs, on its way to the robot: a line in pieces, as what is wrong with its hardware is sent.

The pieces are those of `hardware_trouble`; bits 4 to 6 of their place say how serious the line is, or that it is a
version. Pure.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Final

from msbot.part.join.hardware_trouble import TROUBLE_OCTETS, TROUBLE_PIECES, TroublePiece, trouble_pieces
from msbot_xrce.errors import ConfigError

LONGEST_LINE: Final = TROUBLE_OCTETS * TROUBLE_PIECES
"""Octets of a line in UTF-8."""
PER_S: Final = 5.0
BURST: Final = 20.0
"""Lines of one part: so many a second for ever, so many at once; the rest is counted."""
_MOST_WAITING: Final = 20
"""Lines that wait for room on the way."""
LEVEL_SHIFT: Final = 4
LEVEL_BITS: Final = 0x70


class LogLevel(IntEnum):
    """How serious a line is; 0 is no line of the log, but what is wrong with the part's hardware."""

    INFO = 1
    WARNING = 2
    ERROR = 3

    @property
    def word(self) -> str:
        """As programs write it: `info`, `warning`, `error`."""
        return self.name.lower()


class VersionOf(IntEnum):
    """What a version is of that a part tells its robot, in the place of a level."""

    HARDWARE = 4
    SOFTWARE = 5
    HOME = 6
    """Of MsBOT, and where the part runs (`home`)."""


def log_level(word: str) -> LogLevel:
    """The level that a program names.

    Raises:
        ConfigError: there is none of that name.
    """
    for level in LogLevel:
        if level.word == word:
            return level
    raise ConfigError(f"part.log(..., level={word!r}): the level is 'info', 'warning' or 'error'")


def printable(text: str) -> str:
    """A line without line breaks and other signs that are no letters, cut to `LONGEST_LINE` octets."""
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    octets = line.encode(errors="replace")
    if len(octets) <= LONGEST_LINE:
        return line
    return octets[: LONGEST_LINE - 3].decode(errors="ignore") + "…"


class LineRate:
    """How many lines pass: so many a second for ever, and after a pause so many at once."""

    def __init__(self, per_s: float, burst: float) -> None:
        self._per_s = per_s
        self._burst = burst
        self._left = burst
        self._at = 0.0

    def passes(self, now: float) -> bool:
        """Whether one more may pass now; then it has."""
        self._left = min(self._burst, self._left + (now - self._at) * self._per_s)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class LogSender:
    """The lines of one part that are on their way."""

    def __init__(self) -> None:
        self.dropped = 0
        """Lines that were not sent: they came too fast, or there was no room."""
        self._untold = 0
        self._rate = LineRate(PER_S, BURST)
        self._waiting: list[tuple[LogLevel | VersionOf, str]] = []
        self._pieces: list[TroublePiece] = []

    def add(self, level: LogLevel, line: str, now: float) -> None:
        """Take a line; one that comes too fast is counted, and the next one says how many were left out."""
        if len(self._waiting) >= _MOST_WAITING or not self._rate.passes(now):
            self.dropped += 1
            self._untold += 1
            return
        if self._untold:
            lines = "1 line was" if self._untold == 1 else f"{self._untold} lines were"
            self._waiting.append((LogLevel.WARNING, f"{lines} left out: {PER_S:g} a second are sent"))
            self._untold = 0
        self._waiting.append((level, line))

    def add_version(self, of: VersionOf, text: str) -> None:
        """Take a version, which goes first: the part has just become active."""
        self._waiting.insert(0, (of, printable(text)))

    def pieces(self, lease: int) -> Iterator[bytes]:
        """What is to be sent, piece by piece; `sent` takes the piece off."""
        while self._waiting or self._pieces:
            if not self._pieces:
                level, line = self._waiting.pop(0)
                for piece in trouble_pieces(lease, line or " "):
                    piece.place |= level << LEVEL_SHIFT
                    self._pieces.append(piece)
            yield self._pieces[0].encode()

    def sent(self) -> None:
        """The piece that `pieces` gave last is on its way."""
        del self._pieces[0]

    def forget(self) -> None:
        """The session is gone, and what was on its way with it."""
        self._waiting.clear()
        self._pieces.clear()
