"""How often each of many callers may do something: at a steady rate, and after a pause more at once.

Pure: time is handed in.
"""

from __future__ import annotations

from collections.abc import Hashable

MOST_CALLERS = 1000
"""Callers whose calls are counted at a time: the one that has called longest ago is forgotten."""


class SteadyRate:
    """See the module's docstring.

    Args:
        per_s: calls a second that each may make for ever.
        burst: calls that each may make at once.
        most: callers remembered; whoever is forgotten may make `burst` calls again.
    """

    def __init__(self, per_s: float, burst: float, most: int = MOST_CALLERS) -> None:
        self.per_s = per_s
        self._burst = burst
        self._most = most
        self._spent: dict[Hashable, tuple[float, float]] = {}
        """Calls that are not made up for yet, and when that was; who has called last comes last."""

    def wait_s(self, caller: Hashable, now: float) -> float:
        """How long that caller has to wait for the next call; 0: not at all."""
        return max(0.0, (self._owed(caller, now) + 1.0 - self._burst) / self.per_s)

    def debt_s(self, caller: Hashable, now: float) -> float:
        """How long that caller has to rest to make up for what was too much; 0: not at all."""
        return max(0.0, (self._owed(caller, now) - self._burst) / self.per_s)

    def note(self, caller: Hashable, now: float, calls: float = 1.0) -> None:
        """A call is made, or something that counts as so many."""
        owed = self._owed(caller, now)
        self._spent.pop(caller, None)
        if len(self._spent) >= self._most:
            del self._spent[next(iter(self._spent))]
        self._spent[caller] = owed + calls, now

    def _owed(self, caller: Hashable, now: float) -> float:
        owed, at = self._spent.get(caller, (0.0, now))
        return max(0.0, owed - (now - at) * self.per_s)
