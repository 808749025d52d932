"""Conditions on which a fault begins: `fan is active`, `knob.level.percent > 60`, `load > 40`. Pure."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Final, Protocol

from msbot.pnp.part_events import PartState
from msbot_agent.text.sentence import said
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

_OPERATORS: Final[Mapping[str, Callable[[float, float], bool]]] = {
    ">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt, "=": operator.eq,
}  # fmt: skip
_STATES: Final = ("empty", *(state.value for state in PartState))
_STATE = re.compile(r"\s*(?P<slot>\S+)\s+is\s+(?P<state>\S+)\s*")
_NUMBER = re.compile(r"\s*(?P<source>[^\s<>=]+)\s*(?P<operator>>=|<=|>|<|=)\s*(?P<number>\S+)\s*")
LOAD: Final = "load"
"""The load of the simulated bus in percent, as a source."""


class Circumstances(Protocol):
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

    def holds(self, world: Circumstances) -> bool:
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

    def holds(self, world: Circumstances) -> bool:
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
