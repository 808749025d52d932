"""What a mission is: its faults, what must be found and done, its marks; and what chance makes of it. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from random import Random
from typing import Final

from msbot.operations.fault_wish import FaultWish
from msbot_school.faults.kinds import KINDS, contradiction
from msbot_xrce.common.lazy_dataclass import dataclass

LONGEST_S: Final = 3600.0
TIME_S: Final = 300.0
"""Time allowed if a mission does not say."""
QUICK_SHARE: Final = 1 / 3
"""Which part of the time allowed is quick if a mission does not say."""
DRAWS: Final = 50
"""How often is drawn anew because two faults would contradict each other."""


@dataclass(frozen=True, slots=True)
class MissionFault:
    """Something that goes wrong, as the mission says it."""

    kinds: tuple[str, ...]
    """One of them is drawn."""
    at: tuple[str, ...] = ()
    """Slots, one of which is drawn; empty: the robot as a whole."""
    amount: float | None = None
    jitter_ms: float | None = None
    port: str = ""
    number: str = ""
    after_s: float = 0.0
    for_s: float | None = None
    """How long it is there; None: until it is mended, or the mission ends."""
    when: str = ""
    chance: float | None = None
    seed: int | None = None
    find: bool = True
    mend: bool = True


@dataclass(frozen=True, slots=True)
class Task:
    """Something that must be done."""

    words: str
    operation: str = ""
    """An operation that a person must have carried out; empty: a condition must hold at the end."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Arguments that it must have had."""
    until: str = ""
    within_s: float | None = None
    """Seconds after the first fault began; None: until the end."""


@dataclass(frozen=True, slots=True)
class Marks:
    """What brings marks, and what costs them."""

    place: float = 2.0
    kind: float = 3.0
    quick: float = 2.0
    quick_s: float = TIME_S * QUICK_SHARE
    """Who names a fault so many seconds after it began is quick."""
    mend: float = 3.0
    do: float = 2.0
    wrong: float = 1.0
    hint: float = 1.0


@dataclass(frozen=True, slots=True)
class Mission:
    """A task for a class."""

    name: str
    title: str
    story: str
    faults: tuple[MissionFault, ...]
    time_s: float = TIME_S
    hints: tuple[str, ...] = ()
    explanation: str = ""
    """What it was; told at the end."""
    avoid: tuple[str, ...] = ()
    """Operations that cost marks."""
    sample: str = ""
    """The sample robot that it is made for; for people."""
    slots: tuple[str, ...] = ()
    """Slots that must be filled and active."""
    tasks: tuple[Task, ...] = ()
    marks: Marks = Marks()
    source: str = ""
    """The text of its file."""

    @property
    def needs(self) -> tuple[str, ...]:
        """All slots that must be filled and active when it begins."""
        return tuple(dict.fromkeys([*self.slots, *(slot for fault in self.faults for slot in fault.at)]))


@dataclass(frozen=True, slots=True)
class DrawnFault:
    """A fault of a mission whose kind and place chance has decided."""

    number: int
    """Counted from 1."""
    wish: FaultWish
    find: bool
    mend: bool

    @property
    def kind(self) -> str:
        """Which fault it is."""
        return self.wish.kind

    @property
    def at(self) -> str:
        """Its slot; empty: the robot as a whole."""
        return self.wish.at


def drawn(mission: Mission, seed: int) -> tuple[DrawnFault, ...]:
    """The faults of a mission; the same for the same seed. They contradict each other only if no draw avoids it."""
    random = Random(seed)
    found: tuple[DrawnFault, ...] = ()
    for _ in range(DRAWS):
        found = tuple(_drawn(mission, number, fault, random) for number, fault in enumerate(mission.faults, 1))
        if not any(contradict(one, other) for one in found for other in found if one.number < other.number):
            break
    return found


def contradict(one: DrawnFault, other: DrawnFault) -> str:
    """Why two faults of a mission cannot be there together; empty: they can."""
    return contradiction(KINDS[one.kind], one.at, KINDS[other.kind], other.at)


def _drawn(mission: Mission, number: int, fault: MissionFault, random: Random) -> DrawnFault:
    kind, at = random.choice(fault.kinds), random.choice(fault.at) if fault.at else ""
    seed = random.getrandbits(32) if fault.seed is None else fault.seed
    wish = FaultWish(
        kind, at if KINDS[kind].at_part else "", fault.amount, fault.jitter_ms, fault.port, fault.number, fault.after_s,
        mission.time_s if fault.for_s is None else fault.for_s, fault.when, fault.chance, seed, hidden=True,
    )  # fmt: skip
    return DrawnFault(number, wish, fault.find, fault.mend)
