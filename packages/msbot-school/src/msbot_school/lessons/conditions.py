"""What a check of a lesson asks of a robot: `fan is active`, `knob.level spans 50`, `wired knob.level -> fan.power`.

Pure: a condition is asked with what the robot is like at that moment, and keeps what it has seen so far in a memory
that belongs to one run of the lesson.
"""

from __future__ import annotations

import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Final, Protocol

from msbot_agent.text.sentence import said
from msbot_school.faults.fault_kinds import Condition as PlainCondition
from msbot_school.faults.fault_kinds import NumberCondition, StateCondition, read_condition
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

LONGEST: Final = 200
"""Most characters of a condition."""
STOP: Final = "\0STOP"
"""The place where somebody says STOP or GO: no slot has this name."""
_COMPARE: Final[Mapping[str, Callable[[float, float], bool]]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "=": operator.eq,
}


class RobotState(Protocol):
    """What conditions look at: the robot at this moment."""

    def state(self, slot: str) -> str:
        """The state of the part in a slot, or of the one that was there last; `empty` when none was."""

    def is_in_state(self, slot: str, state: str) -> bool:
        """Whether it is that state; `empty`: there is no part now, whatever became of the last one."""

    def number(self, source: str) -> float | None:
        """The newest number of `SLOT.PORT` or `SLOT.PORT.FIELD`, or of `load`; None: nothing has come yet."""

    def numbers_since(self, source: str, heard: int | None) -> tuple[list[float], int]:
        """The numbers of a source that have come since a look, and what to give as `heard` at the next look; None: the
        first, which sees the newest number."""

    def part_in(self, slot: str) -> str:
        """The name of the part in a slot; empty when there is none."""

    def identity_in(self, slot: str) -> str:
        """What identifies the part in a slot, whatever it is called; empty when there is none."""

    def has_slot(self, slot: str) -> bool:
        """Whether the robot has that slot."""

    def knows(self, number: str) -> bool:
        """Whether the library has that part number."""

    def setting(self, slot: str, name: str) -> str | None:
        """The present value of a parameter; None: there is no such slot or parameter."""

    def is_wired(self, source: str, target: str) -> bool:
        """Whether `SLOT.PORT` speaks to `SLOT.PORT`."""

    @property
    def is_stopped(self) -> bool:
        """Whether STOP holds."""


@dataclass(slots=True)
class ConditionMemory:
    """What one condition has seen since its step began."""

    was: bool = False
    heard: int | None = None
    """How far the numbers of its source were seen."""
    least: float | None = None
    most: float | None = None
    first: str | None = None
    angle: float | None = None
    turned: float = 0.0


class Condition(ABC):
    """One thing that can be so or not."""

    @abstractmethod
    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:
        """Whether it is so now; called at every look, so that it can remember."""

    @abstractmethod
    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:
        """What is so instead, in words."""


@dataclass(frozen=True, slots=True)
class CurrentState(Condition):
    """A condition of the fault lab: a state, or a number beyond a limit."""

    plain: PlainCondition

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:  # noqa: ARG002 - it looks at this moment only
        """See `Condition`."""
        return self.plain.holds(robot)

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - as above
        """See `Condition`."""
        if isinstance(self.plain, StateCondition):
            return said("{slot} is {state}", slot=self.plain.slot, state=said(robot.state(self.plain.slot)))
        return _number_seen(robot, self.plain.source)

    def __str__(self) -> str:
        return str(self.plain)


@dataclass(frozen=True, slots=True)
class WasInState(Condition):
    """A part has been in a state at some time since the step began."""

    slot: str
    wanted: str

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:
        """See `Condition`."""
        memory.was = memory.was or robot.is_in_state(self.slot, self.wanted)
        return memory.was

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - what it was is not the question
        """See `Condition`."""
        return said("{slot} is {state}", slot=self.slot, state=said(robot.state(self.slot)))

    def __str__(self) -> str:
        return f"{self.slot} was {self.wanted}"


@dataclass(frozen=True, slots=True)
class MovedBy(Condition):
    """A number has moved that far since the step began."""

    source: str
    width: float

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:
        """See `Condition`."""
        values, memory.heard = robot.numbers_since(self.source, memory.heard)
        for value in values:
            memory.least = value if memory.least is None else min(memory.least, value)
            memory.most = value if memory.most is None else max(memory.most, value)
        return memory.least is not None and memory.most is not None and memory.most - memory.least >= self.width

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:
        """See `Condition`."""
        if memory.least is None or memory.most is None:
            return _number_seen(robot, self.source)
        return said(
            "{source} was between {least:g} and {most:g}",
            source=self.source,
            least=round(memory.least, 2),
            most=round(memory.most, 2),
        )

    def __str__(self) -> str:
        return f"{self.source} spans {self.width:g}"


@dataclass(frozen=True, slots=True)
class RotatedBy(Condition):
    """A direction in degrees has turned that far to one side since the step began; to and fro does not count."""

    source: str
    width: float

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:
        """See `Condition`."""
        angles, memory.heard = robot.numbers_since(self.source, memory.heard)
        for angle in angles:
            if memory.angle is not None:
                # The shorter way: between two messages nothing turns by more than half a turn.
                memory.turned += (angle - memory.angle + 180) % 360 - 180
            memory.angle = angle
        return abs(memory.turned) >= self.width

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:
        """See `Condition`."""
        if memory.angle is None:
            return _number_seen(robot, self.source)
        return said("{source} has turned by {turned:g}", source=self.source, turned=round(abs(memory.turned)))

    def __str__(self) -> str:
        return f"{self.source} turns {self.width:g}"


@dataclass(frozen=True, slots=True)
class Wired(Condition):
    """One port speaks to another."""

    source: str
    target: str

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:  # noqa: ARG002 - it looks at this moment only
        """See `Condition`."""
        return robot.is_wired(self.source, self.target)

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - as above
        """See `Condition`."""
        return said("{source} does not speak to {target}", source=self.source, target=self.target)

    def __str__(self) -> str:
        return f"wired {self.source} -> {self.target}"


@dataclass(frozen=True, slots=True)
class SettingIs(Condition):
    """A parameter of a slot has a value, or is beyond a limit."""

    slot: str
    name: str
    operator: str
    value: str

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:  # noqa: ARG002 - it looks at this moment only
        """See `Condition`."""
        value = robot.setting(self.slot, self.name)
        if value is None:
            return False
        try:
            return _COMPARE[self.operator](float(value), float(self.value))
        except ValueError:
            return self.operator == "=" and value == self.value

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - as above
        """See `Condition`."""
        value = robot.setting(self.slot, self.name)
        if value is None:
            return said("{slot} has no setting {name} now", slot=self.slot, name=self.name)
        return said("{slot}: {name} is {value}", slot=self.slot, name=self.name, value=value)

    def __str__(self) -> str:
        return f"setting {self.slot} {self.name} {self.operator} {self.value}"


@dataclass(frozen=True, slots=True)
class HeldBy(Condition):
    """A certain part is in a slot, or another one than when the step began."""

    slot: str
    part: str
    """Its name; empty: any but the first one."""

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:
        """See `Condition`."""
        if self.part:
            return robot.part_in(self.slot) == self.part
        identity = robot.identity_in(self.slot)
        if memory.first is None:
            memory.first = identity
        return bool(identity) and identity != memory.first

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - who it was is not shown
        """See `Condition`."""
        part = robot.part_in(self.slot)
        if not part:
            return said("{slot} is empty", slot=self.slot)
        return said("in {slot} there is {part}", slot=self.slot, part=part)

    def __str__(self) -> str:
        return f"{self.slot} has {self.part or 'another part'}"


@dataclass(frozen=True, slots=True)
class Exists(Condition):
    """The robot has a slot, or knows a part number."""

    kind: str
    name: str

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:  # noqa: ARG002 - it looks at this moment only
        """See `Condition`."""
        return robot.has_slot(self.name) if self.kind == "slot" else robot.knows(self.name)

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - as above
        """See `Condition`."""
        if self.kind == "slot":
            return said("there is no slot {name}", name=self.name)
        return said("the library does not know {name}", name=self.name)

    def __str__(self) -> str:
        return f"{self.kind} {self.name} exists"


@dataclass(frozen=True, slots=True)
class Stopped(Condition):
    """STOP holds, or does not."""

    wanted: bool

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:  # noqa: ARG002 - it looks at this moment only
        """See `Condition`."""
        return robot.is_stopped is self.wanted

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - as above
        """See `Condition`."""
        return said("STOP holds") if robot.is_stopped else said("STOP does not hold")

    def __str__(self) -> str:
        return "stopped" if self.wanted else "not stopped"


@dataclass(frozen=True, slots=True)
class NotCondition(Condition):
    """Another condition does not hold."""

    other: Condition

    def holds(self, robot: RobotState, memory: ConditionMemory) -> bool:
        """See `Condition`."""
        return not self.other.holds(robot, memory)

    def describe_actual(self, robot: RobotState, memory: ConditionMemory) -> str:  # noqa: ARG002 - it says what should not be
        """See `Condition`."""
        return said("{condition} still holds", condition=str(self.other))

    def __str__(self) -> str:
        return f"not {self.other}"


_SLOT = r"(?P<slot>[^\s<>=]+)"
_FORMS: Final[tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], Condition]], ...]] = (
    (re.compile("stopped"), lambda _: Stopped(wanted=True)),
    (re.compile("not stopped"), lambda _: Stopped(wanted=False)),
    (
        re.compile(r"wired\s+(?P<from>\S+\.\S+)\s*->\s*(?P<to>\S+\.\S+)"),
        lambda found: Wired(found["from"], found["to"]),
    ),
    (
        re.compile(rf"setting\s+{_SLOT}\s+(?P<name>[^\s<>=]+)\s*(?P<operator>>=|<=|>|<|=)\s*(?P<value>\S.*)"),
        lambda found: SettingIs(found["slot"], found["name"], found["operator"], found["value"].strip()),
    ),
    (re.compile(rf"{_SLOT}\s+has\s+another\s+part"), lambda found: HeldBy(found["slot"], "")),
    (re.compile(rf"{_SLOT}\s+has\s+(?P<part>\S+)"), lambda found: HeldBy(found["slot"], found["part"])),
    (re.compile(r"(?P<kind>slot|type)\s+(?P<name>\S+)\s+exists"), lambda found: Exists(found["kind"], found["name"])),
    (
        re.compile(r"(?P<source>[^\s<>=]+)\s+spans\s+(?P<width>\d+(?:\.\d+)?)"),
        lambda found: MovedBy(found["source"], float(found["width"])),
    ),
    (
        re.compile(r"(?P<source>[^\s<>=]+)\s+turns\s+(?P<width>\d+(?:\.\d+)?)"),
        lambda found: RotatedBy(found["source"], float(found["width"])),
    ),
)  # fmt: skip
EXAMPLES: Final = (
    "fan is active", "fan was lost", "knob.level > 60", "knob.level spans 50", "compass.heading turns 300",
    "wired knob.level -> fan.power", "setting fan maximum = 50", "BB has DD", "knob has another part",
    "slot lamp exists", "type LUX-1 exists", "stopped", "not stopped",
)  # fmt: skip
"""One of each kind."""


def read_lesson_condition(text: str) -> Condition:
    """The condition that a teacher has written.

    Raises:
        ConfigError: it cannot be read; the text says what would be right.
    """
    words = text.strip()
    if len(words) > LONGEST:
        raise ConfigError(said("a condition has at most {most} characters", most=LONGEST))
    for pattern, make in _FORMS:
        if found := pattern.fullmatch(words):
            return make(found)
    if words.startswith("not "):
        return NotCondition(read_lesson_condition(words.removeprefix("not ")))
    if found := re.fullmatch(rf"{_SLOT}\s+was\s+(?P<state>\S+)", words):
        plain = read_condition(f"{found['slot']} is {found['state']}")  # which says what states there are
        assert isinstance(plain, StateCondition)
        return WasInState(plain.slot, plain.wanted)
    try:
        return CurrentState(read_condition(words))
    except ConfigError as error:
        if re.fullmatch(rf"{_SLOT}\s+is\s+\S+", words):
            raise
        raise ConfigError(
            said(
                "the condition {text!r} cannot be read; write for example {examples}",
                text=words,
                examples=", ".join(f"'{one}'" for one in EXAMPLES),
            )
        ) from error


def sources(condition: Condition) -> tuple[str, ...]:
    """The ports whose numbers the condition looks at."""
    match condition:
        case CurrentState(plain=NumberCondition(source=source)) | MovedBy(source=source):
            return (source,)
        case NotCondition(other=other):
            return sources(other)
    return ()


def places(condition: Condition) -> tuple[set[str], set[str]]:
    """Where somebody does something for a condition: at these slots, and at those that speak to these slots."""
    match condition:
        case (
            CurrentState(plain=StateCondition(slot=slot))
            | WasInState(slot=slot)
            | SettingIs(slot=slot)
            | HeldBy(slot=slot)
        ):
            return {slot}, set()
        case CurrentState(plain=NumberCondition(source=source)) | MovedBy(source=source) | RotatedBy(source=source):
            return set(), {source.partition(".")[0]}
        case Wired(source=source, target=target):
            return {source.partition(".")[0], target.partition(".")[0]}, set()
        case Exists(name=name):
            return {name}, set()
        case Stopped():
            return {STOP}, set()
        case NotCondition(other=other):
            return places(other)
    return set(), set()


def _number_seen(robot: RobotState, source: str) -> str:
    value = robot.number(source)
    if value is None:
        return said("nothing has come from {source} yet", source=source)
    return said("{source} is {value:g}", source=source, value=round(value, 2))
