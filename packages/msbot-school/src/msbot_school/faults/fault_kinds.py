"""The kinds of faults: what each one is, where it acts, what can be said about it, and which contradict each other."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from random import Random
from typing import Final, Protocol

from msbot.pnp.part_events import PartState
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


class InjectionPoint(Enum):
    """Where a fault acts."""

    EDGE = "at the agent's edge: on real and on simulated parts"
    GUEST = "a part that the fault lab plugs in itself"
    SENSOR = "in a part that is simulated in the master's process"
    BUS = "on a CAN bus that is simulated in the master's process"
    MASTER = "in the master"


@dataclass(frozen=True, slots=True)
class Amount:
    """How strong a fault is."""

    default: float
    least: float
    most: float
    unit: str
    words: str


@dataclass(frozen=True, slots=True)
class FaultKind:
    """One kind of fault."""

    name: str
    words: str
    """What it is, after "a fault is planted: "."""
    acts: InjectionPoint
    at_part: bool = True
    """Whether it is planted at a part; else at the robot as a whole."""
    amount: Amount | None = None
    options: frozenset[str] = frozenset()
    """What else can be said: `jitter`, `port`, `number`."""
    cuts_off: bool = False
    """Whether nothing comes from the part any more."""


_PERCENT = {"least": 0.1, "most": 100.0, "unit": "%"}

_ROWS = (
    FaultKind("unplug", said("the part is pulled out"), InjectionPoint.EDGE, cuts_off=True),
    FaultKind("late", said("what the part sends comes late, all at once"), InjectionPoint.EDGE,
              amount=Amount(3.5, 0.1, 60.0, "s", said("longest time that a beat is held back"))),
    FaultKind("loss", said("packets are lost"), InjectionPoint.EDGE,
              amount=Amount(30.0, words=said("of the packets are lost"), **_PERCENT)),  # type: ignore[arg-type]
    FaultKind("delay", said("packets come late"), InjectionPoint.EDGE, options=frozenset({"jitter"}),
              amount=Amount(300.0, 1.0, 10_000.0, "ms", said("that each packet takes longer"))),
    FaultKind("duplicates", said("packets come twice"), InjectionPoint.EDGE,
              amount=Amount(50.0, words=said("of the packets come twice"), **_PERCENT)),  # type: ignore[arg-type]
    FaultKind("reordering", said("packets overtake each other"), InjectionPoint.EDGE,
              amount=Amount(50.0, words=said("of the packets are overtaken"), **_PERCENT)),  # type: ignore[arg-type]
    FaultKind("slow-consumer", said("the part takes what is for it too slowly"), InjectionPoint.EDGE,
              amount=Amount(1.0, 0.1, 1000.0, "/s", said("packets that it takes"))),
    FaultKind("duplicate-identity", said("a second part has the same identity"), InjectionPoint.GUEST),
    FaultKind("wrong-number", said("a part with a wrong number is in its place"), InjectionPoint.GUEST,
              options=frozenset({"number"}), cuts_off=True),
    FaultKind("wrong-key", said("a part with a wrong key is in its place"), InjectionPoint.GUEST, cuts_off=True),
    FaultKind("stuck", said("its sensor is stuck"), InjectionPoint.SENSOR, options=frozenset({"port"})),
    FaultKind("drift", said("its sensor drifts"), InjectionPoint.SENSOR, options=frozenset({"port"}),
              amount=Amount(60.0, -1e6, 1e6, "/min", said("that its values move"))),
    FaultKind("bus-off", said("its controller sends broken frames until it leaves the bus"), InjectionPoint.BUS,
              cuts_off=True),
    FaultKind("bit-errors", said("bits on the bus are inverted"), InjectionPoint.BUS, at_part=False,
              amount=Amount(500.0, 1.0, 100_000.0, "/million", said("of the bits are inverted"))),
    FaultKind("babbling", said("a node fills the bus with frames before all others"), InjectionPoint.BUS, at_part=False,
              amount=Amount(60.0, words=said("of the bus time is its own"), **_PERCENT)),  # type: ignore[arg-type]
    FaultKind("master-frozen", said("the master neither hears nor answers any part"), InjectionPoint.MASTER,
              at_part=False),
    FaultKind("database-gone", said("the database cannot be reached"), InjectionPoint.MASTER, at_part=False),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class PacketFault:
    """A kind of fault that an extension brings: it disturbs the packets of a part at the agent's edge."""

    kind: FaultKind
    """Its name is that of the entry point, and it acts at `InjectionPoint.EDGE`."""
    treat: Callable[[float, Random], object]
    """`(amount, chance)`: what happens to the packets, as `msbot_school.faults.PacketTreatment` says."""


class _Kinds(Mapping[str, FaultKind]):
    """MsBOT's own, then those of extensions."""

    def __init__(self, own: Iterable[FaultKind]) -> None:
        self._own = {row.name: row for row in own}

    def __getitem__(self, name: str) -> FaultKind:
        found = self._own.get(name)
        if found is None:
            return self.brought()[name].kind
        return found

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from self.brought()

    def __len__(self) -> int:
        return len(self._own) + len(self.brought())

    def brought(self) -> dict[str, PacketFault]:
        """Those of extensions."""
        found = extensions().all("faults", PacketFault, self._own)
        for name, one in tuple(found.items()):
            if one.kind.name != name or one.kind.acts is not InjectionPoint.EDGE:
                why = (
                    f"its kind is {one.kind.name!r} and acts {one.kind.acts.value}; it needs the name {name!r} and "
                    "InjectionPoint.EDGE"
                )
                extensions().leave_out_named("faults", name, why)
                del found[name]
        return found


KINDS: Final = _Kinds(_ROWS)
"""Every kind by its name, in the order of the reference."""

_BOTH_SAY = ({"late", "delay"}, {"stuck", "drift"})
"""Kinds that say something different about the same thing."""


def kind_named(name: str) -> FaultKind:
    """The kind of that name.

    Raises:
        ConfigError: there is none; the text lists them.
    """
    kind = KINDS.get(name)
    if kind is None:
        raise ConfigError(said("there is no fault {name!r}; {hint}", name=name, hint=instead_of(name, KINDS)))
    return kind


def contradiction(one: FaultKind, one_at: str, other: FaultKind, other_at: str) -> str:
    """Why two faults cannot be there at the same time, as the second half of a sentence; empty: they can."""
    if one.name == other.name and one_at == other_at:
        return said("the same fault cannot be there twice")
    frozen = [kind for kind in (one, other) if kind.name == "master-frozen"]
    if frozen:
        second = other if frozen[0] is one else one
        if second.acts is InjectionPoint.EDGE and second.name != "unplug":
            return said("while the master is frozen nothing comes or goes that could be disturbed")
        return ""
    if one_at != other_at or not one_at:
        return ""
    if one.cuts_off or other.cuts_off:
        return said("while {at} is cut off there is nothing of it that could be disturbed", at=one_at)
    if {one.name, other.name} in _BOTH_SAY:
        return said("both say something different about the same thing")
    return ""


# Conditions on which a fault begins: `fan is active`, `knob.level.percent > 60`, `load > 40`. Pure.


_OPERATORS: Final[Mapping[str, Callable[[float, float], bool]]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "=": operator.eq,
}
_STATES: Final = ("empty", *(state.value for state in PartState))
_STATE = re.compile(r"\s*(?P<slot>\S+)\s+is\s+(?P<state>\S+)\s*")
_NUMBER = re.compile(r"\s*(?P<source>[^\s<>=]+)\s*(?P<operator>>=|<=|>|<|=)\s*(?P<number>\S+)\s*")
LOAD: Final = "load"
"""The load of the simulated bus in percent, as a source."""


class ConditionInputs(Protocol):
    """What conditions look at."""

    def is_in_state(self, slot: str, state: str) -> bool:
        """Whether the part in a slot is in a state, or the one that was there last; `empty`: there is none now."""

    def number(self, source: str) -> float | None:
        """The newest number of `SLOT.PORT.FIELD`, or the load; None: nothing has come yet."""


@dataclass(frozen=True, slots=True)
class StateCondition:
    """The part in a slot has a state."""

    slot: str
    wanted: str

    def holds(self, world: ConditionInputs) -> bool:
        """Whether it is so now."""
        return world.is_in_state(self.slot, self.wanted)

    def __str__(self) -> str:
        return f"{self.slot} is {self.wanted}"


@dataclass(frozen=True, slots=True)
class NumberCondition:
    """A number of a port, or the load of the bus, is beyond a limit."""

    source: str
    operator: str
    limit: float

    def holds(self, world: ConditionInputs) -> bool:
        """Whether it is so now."""
        value = world.number(self.source)
        return value is not None and _OPERATORS[self.operator](value, self.limit)

    def __str__(self) -> str:
        return f"{self.source} {self.operator} {self.limit:g}"


Condition = StateCondition | NumberCondition


def read_condition(text: str) -> Condition:
    """The condition that a person has written.

    Raises:
        ConfigError: it cannot be read; the text says what would be right.
    """
    if found := _STATE.fullmatch(text):
        if found["state"] not in _STATES:
            raise ConfigError(
                said(
                    "the condition {text!r}: there is no state {state!r}; there are {states}",
                    text=text,
                    state=found["state"],
                    states=", ".join(_STATES),
                )
            )
        return StateCondition(found["slot"], found["state"])
    if found := _NUMBER.fullmatch(text):
        try:
            limit = float(found["number"])
        except ValueError:
            limit = math.nan
        if math.isfinite(limit) and (found["source"] == LOAD or found["source"].count(".") >= 1):
            return NumberCondition(found["source"], found["operator"], limit)
    raise ConfigError(
        said(
            "the condition {text!r} cannot be read; write for example 'fan is active', 'knob.level > 60' or "
            "'load > 40'",
            text=text,
        )
    )
