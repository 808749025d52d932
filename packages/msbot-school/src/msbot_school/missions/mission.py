"""What a mission is: its faults, what must be found and done, its marks; and what chance makes of it. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from enum import Enum
from random import Random
from types import MappingProxyType
from typing import Final

from msbot.operations.fault_request import FaultRequest
from msbot_agent.text.sentence import JsonSentence, from_json, said, to_json
from msbot_agent.text.similar_names import instead_of
from msbot_school.faults.fault_kinds import KINDS, contradiction
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

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
    wish: FaultRequest
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
        if not any(contradiction_of(one, other) for one in found for other in found if one.number < other.number):
            break
    return found


def contradiction_of(one: DrawnFault, other: DrawnFault) -> str:
    """Why two faults of a mission cannot be there together; empty: they can."""
    return contradiction(KINDS[one.kind], one.at, KINDS[other.kind], other.at)


def _drawn(mission: Mission, number: int, fault: MissionFault, random: Random) -> DrawnFault:
    kind, at = random.choice(fault.kinds), random.choice(fault.at) if fault.at else ""
    seed = random.getrandbits(32) if fault.seed is None else fault.seed
    wish = FaultRequest(
        kind,
        at if KINDS[kind].at_part else "",
        fault.amount,
        fault.jitter_ms,
        fault.port,
        fault.number,
        fault.after_s,
        mission.time_s if fault.for_s is None else fault.for_s,
        fault.when,
        fault.chance,
        seed,
        hidden=True,
    )
    return DrawnFault(number, wish, fault.find, fault.mend)


# What a person can have done to a robot that is ill, and which faults that mends.


@dataclass(frozen=True, slots=True)
class Repair:
    """One thing that can be done."""

    name: str
    words: str
    mends: frozenset[str]
    """Kinds of faults that are over when it is done where they are."""
    at_part: bool = True
    """Whether it is done at a part, or at the robot as a whole."""


_ROWS = (
    Repair("plug-in", said("plug the part in again"), frozenset({"unplug"})),
    Repair("restart-part", said("switch the part off and on"), frozenset({"late", "slow-consumer"})),
    Repair("exchange-part", said("exchange the part for a good one"), frozenset({"stuck", "drift", "bus-off"})),
    Repair("right-part", said("put the right part in its place"), frozenset({"wrong-number", "wrong-key"})),
    Repair("remove-twin", said("take the second part with its identity away"), frozenset({"duplicate-identity"})),
    Repair("new-cable", said("lay another cable to the part"), frozenset({"loss"})),
    Repair("new-switch", said("exchange what is between the part and the master"),
           frozenset({"delay", "duplicates", "reordering"})),
    Repair("quiet-bus", said("take the stranger off the bus that sends and sends"), frozenset({"babbling"}),
           at_part=False),
    Repair("new-bus-cable", said("lay another bus cable, shielded and terminated"), frozenset({"bit-errors"}),
           at_part=False),
    Repair("restart-master", said("restart the master"), frozenset({"master-frozen"}), at_part=False),
    Repair("restart-database", said("start the database again"), frozenset({"database-gone"}), at_part=False),
)  # fmt: skip

REPAIRS: Final[Mapping[str, Repair]] = MappingProxyType({row.name: row for row in _ROWS})
"""Every repair by its name."""


def repair_named(name: str) -> Repair:
    """The repair of that name.

    Raises:
        ConfigError: there is none; the text lists them.
    """
    repair = REPAIRS.get(name)
    if repair is None:
        raise ConfigError(said("there is no repair {name!r}; {hint}", name=name, hint=instead_of(name, REPAIRS)))
    return repair


# What happened in a mission, one note after the other: all that marks are counted from. Pure.


class MissionEventKind(Enum):
    """The kinds of notes."""

    BEGAN = "began"
    """The mission; `who` has started it."""
    FAULT_BEGAN = "fault began"
    FAULT_OVER = "fault over"
    """`word` is `mended` if a person has mended it at the part itself."""
    NAMED = "named"
    """`who` says that the fault `word` is at `slot`."""
    REPAIRED = "repaired"
    """`who` had the repair `word` done at `slot`; `number` is the fault that it mended, 0: none."""
    ACT = "act"
    """`who` had the operation `word` carried out."""
    STATE = "state"
    """The part in `slot` is `word` from now on."""
    HINT = "hint"
    """`who` was given hint `number`."""
    LOOKED = "looked"
    """`who` has looked the answers up."""
    HOLDS = "holds"
    """The condition of task `number` holds from now on, if `word` is `yes`, or no longer."""
    ENDED = "ended"
    """The mission, for the reason in `text`."""


@dataclass(frozen=True, slots=True)
class MissionEvent:
    """One note."""

    at_s: float
    """Seconds since the mission began."""
    what: MissionEventKind
    who: str = ""
    number: int = 0
    """Of a fault, a hint or a task, counted from 1."""
    slot: str = ""
    word: str = ""
    text: str = ""
    """A sentence, for people."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Of an act."""

    def as_json(self) -> dict[str, object]:
        """For a recording."""
        text: JsonSentence = to_json(self.text)
        return {
            "at_s": self.at_s,
            "what": self.what.value,
            "who": self.who,
            "number": self.number,
            "slot": self.slot,
            "word": self.word,
            "text": text,
            "arguments": dict(self.arguments),
        }


FACT_LONGEST_S: Final = 1e9
"""No mission lasts longer; JSON may hold whole numbers that are no float."""


def events_from_json(notes: Iterable[object]) -> list[MissionEvent]:
    """The notes of a recording.

    Raises:
        RemoteProtocolError: one is no note of a mission.
    """
    return [_event(note) for note in notes]


def _event(note: object) -> MissionEvent:
    match note:
        case {
            "at_s": int() | float() as at_s,
            "what": str(what),
            "who": str(who),
            "number": int(number),
            "slot": str(slot),
            "word": str(word),
            "text": text,
            "arguments": dict(arguments),
        } if what in {one.value for one in MissionEventKind} and abs(at_s) < FACT_LONGEST_S:
            named = {str(name): str(value) for name, value in arguments.items()}
            return MissionEvent(float(at_s), MissionEventKind(what), who, number, slot, word, from_json(text), named)
    raise RemoteProtocolError(f"no note of a mission: {note!r:.200}")
