"""The frames of a CAN bus for the bus page: counters are exact, the table shows the newest few thousand.

Taking in a frame costs one append; its sender and meaning are worked out only for the rows that somebody looks at.
Every frame has a number that counts up, so a page asks for "what came after number N".
"""

from __future__ import annotations

import csv
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from io import StringIO
from itertools import islice

from msbot.cli.bus.foreign_frames import foreign_words
from msbot.part import Message
from msbot.pnp import KNOWN_TYPES, FrameListener, KnownObject, SessionListener
from msbot_agent.link.can.protocol import CanIds, Frame, LogLine, format_frame, format_log_line, node_of, show_frame
from msbot_agent.text.sentence import as_cell
from msbot_xrce.lazy import dataclass

KEPT = 4000
"""Frames that are kept."""


@dataclass(frozen=True, slots=True)
class FrameRow:
    """One frame in the table."""

    number: int
    """Counts all frames of the bus since the page's server began to listen, from 1."""
    at: float
    """Seconds of the robot's clock."""
    sender: str
    """Who sent it, as the bus knows it: an interface's or a simulated node's name."""
    text: str
    """The frame in the notation of can-utils."""
    node: int
    """The part's address on the bus, 0 when it is nobody's."""
    words: tuple[str, ...]
    """What it says; the first line about the frame, the others about the packet it completes."""
    plain: tuple[str, ...] = ()
    """The values in it, in sentences for everybody (`knob says level 49.9 %`)."""
    about: tuple[str, ...] = ()
    """What a frame without such values is for (`knob says that it is alive`)."""
    notation: str = ""
    """The frame as can-utils and `msbot plot --frame` take it (`101#C010`)."""


class FrameRing:
    """See the module's docstring.

    Args:
        ids: identifier bases, when the bus is shared with other equipment.
    """

    def __init__(self, ids: CanIds | None = None) -> None:
        self.total = 0
        self._ids = ids or CanIds()
        self._ring: deque[tuple[float, str, Frame]] = deque(maxlen=KEPT)
        self._rows: deque[FrameRow] = deque(maxlen=KEPT)
        self._decoded = 0
        self._foreign = foreign_words()
        self._listener = FrameListener(ids=self._ids, foreign=self._foreign)

    def learn(
        self,
        types: Iterable[type[Message]],
        objects: Callable[[Hashable, int], KnownObject | None] | None = None,
        units: Callable[[str], Mapping[str, str]] | None = None,
    ) -> None:
        """Also decode samples of these types, and sessions that began before anybody listened.

        To be called before the first frame is looked at, and again when other types hold: what the decoder had learned
        of sessions it then learns anew, from `objects`.

        Args:
            types: message classes of the robot.
            objects: what the master knows of an object of the client at a node.
            units: units of the fields of a message type.
        """
        overhearer = SessionListener((*KNOWN_TYPES, *types), know=objects, units=units)
        self._listener = FrameListener(overhearer, ids=self._ids, foreign=self._foreign)

    def tap(self, at: float, sender: str, frame: Frame) -> None:
        """Take a frame; what a bus calls."""
        self.total += 1
        self._ring.append((at, sender, frame))

    def rows(self, after: int = 0, limit: int = 200) -> list[FrameRow]:
        """The newest rows with a number above `after`, oldest first; at most `limit`."""
        self._decode()
        if not self._rows or limit < 1:
            return []
        wanted = min(limit, self.total - max(after, self.total - len(self._rows)))
        return list(islice(self._rows, len(self._rows) - wanted, None)) if wanted > 0 else []

    def row(self, number: int) -> FrameRow | None:
        """One row by its number, or None when it is no longer kept."""
        self._decode()
        index = number - (self.total - len(self._rows)) - 1
        return self._rows[index] if 0 <= index < len(self._rows) else None

    def candump(self, channel: str, *, epoch_s: float = 0.0) -> Iterator[str]:
        """The frames that are kept, as `candump -l` writes them; `epoch_s` is when the robot's clock was 0."""
        return (format_log_line(LogLine(epoch_s + at, channel, frame)) for at, _, frame in tuple(self._ring))

    def csv(self) -> Iterator[str]:
        """The frames that are kept as a table: number, seconds, sender, frame, sentence, words of the protocol."""
        line = StringIO()
        writer = csv.writer(line)
        head = ("number", "seconds", "sender", "frame", "plain", "protocol")
        for row in (head, *map(_cells, self.rows(limit=KEPT))):
            writer.writerow(map(as_cell, map(str, row)))
            yield line.getvalue()
            line.seek(0)
            line.truncate()

    def _decode(self) -> None:
        """Decode what came since the last call; frames that have already left the ring are lost to the decoder, too."""
        new = min(self.total - self._decoded, len(self._ring))
        number = self.total - new
        for at, sender, frame in islice(self._ring, len(self._ring) - new, None):
            number += 1
            words = self._listener.explain_frame(frame, at)
            node, _ = node_of(frame, self._ids) or (0, False)
            text = show_frame(frame)
            row = FrameRow(
                number, at, sender, text, node, words.protocol, words.plain, words.about, format_frame(frame)
            )
            self._rows.append(row)
        self._decoded = self.total


def _cells(row: FrameRow) -> tuple[object, ...]:
    plain = " / ".join(row.plain or row.about)
    return (row.number, f"{row.at:.6f}", row.sender, row.text, plain, " / ".join(row.words))
