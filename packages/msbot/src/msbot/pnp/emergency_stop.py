"""STOP as the robot's users see it: which one holds, who has confirmed it, and who has not. Pure.

A STOP has a number, counted by the robot from 1; GO ends the STOP of that number. Whoever says STOP while one holds
says one more, with a number of its own. Parts need not be told of it: they go on confirming the first. But a GO that
names an earlier number ends nothing, because whoever said it did not know of the later STOP.

Numbers whose lowest 16 bits are 0 are left out: a beat has room for those bits only, and with 0 it says STOP.

A master that starts while STOP holds gives it a new number. A GO may have reached the parts without being stored, and
they do not obey a STOP that they know to be over.

Every part that holds a slot when STOP is said, or gets one while it holds, is asked to confirm; only a beat that
carries the number does so (`msbot.part.join.pnp_messages.StoppedBeat`). A part that falls silent, or whose slot
somebody takes away, stays among those that have not confirmed: what it drives may still move. A part that says goodbye
has set its ports to their safe values by itself, unless it has said that something is wrong with its hardware.

Parts say STOP as well, by such a beat: with 0, or with a number that was never counted to here; this robot then has a
STOP of that part. It was said where no master heard it, or before a master could store it. With a number that is over,
a part only has not heard of GO. Nobody can say GO while a part still says 0: its STOP button is pressed, or it has not
heard yet which number its STOP has.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from msbot_xrce.lazy import dataclass

_HALF = 0x8000
"""Of the 16 bits of a number: what is further ahead than this is behind."""

MOST_NAMES = 16
"""People who are remembered besides whoever said STOP first."""


@dataclass(frozen=True, slots=True)
class StopRecord:
    """What is stored about the latest STOP, so that it survives restarts, restores and a change of master."""

    number: int = 0
    """Which STOP, counted from 1; 0 = nobody ever said STOP."""
    holds: bool = False
    """Whether nobody has said GO yet."""
    by: str = ""
    """Who said STOP; once it is over, who said GO."""
    reason: str = ""
    at_ns: int = 0
    """When STOP was said, nanoseconds since 1970."""
    latest: int = 0
    """The number of the STOP said last while this one holds; 0: nobody said another."""

    def is_newer_than(self, other: StopRecord) -> bool:
        """Whether this record describes something later; a GO is later than its own STOP."""
        return (self.number, not self.holds) > (other.number, not other.holds)


@dataclass(frozen=True, slots=True)
class StopConfirmation:
    """A part that has said that it is in its safe state."""

    part: str
    """The part's name for people."""
    ms: float
    """Time from STOP (for a part that joined later: from when it was told) to its confirmation."""


@dataclass(frozen=True, slots=True)
class StopStatus:
    """What the code has seen of STOP, for pages and commands; a snapshot, made on request."""

    stopped: bool = False
    """Whether STOP holds."""
    number: int = 0
    """The STOP that was said last, counted from 1, which a GO names; 0 = nobody ever said STOP."""
    by: str = ""
    """Who said STOP; once it is over, who said GO."""
    reason: str = ""
    """Why, in that person's words; may be empty."""
    since_ns: int | None = None
    """When STOP was said, nanoseconds since 1970; None: no STOP holds."""
    confirmed: tuple[StopConfirmation, ...] = ()
    """The parts that have confirmed this STOP, in the order of their confirmations."""
    silent: tuple[str, ...] = ()
    """The names of the parts that have not confirmed: they may still move."""
    trouble: str = ""
    """Why STOP would not survive a restart of the master, in words; empty: it is stored."""
    is_stored: bool = True
    """Whether this status is stored; False without `trouble`: it is being stored."""
    also_by: tuple[str, ...] = ()
    """Who else has said STOP while it held, since this master has run."""
    place: str = ""
    """From where it was said, in words; empty: not known, as after a restart of the master."""
    first: int = 0
    """The number of the STOP that parts confirm: the first of those that hold."""

    @property
    def told_count(self) -> int:
        """How many parts were told to stop."""
        return len(self.confirmed) + len(self.silent)

    @property
    def latency_ms(self) -> float | None:
        """Time until the last part confirmed; None: not all have, or there was nobody to tell."""
        if self.silent or not self.confirmed:
            return None
        return max(one.ms for one in self.confirmed)


class EmergencyStop:
    """STOP of one robot.

    Args:
        record: what was stored earlier; a STOP that held then still holds.
    """

    def __init__(self, record: StopRecord | None = None) -> None:
        self.record = record or StopRecord()
        if self.record.holds:
            number = _after(max(self.record.number, self.record.latest))
            self.record = replace(self.record, number=number, latest=number)
        self._waiting: dict[bytes, tuple[str, float]] = {}
        """Part -> its name, and when it was asked to confirm."""
        self._also_by: list[str] = []
        self._place = ""
        """From where the STOP was said; not stored."""
        self._confirmed: dict[bytes, StopConfirmation] = {}
        self._sayers: dict[bytes, str] = {}
        """Parts whose last beat said STOP, and their names."""

    @property
    def holds(self) -> bool:
        """Whether STOP holds."""
        return self.record.holds

    @property
    def stop_number(self) -> int:
        """The number of the STOP that parts confirm, or that is over."""
        return self.record.number

    @property
    def latest(self) -> int:
        """The number of the STOP that was said last."""
        return max(self.record.number, self.record.latest)

    def say(
        self, by: str, reason: str, parts: Iterable[tuple[bytes, str]], now: float, at_ns: int, *, place: str = ""
    ) -> bool:
        """Say STOP; parts go on confirming one that already holds, and those that have not are asked again.

        False: that person has said STOP already, and it holds.

        Args:
            by: who says it.
            reason: why; may be empty.
            parts: identity and name of every part that holds a slot.
            now: the robot's clock, seconds.
            at_ns: the wall clock, nanoseconds since 1970.
            place: from where, in words; may be empty.
        """
        number, is_news = _after(self.latest), not self.holds
        if is_news:
            self.record = StopRecord(number, True, by, reason, at_ns, number)
            self._place = place
        else:
            self.record = replace(self.record, latest=number)
            if by != self.record.by and by not in self._also_by and len(self._also_by) < MOST_NAMES:
                self._also_by.append(by)
                is_news = True
        for identity, name in parts:
            self.tell(identity, name, now)
        return is_news

    def tell(self, identity: bytes, name: str, now: float) -> None:
        """A part that holds a slot has been told of the STOP that holds."""
        if self.holds and identity not in self._confirmed:
            self._waiting.setdefault(identity, (name, now))

    def confirm(self, identity: bytes, number: int, now: float) -> bool:
        """A part has sent a beat with the number of a STOP; False: that is not the STOP that holds."""
        if not self.holds or number & 0xFFFF != self.stop_number & 0xFFFF:
            return False
        waiting = self._waiting.pop(identity, None)
        if waiting is not None:
            name, since = waiting
            self._confirmed[identity] = StopConfirmation(name, max(0.0, now - since) * 1000)
        return True

    @property
    def sayers(self) -> tuple[str, ...]:
        """The names of the parts that still say STOP."""
        return tuple(self._sayers.values())

    def handle_beat(self, identity: bytes, name: str, number: int | None) -> bool:
        """A part that holds a slot has sent a beat; True: it says a STOP that nobody here knows of, `say` it.

        Args:
            identity: of the part.
            name: of the part, for people.
            number: what the beat says of STOP; None: nothing.
        """
        if number == 0:
            self._sayers[identity] = name
        else:
            self._sayers.pop(identity, None)
        if number is None or self.holds:
            return False
        return number == 0 or (self.stop_number - number) & 0xFFFF >= _HALF

    def fall_silent(self, identity: bytes) -> None:
        """A part is not heard any more: nobody knows whether it would still say STOP."""
        self._sayers.pop(identity, None)

    def begin_anew(self, identity: bytes, name: str, now: float) -> None:
        """A part has started over (it has another lease): what it confirmed before no longer counts."""
        self._confirmed.pop(identity, None)
        self._waiting.pop(identity, None)
        self.tell(identity, name, now)

    def part_left(self, identity: bytes) -> None:
        """A part has said goodbye, which it does only in its safe state: it need no longer confirm."""
        self._waiting.pop(identity, None)
        self._confirmed.pop(identity, None)
        self._sayers.pop(identity, None)

    def lose_slot(self, identity: bytes) -> None:
        """Somebody has taken a part's slot away, or it has left and said that its hardware has trouble: if it has not
        confirmed, what it drives may still move."""
        self._confirmed.pop(identity, None)
        self._sayers.pop(identity, None)

    def go(self, by: str) -> int:
        """End the STOP that holds; returns its number."""
        self.record = StopRecord(self.stop_number, False, by, "", self.record.at_ns, self.latest)
        self._waiting.clear()
        self._confirmed.clear()
        self._also_by.clear()
        self._place = ""
        return self.stop_number

    def status(self, *, is_stored: bool = True, trouble: str = "") -> StopStatus:
        """What is known now."""
        record = self.record
        return StopStatus(
            stopped=record.holds,
            number=self.latest,
            by=record.by,
            reason=record.reason,
            since_ns=record.at_ns if record.holds else None,
            confirmed=tuple(self._confirmed.values()),
            silent=tuple(name for name, _ in self._waiting.values()),
            is_stored=is_stored,
            trouble=trouble,
            also_by=tuple(self._also_by),
            place=self._place,
            first=record.number,
        )


def _after(number: int) -> int:
    """The next number of a STOP."""
    return number + 1 if (number + 1) & 0xFFFF else number + 2
