"""What the doctor says: a finding, or why something could not be looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Mending:
    """What the page may do to mend something: it can be undone, or it only adds a file."""

    name: str
    """An operation of the table, or `backup`."""
    arguments: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is not as it should be."""

    problem: str
    """What sort of problem, for programs: `bus-off`."""
    about: str
    """What has it: `can0`, `slot BB`, a file."""
    saw: str
    """What was seen, in a sentence."""
    why: str
    """Why it matters."""
    wire: str
    """How it shows in the traffic."""
    mend: str
    """The command that mends it, complete."""
    first: str = ""
    """What hands must do before; empty: nothing."""
    must: bool = True
    """False: worth knowing, may be wanted."""
    mending: Mending | None = None
    """How the page can mend it; None: not from there."""


@dataclass(frozen=True, slots=True)
class NotSeen:
    """A fact that could not be had."""

    why: str
    """Why, and where possible what would let it be seen."""


class NotNeeded(Exception):
    """Raised while facts are gathered: there is nothing here that this check could be about. The text says why."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.why = why


class CannotSee(Exception):
    """Raised while facts are gathered: this check cannot be made here. The text says why."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.why = why
