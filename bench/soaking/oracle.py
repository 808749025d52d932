"""What must hold between the parts of a robot, whatever happens to it: judged from what they say, by rules of its own.

Nothing of MsBOT is used here, so that a mistake of MsBOT is not made twice. Pure: events with their times come in,
violations come out. Times are seconds of CLOCK_MONOTONIC.

A *life* is the time from a part's `join` to its `lost`, `end` or death; what a part sends in one life is numbered from
0. Rules for samples:

1. Nobody but the parts of the robot is ever delivered a sample, and none is delivered that no such part has sent.
2. A part hears nothing before it has joined, nothing after it was lost, and nothing while STOP holds.
3. Within a life of the sender and a life of the hearer every sample comes at most once, and in order; and on a reliable
   wire none is left out in silence: a reader's history holds 16 samples, and what a hearer takes too slowly (because it
   is frozen, cut off, or gets no processor) the robot counts as unread, where everybody can see it (`wear`).
4. On a reliable wire a sample arrives within `ARRIVES_S`, if nothing is wrong with both ways from `SETTLES_S` before
   it was sent until it has arrived.
5. Who is not wired is not heard: not what was sent 2 s after the wire was taken away or later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

ARRIVES_S = 5.0
TOLD_S = 8.0
"""What was left out must have been counted by then."""
SETTLES_S = 4.0
UNWIRED_S = 2.0
REMEMBERED = 4096
"""Newest samples of a life of which the time is remembered."""


@dataclass(frozen=True, slots=True)
class Violation:
    """Something that must not be."""

    at: float
    rule: str
    words: str


@dataclass(slots=True)
class Life:
    """From a part's join to its end."""

    slot: str
    boot: str
    epoch: int
    began: float
    ended: float | None = None
    stopped: bool = False
    segment: float = 0.0
    """Since when it hears: its beginning, or the last GO."""
    sent: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    heard_most: int = -1
    """The greatest number that anybody has heard of it."""

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.slot} (process {self.boot}, life {self.epoch})"

    def sent_at(self, number: int) -> float | None:
        """When that sample was sent; None: not known (any more)."""
        if not self.sent or not self.sent[0][0] <= number <= self.sent[-1][0]:
            return None
        return self.sent[number - self.sent[0][0]][1]


@dataclass(slots=True)
class Wire:
    """Who hears whom."""

    writer: str
    reader: str
    reliable: bool
    since: float
    """Since when it is certain."""
    asked: float
    """Since when it may be so: somebody has asked for it."""
    until: float | None = None
    """Since when that may no longer be so: somebody has asked for it."""
    gone: float | None = None
    """Since when it is certain."""


@dataclass(slots=True)
class Pair:
    """One life hears another."""

    last: int
    at: float
    segment: float


@dataclass(slots=True)
class Wear:
    """What a hearer has left out in a session."""

    session: str = ""
    missing: int = 0
    unread: int = 0
    since: float | None = None
    """Since when more is missing than the robot tells."""
    words: str = ""


class SampleOracle:
    """Rules 1 to 5.

    Args:
        clear_since: since when nothing is wrong on the way of that slot; None: something is.
    """

    def __init__(self, clear_since: Callable[[str], float | None]) -> None:
        self.violations: list[Violation] = []
        self.heard = 0
        self.accepted = 0
        self.left_out = 0
        """Samples that a hearer took too slowly."""
        self._clear_since = clear_since
        self._wear: dict[str, Wear] = {}
        self._binding: dict[tuple[str, str], float] = {}
        self._boots: dict[str, str] = {}
        self._lives: dict[tuple[str, int], Life] = {}
        self._now: dict[str, Life] = {}
        """By process: its present life."""
        self._pairs: dict[tuple[str, int, str, int], Pair] = {}
        self.wires: list[Wire] = []
        self._late: dict[tuple[str, int, str, int], float] = {}

    def complain(self, at: float, rule: str, words: str) -> None:
        """Note a violation."""
        self.violations.append(Violation(at, rule, words))

    # What the script knows.

    def wire(self, at: float, writer: str, reader: str, *, reliable: bool) -> None:
        """From now on the reader hears the writer."""
        self.wires.append(Wire(writer, reader, reliable, at, self._binding.pop((writer, reader), at)))

    def unwire(self, at: float, writer: str, reader: str) -> None:
        """From now on it may not."""
        for wire in self.wires:
            if (wire.writer, wire.reader, wire.until) == (writer, reader, None):
                wire.until = at

    def binds(self, at: float, writer: str, reader: str) -> None:
        """From now on the reader may hear the writer: somebody has asked for it."""
        self._binding[writer, reader] = at

    def unwired(self, at: float, writer: str, reader: str) -> None:
        """From now on it certainly does not."""
        for wire in self.wires:
            if (wire.writer, wire.reader, wire.gone) == (writer, reader, None):
                wire.gone = at

    def died(self, at: float, boot: str) -> None:
        """A process was ended by the script."""
        self._end(boot, at)

    # What the parts say.

    def boot(self, slot: str, boot: str) -> None:
        """A process of the robot has begun."""
        self._boots[boot] = slot

    def join(self, at: float, boot: str, epoch: int, slot: str, *, stopped: bool) -> None:
        """It has joined."""
        if self._boots.get(boot) != slot:
            self.complain(at, "slot", f"the part made for {self._boots.get(boot)} has joined in slot {slot}")
        self._end(boot, at)
        self._wear.pop(slot, None)  # the robot counts anew for each session
        life = Life(slot, boot, epoch, at, stopped=stopped, segment=at)
        self._lives[boot, epoch] = self._now[boot] = life

    def lost(self, at: float, boot: str) -> None:
        """It is no longer active."""
        self._end(boot, at)

    def stop(self, _at: float, boot: str) -> None:
        """STOP has reached it."""
        if life := self._now.get(boot):
            life.stopped = True

    def go(self, at: float, boot: str) -> None:
        """GO has."""
        if life := self._now.get(boot):
            life.stopped, life.segment = False, at

    def sent(self, at: float, boot: str, epoch: int, number: int) -> None:
        """It has handed a sample over."""
        life = self._lives.get((boot, epoch))
        if life is None:
            self.complain(at, "sent", f"{self._boots.get(boot)} ({boot}) sends without having joined")
            return
        if life.sent and number != life.sent[-1][0] + 1:
            self.complain(at, "sent", f"{life.name} counts {life.sent[-1][0]}, {number}")
            life.sent.clear()
        life.sent.append((number, at))
        self.accepted += 1

    def got(self, at: float, hearer: str, epoch: int, sample: tuple[str, str, int, int]) -> None:
        """A process has heard a sample: whose, of which process, in its which life, its number."""
        slot, boot, its_epoch, number = sample
        self.heard += 1
        ear = self._now.get(hearer)
        if ear is None or ear.epoch != epoch:
            self.complain(at, "hears", f"{self._boots.get(hearer)} ({hearer}) hears {sample} without being active")
            return
        if ear.stopped:
            self.complain(at, "stop", f"{ear.name} hears {sample} although it is stopped")
        if self._boots.get(boot) != slot:
            self.complain(at, "stranger", f"{ear.name} hears {sample}, which no part of the robot has sent")
            return
        life = self._lives.get((boot, its_epoch))
        if life is None:
            self.complain(at, "stranger", f"{ear.name} hears {sample}: that part had not joined")
            return
        life.heard_most = max(life.heard_most, number)
        wires = [wire for wire in self.wires if (wire.writer, wire.reader) == (slot, ear.slot)]
        sent_at = life.sent_at(number)
        if sent_at is not None and not any(_was(wire, sent_at) for wire in wires) and not self._binds(slot, ear.slot):
            self.complain(at, "wire", f"{ear.name} hears {life.name} sample {number}, but they are not wired")
        self._follow(at, ear, life, number, reliable=_are_reliable(wires, at))

    def _follow(self, at: float, ear: Life, life: Life, number: int, *, reliable: bool) -> None:
        """Rule 3."""
        key = (life.boot, life.epoch, ear.boot, ear.epoch)
        pair = self._pairs.get(key)
        if pair is None:
            self._pairs[key] = Pair(number, at, ear.segment)
            return
        if number <= pair.last:
            what = "again" if number == pair.last else f"after {pair.last}"
            self.complain(at, "doubled", f"{ear.name} hears {life.name} sample {number} {what}")
            return
        missing = number - pair.last - 1
        if missing and reliable and pair.segment == ear.segment and self._stayed_wired(life.slot, ear.slot, pair.at):
            self.left_out += missing
            words = f"{ear.name} hears {life.name} sample {number} after {pair.last}"
            wear = self._wear.setdefault(ear.slot, Wear())
            wear.missing += missing
            wear.since, wear.words = wear.since or at, words
        self._pairs[key] = Pair(number, at, ear.segment)

    def worn(self, at: float, slot: str, session: str, unread: int) -> None:
        """The robot says how many samples for the part in that slot were thrown away unread in its session."""
        wear = self._wear.setdefault(slot, Wear())
        if wear.session != session or unread < wear.unread:
            wear = self._wear[slot] = Wear(session=session)
        elif unread >= wear.missing:
            wear.since = None
        elif wear.since is not None and at - wear.since > TOLD_S:
            self.complain(
                at, "lost", f"{wear.words}; {wear.missing} are missing in all, and the robot tells of {unread}"
            )
            wear.missing, wear.since = unread, None
        wear.unread = unread

    def _binds(self, writer: str, reader: str) -> bool:
        """Whether somebody has asked for a wire between them, and nobody knows whether there is one."""
        return (writer, reader) in self._binding

    def _stayed_wired(self, writer: str, reader: str, since: float) -> bool:
        """Whether nobody has touched the wire between them since then, whether or not it was answered."""
        found = [wire for wire in self.wires if (wire.writer, wire.reader) == (writer, reader)]
        if self._binds(writer, reader):
            return False
        return all(wire.since < since and (wire.until is None or wire.until < since - UNWIRED_S) for wire in found)

    # What should have come by now.

    def check(self, now: float) -> None:
        """Rule 4, and that nobody has heard what was never sent."""
        present = {life.slot: life for life in self._now.values() if life.ended is None}
        for wire in self.wires:
            writer, reader = present.get(wire.writer), present.get(wire.reader)
            if wire.until is None and wire.reliable and writer and reader and not reader.stopped:
                self._check_pair(now, writer, reader, wire.since)
        for life in present.values():
            if life.sent and life.heard_most > life.sent[-1][0] and now - life.sent[-1][1] > ARRIVES_S:
                self.complain(now, "stranger", f"{life.name}: sample {life.heard_most} was heard and never sent")
                life.heard_most = -1
        self._forget(now)

    def _check_pair(self, now: float, writer: Life, reader: Life, wired: float) -> None:
        clear = [self._clear_since(slot) for slot in (writer.slot, reader.slot)]
        if any(since is None for since in clear):
            return
        start = max(writer.began, reader.began, reader.segment, wired, *(since for since in clear if since is not None))
        due = [number for number, at in writer.sent if start + SETTLES_S <= at <= now - ARRIVES_S]
        key = (writer.boot, writer.epoch, reader.boot, reader.epoch)
        pair = self._pairs.get(key)
        if due and (pair is None or pair.last < due[-1]) and self._late.get(key) != start:
            self._late[key] = start
            came = "nothing" if pair is None else f"{pair.last}"
            self.complain(
                now, "late", f"{reader.name} should have heard {writer.name} sample {due[-1]}, the last was {came}"
            )

    def _end(self, boot: str, at: float) -> None:
        if (life := self._now.pop(boot, None)) is not None:
            life.ended = at

    def _forget(self, now: float) -> None:
        old = {key for key, life in self._lives.items() if life.ended is not None and now - life.ended > 120.0}
        if not old:
            return
        for life in old:
            del self._lives[life]
        self._pairs = {
            key: pair
            for key, pair in self._pairs.items()
            if (key[0], key[1]) not in old and (key[2], key[3]) not in old
        }
        self._late = {key: at for key, at in self._late.items() if key in self._pairs}
        self.wires = [wire for wire in self.wires if wire.gone is None or now - wire.gone < 120.0]


def _was(wire: Wire, at: float) -> bool:
    return wire.asked - UNWIRED_S <= at and (wire.gone is None or at <= wire.gone + UNWIRED_S)


def _are_reliable(wires: Iterable[Wire], at: float) -> bool:
    """Whether all of the wires that may have carried a sample are reliable."""
    return all(wire.reliable for wire in wires if wire.gone is None or at - wire.gone < SETTLES_S)
