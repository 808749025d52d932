"""What the programs of active parts log: the newest lines of each part, and whoever wants to hear of each.

Nobody needs to be trusted: lines are bounded in length by their pieces, and here in number. Pure.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from msbot.part.join.part_log import LineRate, LogLevel, VersionOf
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import Configuration, ProgramLogLine
from msbot.pnp.state_changes import StateChanges
from msbot_agent.text.sentence import said
from msbot_xrce.counting import Tally

PER_S: Final = 10.0
BURST: Final = 60.0
"""Lines taken of one part; twice as many as a part of ours sends."""
JOURNAL_S: Final = 60.0
"""The journal keeps one error of a part in this time."""


class PartLog:
    """See the module's docstring; for one robot."""

    def __init__(self, changes: StateChanges, dropped: Tally) -> None:
        self._changes = changes
        self._dropped = dropped
        self._handlers: list[Callable[[ProgramLogLine], object]] = []

    def on_line(self, handler: Callable[[ProgramLogLine], object]) -> None:
        """Call the handler with each line."""
        self._handlers.append(handler)

    def receive_piece(self, record: InventoryRecord, place: int, piece: bytes, now: float) -> bool:
        """Take a piece of a line; whether the journal has got a line of it."""
        told = record.take_piece(place, piece)
        if told is None:
            return False
        level, words = told
        if isinstance(level, VersionOf):
            return self._take_version(record, level, words, now)
        if record.log_rate is None:
            record.log_rate = LineRate(PER_S, BURST)
        if not record.log_rate.passes(now):
            self._dropped.count("line of a part's log that comes too fast")
            return False
        line = ProgramLogLine(now, record.name, record.slot or "", level, words)
        record.log.append(line)
        for handler in self._handlers:
            handler(line)
        if level is not LogLevel.ERROR or now < record.log_noted_at + JOURNAL_S:
            return False
        record.log_noted_at = now
        self._changes.note(record, now, said("its program says: {words}", words=words), ((EVIDENCE, level.word),))
        return True

    def forget_ports(self, record: InventoryRecord, before: Configuration | None) -> None:
        """Another configuration has come: what the program said of a port counts no more if the port's wire changed."""
        then, now = ({one.port: one for one in (of.bindings if of else ())} for of in (before, record.configuration))
        changed = tuple(f"port {port!r}: " for port in {*then, *now} if then.get(port) != now.get(port))
        for line in [line for line in record.log if line.words.startswith(changed)]:
            record.log.remove(line)

    def _take_version(self, record: InventoryRecord, of: VersionOf, text: str, now: float) -> bool:
        """The journal has it when it is another one than before: somebody has given the part new software."""
        before = record.take_version(of, text)
        after = {VersionOf.HARDWARE: record.hardware, VersionOf.SOFTWARE: record.software}.get(of, record.home.version)
        if not before or before == after:
            return False
        if record.log_rate is None:
            record.log_rate = LineRate(PER_S, BURST)
        if not record.log_rate.passes(now):
            self._dropped.count("version of a part that changes too fast")
            return False
        after = after or said("not known")
        if of is VersionOf.HOME:
            words = said("it runs with MsBOT {after}; before, it was {before}", after=after, before=before)
        elif of is VersionOf.HARDWARE:
            words = said("its hardware is {after}; it was {before}", after=after, before=before)
        else:
            words = said("its software is {after}; it was {before}", after=after, before=before)
        self._changes.note(record, now, words)
        return True


EVIDENCE: Final = "log"
"""Marks what the journal keeps of a log."""
