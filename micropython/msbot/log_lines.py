"""Lines of a program's log on their way to the robot, by the rules of `msbot.part.join.part_log`.

Imported when a program has one.
"""

import struct

from micropython import const

from .errors import ConfigError, say
from .membership import JoinState
from .part import Timed
from .xrce import RELIABLE

_PIECE = const(12)
_LONGEST = const(180)
_PERIOD = const(200)  # ms a line, for ever
_BURST = const(4000)  # ms of that: 20 lines at once
_MOST_WAITING = const(20)
_AGAIN = const(50)  # ms until room is looked for again
_LEVELS = ("info", "warning", "error")


def verb(part, _name):
    """`part.log(text, level="info")`: write a line here, and while the part is active into its robot's log."""
    part.log = LogLines(part).add
    return part.log


class LogLines:
    """The lines of one part."""

    def __init__(self, part):
        self._part = part
        self._lines = []
        self._pieces = []
        self._free_at = -_BURST  # what lines have used up, as a time; so far behind at the most
        self._left_out = 0
        self._lease = 0  # of the session for which they are
        self._timer = Timed(_AGAIN, self.step)
        part._timed.append(self._timer)

    def add(self, text, level="info"):
        """See `verb`."""
        if level not in _LEVELS:
            raise ConfigError("part.log(..., level={!r}): the level is 'info', 'warning' or 'error'".format(level))
        line = "".join(sign if ord(sign) >= 32 and ord(sign) != 127 else " " for sign in str(text))
        say("error" if level == "error" else "info", "{}: {}".format(self._part.local_name, line))
        if self._part.state is not JoinState.ACTIVE:
            return
        self._forget_old()
        now = self._part._now
        self._free_at = max(self._free_at, now - _BURST)
        if len(self._lines) >= _MOST_WAITING or self._free_at + _PERIOD > now:
            self._left_out += 1
            return
        self._free_at += _PERIOD
        if self._left_out:
            lines = "1 line was" if self._left_out == 1 else "{} lines were".format(self._left_out)
            self._lines.append((2, (lines + " left out: 5 a second are sent").encode()))
            self._left_out = 0
        self._lines.append((_LEVELS.index(level) + 1, cut(line.encode()) or b" "))
        self._timer.due_at = now + _AGAIN
        self.step()

    def step(self):
        """Send what there is room for."""
        self._forget_old()
        membership = self._part._membership
        while self._lines or self._pieces:
            if not self._pieces:
                level, octets = self._lines.pop(0)
                for at in range(0, len(octets), _PIECE):
                    place = at // _PIECE | level << 4 | (0x80 if at + _PIECE >= len(octets) else 0)
                    self._pieces.append((place, octets[at : at + _PIECE]))
            place, piece = self._pieces[0]
            piece += bytes(_PIECE - len(piece))
            if not membership._ask(struct.pack("<IB", membership._lease, place) + piece, RELIABLE):
                return
            self._pieces.pop(0)
        self._timer.due_at = None  # nothing waits

    def _forget_old(self):
        """What was on its way in an earlier session is gone with it."""
        lease = self._part._membership._lease
        if lease != self._lease:
            self._lease = lease
            self._lines, self._pieces = [], []


def cut(octets):
    """At most so many, and no letter cut in two."""
    if len(octets) <= _LONGEST:
        return octets
    end = _LONGEST - 3
    while octets[end] & 0xC0 == 0x80:
        end -= 1
    return octets[:end] + b"\xe2\x80\xa6"
