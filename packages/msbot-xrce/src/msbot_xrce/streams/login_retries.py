"""Repeats a client's login or logout until there is an answer (seen on the wire: 10 times, 1 s apart)."""

from __future__ import annotations


class Retries:
    """Counts tries and knows when the next one is due."""

    __slots__ = ("_limit", "_period_s", "count", "next_at")

    def __init__(self, period_s: float, limit: int | None) -> None:
        """Prepare for `limit` tries (None = without end), one every `period_s` seconds."""
        self._period_s = period_s
        self._limit = limit
        self.count = 0
        """Tries since `begin`."""
        self.next_at: float | None = None
        """When to call `take`; None while nothing is being asked."""

    def begin(self, now: float) -> None:
        """Start counting: the first try is made now."""
        self.count = 1
        self.next_at = now + self._period_s

    def take(self, now: float) -> bool:
        """Use up the try that is due; False when none is left and the retries end."""
        if self.count == self._limit:
            self.next_at = None
            return False
        self.count += 1
        self.next_at = now + self._period_s
        return True

    def end(self) -> None:
        """Stop: there is an answer, or it is not wanted any more."""
        self.next_at = None
