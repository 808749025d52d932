"""When planted faults begin and end. Pure: time comes in, changes go out.

A fault waits until its time has come, then until its condition holds, then for its chance; it is there for its time
and ends by itself. Nothing is there for ever: what never begins is forgotten, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import field
from random import Random
from typing import Final

from msbot_agent.text.sentence import said
from msbot_school.faults.fault_kinds import Condition, FaultKind, contradiction
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

FOR_S: Final = 60.0
"""How long a fault is there if nobody says otherwise."""
LONGEST_S: Final = 3600.0
PATIENCE_S: Final = 3600.0
"""How long a fault waits for its condition, or its chance, before it is forgotten."""
LOOK_S: Final = 0.25
"""Period in which conditions are looked at, and what is there is kept up."""
CHANCE_S: Final = 1.0
"""Each second a fault that comes by chance may begin."""
MOST: Final = 32
"""Most faults that are planted at a time."""


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """A fault as a person describes it."""

    kind: FaultKind
    at: str = ""
    """Slot of the part; empty: the robot as a whole."""
    amount: float = 0.0
    """In the unit of the kind; without meaning for a kind without amount."""
    jitter_ms: float = 0.0
    port: str = ""
    number: str = ""
    after_s: float = 0.0
    for_s: float = FOR_S
    when: Condition | None = None
    chance: float | None = None
    """Probability that it begins in each second; None: it begins at once."""
    seed: int = 1
    hidden: bool = False
    """Whether only those see it who may plant faults."""

    @property
    def describe(self) -> str:
        """What it is and where, without its times."""
        amount = self.kind.amount
        strength = "" if amount is None else said(" ({amount:g} {unit})", amount=self.amount, unit=amount.unit)
        if not self.at:
            return said("{kind}: {words}{strength}", kind=self.kind.name, words=self.kind.words, strength=strength)
        return said(
            "{kind} at {at}: {words}{strength}",
            kind=self.kind.name,
            at=self.at,
            words=self.kind.words,
            strength=strength,
        )


@dataclass(slots=True)
class Fault:
    """A fault that is planted."""

    number: int
    spec: FaultSpec
    who: str
    planted_at: float
    began_at: float | None = None
    """When it began; None: it waits."""
    random: Random = field(default_factory=Random)
    next_draw_at: float = math.inf

    @property
    def is_active(self) -> bool:
        """Whether it is there now."""
        return self.began_at is not None

    @property
    def begins_at(self) -> float | None:
        """When it begins or has begun; None: nobody knows."""
        if self.began_at is not None:
            return self.began_at
        is_certain = self.spec.when is None and self.spec.chance is None
        return self.planted_at + self.spec.after_s if is_certain else None

    @property
    def ends_at(self) -> float | None:
        """When it ends by itself; None: nobody knows."""
        begins_at = self.begins_at
        return None if begins_at is None else begins_at + self.spec.for_s


@dataclass(frozen=True, slots=True)
class FaultChange:
    """A fault begins, or is over."""

    fault: Fault
    begins: bool
    was_active: bool
    """Of one that is over: whether it ever was there."""
    reason: str
    is_mended: bool = False
    """Whether it is over because somebody has mended it at the part itself."""


class FaultEngine:
    """The planted faults of one robot."""

    def __init__(self) -> None:
        self._faults: dict[int, Fault] = {}
        self._planted = 0
        self._look_at = -math.inf

    @property
    def faults(self) -> Sequence[Fault]:
        """All that wait or are there, in the order in which they were planted."""
        return tuple(self._faults.values())

    def check(self, spec: FaultSpec, now: float) -> None:
        """Make sure that a fault can be planted.

        Raises:
            ConfigError: there are too many, or it contradicts another one that may be there at the same time.
        """
        if len(self._faults) >= MOST:
            raise ConfigError(
                said("{most} faults are planted, which is the most: `msbot fault clear` ends them", most=MOST)
            )
        begins_at = None if spec.when is not None or spec.chance is not None else now + spec.after_s
        for other in self._faults.values():
            reason = contradiction(spec.kind, spec.at, other.spec.kind, other.spec.at)
            if reason and _overlap(begins_at, spec.for_s, other):
                raise ConfigError(
                    said(
                        "{kind} contradicts fault {number} ({other}): {reason}; `msbot fault clear {number}` ends that "
                        "one, or plant one after the other",
                        kind=spec.kind.name,
                        number=other.number,
                        other=other.spec.describe,
                        reason=reason,
                    )
                )

    def plant(self, spec: FaultSpec, who: str, now: float) -> Fault:
        """Plant a fault; it begins with the next `handle_timer` that finds it due.

        Raises:
            ConfigError: see `check`.
        """
        self.check(spec, now)
        self._planted += 1
        fault = Fault(self._planted, spec, who, now, random=Random(spec.seed))
        if spec.chance is not None:
            fault.next_draw_at = now + spec.after_s
        self._faults[fault.number] = fault
        self._look_at = now
        return fault

    def clear(self, number: int | None, reason: str, *, is_mended: bool = False) -> list[FaultChange]:
        """End one fault, or all.

        Raises:
            ConfigError: there is no such fault.
        """
        if number is not None and number not in self._faults:
            known = ", ".join(str(one) for one in self._faults) or said("none")
            raise ConfigError(said("there is no fault {number}; there are {known}", number=number, known=known))
        ended = [self._faults[number]] if number is not None else list(self._faults.values())
        return [self._end(fault, reason, is_mended=is_mended) for fault in ended]

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called next; None: nothing is planted."""
        if not self._faults:
            return None
        moments = (fault.ends_at if fault.is_active else fault.begins_at for fault in self._faults.values())
        return min([self._look_at, *(moment for moment in moments if moment is not None)])

    def handle_timer(self, now: float, holds: Callable[[Condition], bool]) -> list[FaultChange]:
        """Do what is due: begin and end faults."""
        self._look_at = now + LOOK_S
        changes = []
        for fault in list(self._faults.values()):
            if fault.began_at is None:
                if self._is_due(fault, now, holds):
                    fault.began_at = now
                    changes.append(FaultChange(fault, begins=True, was_active=False, reason=""))
                elif fault.begins_at is None and now >= fault.planted_at + fault.spec.after_s + PATIENCE_S:
                    changes.append(self._end(fault, said("it never came to it")))
            elif now >= fault.began_at + fault.spec.for_s:
                changes.append(self._end(fault, said("its time is over")))
        return changes

    @staticmethod
    def _is_due(fault: Fault, now: float, holds: Callable[[Condition], bool]) -> bool:
        spec = fault.spec
        if now < fault.planted_at + spec.after_s or (spec.when is not None and not holds(spec.when)):
            return False
        if spec.chance is None:
            return True
        fault.next_draw_at = max(fault.next_draw_at, now - CHANCE_S)
        while fault.next_draw_at <= now:
            fault.next_draw_at += CHANCE_S
            if fault.random.random() < spec.chance:
                return True
        return False

    def _end(self, fault: Fault, reason: str, *, is_mended: bool = False) -> FaultChange:
        del self._faults[fault.number]
        return FaultChange(fault, begins=False, was_active=fault.is_active, reason=reason, is_mended=is_mended)


def _overlap(begins_at: float | None, for_s: float, other: Fault) -> bool:
    """Whether two faults may be there at the same time."""
    other_begins, other_ends = other.begins_at, other.ends_at
    if begins_at is None or other_begins is None or other_ends is None:
        return True
    return begins_at < other_ends and other_begins < begins_at + for_s
