"""What is wrong with a robot on purpose, and since when: the script's own knowledge, from which the oracle judges."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

ALL = "all"
"""Concerns every part: the master, or this script itself."""
KEPT_S = 300.0


@dataclass(slots=True)
class Trouble:
    """Something is wrong."""

    what: str
    whom: frozenset[str]
    """Slots, or `ALL`."""
    began: float
    ended: float | None = None


class Troubles:
    """All troubles of the last minutes."""

    def __init__(self, began: float) -> None:
        self._began = began
        self._known: list[Trouble] = []

    def begin(self, now: float, what: str, whom: Iterable[str]) -> Trouble:
        """Something goes wrong."""
        self._known = [one for one in self._known if one.ended is None or now - one.ended < KEPT_S]
        trouble = Trouble(what, frozenset(whom), now)
        self._known.append(trouble)
        return trouble

    def note(self, began: float, ended: float, what: str, whom: Iterable[str]) -> None:
        """Something was wrong."""
        self.begin(began, what, whom).ended = ended

    def of(self, slot: str) -> list[Trouble]:
        """What concerns that slot, the latest end first, what has not ended before all others."""
        found = [one for one in self._known if slot in one.whom or ALL in one.whom]
        return sorted(found, key=lambda one: -(float("inf") if one.ended is None else one.ended))

    def clear_since(self, slot: str) -> float | None:
        """Since when nothing is wrong with it; None: something is."""
        found = self.of(slot)
        return found[0].ended if found else self._began
