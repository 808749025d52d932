"""How a part behaves without hardware: what a person does to it, what one would see, what it publishes.

A simulator is data, read from the `[simulator]` table of a part type: *controls* (a button to press, air to warm),
*readings* (a servo's angle, a lamp's brightness; each follows a control, a field of a message or another reading) and
*outputs* (which port publishes what, and when). `msbot.sim` brings it to life.

Names of sources, wherever one is asked for: a parameter, a control, a reading further up, `port.field` for
the latest message at a port that subscribes, and `#port` for the number of messages that a port has seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum
from typing import TypeAlias

from msbot_agent.toml.problems import toml_value_in_words
from msbot_agent.toml.table import Scalar
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

FieldSource: TypeAlias = "Scalar | tuple[FieldSource, ...]"
"""Where a field of a message comes from: the name of a source, a text with sources in braces, or a value; for a list
one for each element, for a message in a list one for each of its fields."""
Operand = float | str
"""A number, or the name of a source that gives one."""


class ControlKind(Enum):
    """What a person can do with a control."""

    BOOL = "bool"
    NUMBER = "number"
    CHOICE = "choice"
    TEXT = "text"


SENSES = {
    "distance": ControlKind.NUMBER,
    "near": ControlKind.BOOL,
    "touch": ControlKind.BOOL,
    "line.place": ControlKind.NUMBER,
    "line.seen": ControlKind.BOOL,
    "colour.red": ControlKind.NUMBER,
    "colour.green": ControlKind.NUMBER,
    "colour.blue": ControlKind.NUMBER,
    "light": ControlKind.NUMBER,
    "sound": ControlKind.NUMBER,
    "magnet": ControlKind.BOOL,
    "heading": ControlKind.NUMBER,
    "pitch": ControlKind.NUMBER,
    "roll": ControlKind.NUMBER,
    "spin": ControlKind.NUMBER,
    "push.ahead": ControlKind.NUMBER,
    "push.left": ControlKind.NUMBER,
    "wheel": ControlKind.NUMBER,
    "grip.thing": ControlKind.NUMBER,
}
"""What a part can sense in an arena, and the kind of control that it sets; units: docs/howto/arena.md."""

DRIVES = (
    "motor.left",
    "motor.right",
    "servo",
    "grip.opening",
    "tone",
    "loudness",
    "lamp",
    "lamp.red",
    "lamp.green",
    "lamp.blue",
)
"""What a part can do in an arena."""

FUNCTIONS = ("none", "sin", "cos")
"""Functions that a reading can apply to a number in degrees."""


@dataclass(frozen=True, slots=True)
class Control:
    """Something a person does to the device: press the button, turn the knob, warm the air."""

    name: str
    kind: ControlKind
    start: Scalar
    """Its value before anybody does something."""
    least: float | None = None
    most: float | None = None
    """Limits of a number."""
    unit: str = ""
    words: str = ""
    """What a person does, in words."""
    choices: tuple[str, ...] = ()
    """The values of a choice."""
    momentary: bool = False
    """Goes back to `start` when released, like a push button."""
    senses: str = ""
    """What of an arena sets it, one of `SENSES`; "" = only a person does."""

    def fault(self, value: Scalar) -> str | None:
        """Why the control cannot have this value, with what would be right; None when it can."""
        match self.kind:
            case ControlKind.BOOL if not isinstance(value, bool):
                return f"must be true or false; it is {toml_value_in_words(value)}"
            case ControlKind.TEXT if not isinstance(value, str):
                return f"must be text; it is {toml_value_in_words(value)}"
            case ControlKind.CHOICE if value not in self.choices:
                return f"must be one of {', '.join(self.choices)}; it is {toml_value_in_words(value)}"
            case ControlKind.NUMBER:
                return self._fault_of_number(value)
        return None

    def parse(self, text: str) -> Scalar:
        """The value of a text as a person types it.

        Raises:
            ConfigError: the control cannot have such a value.
        """
        value: Scalar = text
        if self.kind is ControlKind.BOOL:
            value = _TRUTHS.get(text.casefold(), text)
        elif self.kind is ControlKind.NUMBER:
            value = _number(text)
        if fault := self.fault(value):
            raise ConfigError(f"control {self.name} {fault}")
        return value

    def _fault_of_number(self, value: Scalar) -> str | None:
        low = "any" if self.least is None else f"{self.least:g}"
        high = "any" if self.most is None else f"{self.most:g}"
        unit = f" {self.unit}" if self.unit else ""
        if isinstance(value, bool | str):
            return f"must be a number, {low} to {high}{unit}; it is {toml_value_in_words(value)}"
        # Written so that a NaN is out of range too.
        if (self.least is not None and not value >= self.least) or (self.most is not None and not value <= self.most):
            return f"is {value:g}; it must be {low} to {high}{unit}"
        return None if value - value == 0 else f"is {value}; it must be a finite number"


@dataclass(frozen=True, slots=True)
class Reading:
    """Something one would see or measure at the device; steps are applied in the order of the fields below."""

    name: str
    unit: str = ""
    words: str = ""
    shown: bool = True
    """Whether people see it; otherwise it only serves other readings and outputs."""
    start: Scalar | None = None
    """Its value before anything has come, and when it has expired (`lasts`)."""
    follows: str = ""
    """The source whose value it takes."""
    text: str = ""
    """Instead of `follows`: a text with sources in braces, `{red:02x}`."""
    random_every: Operand | None = None
    """Instead of `follows`: a random value from `least` to `most`, drawn again every so many seconds."""
    lasts: Operand = 0.0
    """Seconds after the message that it follows until it goes back to `start`; 0 = stays."""
    pattern: str = ""
    """Regular expression; its first group is extracted from a text. A text that does not match changes nothing."""
    equals: Scalar | None = None
    """True when the value is this one."""
    above: Operand | None = None
    """True when the value is more than this."""
    negate: str = ""
    """The name of a source; when it is true, the number changes its sign."""
    function: str = ""
    """`sin` or `cos` of the number, which is then in degrees; "" = none."""
    scale: Operand = 1.0
    offset: Operand = 0.0
    divide_by: Operand = 1.0
    """A divisor of 0 changes nothing."""
    wrap: Operand | None = None
    """The number starts again at 0 when it reaches this."""
    least: Operand | None = None
    most: Operand | None = None
    integrate: bool = False
    """The reading is the integral over time: the number says how much is added each second."""
    lag_s: Operand = 0.0
    """Time constant in seconds with which it follows its source."""
    slew_per_s: Operand = 0.0
    """Largest change per second; 0 = unlimited."""
    noise: Operand = 0.0
    """Standard deviation of the noise on it."""
    step: Operand = 0.0
    """The value is rounded to a multiple of this; 0 = not rounded."""
    rows: int = 0
    columns: int = 0
    """A text is shown in this many rows and columns; what does not fit is cut off."""
    drives: str = ""
    """What it does in an arena, one of `DRIVES`; "" = nothing."""


@dataclass(frozen=True, slots=True)
class Output:
    """What a publishing port publishes, and when."""

    port: str
    fields: Mapping[str, FieldSource]
    """Field of the message -> what it says."""
    every: Operand = 0.0
    """Period in seconds; 0 = only on a change."""
    on_change: bool = False
    """Also published at once when a field changes."""
    change: Operand = 0.0
    """A number has to change by this much to count as changed; until then the old one is repeated."""
    only_if: str = ""
    """The name of a source; while it is false, nothing is published."""

    def scalars(self) -> Iterator[Scalar]:
        """What its fields say, the elements of lists one by one."""
        for source in self.fields.values():
            yield from scalars_of(source)


@dataclass(frozen=True, slots=True)
class Simulator:
    """Controls, readings and outputs of a part type."""

    controls: tuple[Control, ...] = ()
    readings: tuple[Reading, ...] = ()
    outputs: tuple[Output, ...] = ()


def scalars_of(source: FieldSource) -> Iterator[Scalar]:
    """The elements of a source, also those of lists in it."""
    if not isinstance(source, tuple):
        yield source
        return
    for one in source:
        yield from scalars_of(one)


_TRUTHS = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}


def _number(text: str) -> Scalar:
    try:
        return float(text)
    except ValueError:
        return text
