"""Who did something by hand last, and at which slot: to whom a tick of a lesson belongs, and who has mended a fault.

Pure. Everything that people do to a robot is noted here: operations, and what they do to simulated parts on the page.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from msbot.operations.operation import Operation
from msbot.operations.rights import Right
from msbot_xrce.lazy import dataclass

MOST_PLACES: Final = 1000
"""Slots of which the last act is known; of more, the one of longest ago gives way."""
STOP_BUTTON: Final = "\0stop"
"""The place of STOP and GO: no slot has this name."""
_SLOTS: Final = ("slot", "at", "to")
_PORTS: Final = ("port", "from", "to", "offers")
_OF_PUPILS: Final = (Right.SEE, Right.STOP, Right.JOIN, Right.OPERATE, Right.SET)


@dataclass(frozen=True, slots=True)
class Act:
    """What somebody did."""

    who: str
    helps: bool
    """Whether it needs rights that a pupil has not: whoever did it has helped."""
    order: int
    """Acts with a higher number came later."""


class LastActs:
    """See the module's docstring."""

    def __init__(self) -> None:
        self._acts: dict[str, Act] = {}
        self._count = 0

    def note(self, who: str, places: Iterable[str], *, helps: bool = False) -> Mapping[str, Act | None]:
        """Somebody does something at these slots; returns what `take_back` needs if nothing comes of it."""
        self._count += 1
        before = {place: self._acts.pop(place, None) for place in places}
        self._acts |= dict.fromkeys(before, Act(who, helps, self._count))
        while len(self._acts) > MOST_PLACES:
            self._acts.pop(next(iter(self._acts)))
        return before

    def take_back(self, before: Mapping[str, Act | None]) -> None:
        """It was refused: whoever did something there before did the last thing."""
        for place, act in before.items():
            self._acts.pop(place, None)
            if act is not None:
                self._acts[place] = act

    def latest(self, places: Iterable[str], after: int = 0) -> Act | None:
        """The last act at any of these slots; None: nobody has done anything there.

        Args:
            places: the slots.
            after: only acts with a higher number count.
        """
        found = [act for place in places if (act := self._acts.get(place)) is not None and act.order > after]
        return max(found, key=lambda act: act.order, default=None)

    @property
    def count(self) -> int:
        """The number of the last act."""
        return self._count

    def forget(self, who: str) -> None:
        """A person is removed: whoever has that name later has done nothing."""
        self._acts = {place: act for place, act in self._acts.items() if act.who != who}


def places_of(operation: str, arguments: Mapping[str, object]) -> set[str]:
    """The slots that an operation names by its arguments."""
    if operation in ("stop", "go"):
        return {STOP_BUTTON}
    found = {str(arguments[name]) for name in _SLOTS if isinstance(arguments.get(name), str)}
    for name in _PORTS:
        given = arguments.get(name)
        ports = given if isinstance(given, list | tuple) else [given]
        found |= {port.rpartition(".")[0] for port in ports if isinstance(port, str) and "." in port}
    return {place for place in found if place}


def helps(row: Operation) -> bool:
    """Whether a pupil may not do it."""
    return row.right not in _OF_PUPILS
