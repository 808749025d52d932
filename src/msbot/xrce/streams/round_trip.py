"""How long the peer takes to acknowledge, and therefore how long to wait before asking it (after RFC 6298).

A loss at the end of a burst shows only as silence. On a lossy link, waiting a fixed time each time would cost the time
of hundreds of messages. So there the wait follows the measured round trip, and doubles with every question that goes
unanswered. As long as nothing is lost, questions are as rare as those of the genuine peers, so a client that is merely
slow to answer is not pestered.
"""

from __future__ import annotations

PATIENCE_MAX = 5
"""On a slow link a question waits at most this many periods, however long the round trip was."""

MEMORY_S = 10.0
"""How long after a loss the link counts as lossy."""


class RoundTrip:
    """The measured time from handing a message to the link until its acknowledgement, and recent losses."""

    __slots__ = ("_lossy_until", "_spread_s", "count", "latest_s", "smoothed_s")

    def __init__(self) -> None:
        self.smoothed_s: float | None = None
        """None before the first measurement."""
        self.count = 0
        """Measurements so far."""
        self.latest_s = 0.0
        self._spread_s = 0.0
        self._lossy_until = float("-inf")

    def measure(self, sample_s: float) -> None:
        """Take one measurement."""
        self.count += 1
        self.latest_s = sample_s
        known = self.smoothed_s
        if known is None:
            self.smoothed_s = sample_s
            self._spread_s = sample_s / 2
        else:
            self._spread_s += (abs(sample_s - known) - self._spread_s) / 4
            self.smoothed_s = known + (sample_s - known) / 8

    def note_loss(self, now: float) -> None:
        """A message was lost, in either direction."""
        self._lossy_until = now + MEMORY_S

    def patience_s(self, now: float, longest_s: float, shortest_s: float, unanswered: int) -> float:
        """How long to wait for an answer before asking.

        Args:
            now: when the wait begins.
            longest_s: the wait while nothing is lost or the round trip is not known, and otherwise the longest wait; if
                the round trip itself takes longer, up to five times this.
            shortest_s: the shortest wait on a lossy link.
            unanswered: questions asked since the last answer.
        """
        smoothed_s = self.smoothed_s
        if smoothed_s is None:
            return longest_s
        wait_s = longest_s
        if now < self._lossy_until:
            expected_s = max(smoothed_s + 4 * self._spread_s, shortest_s)
            wait_s = min(longest_s, expected_s * (1 << min(unanswered, 16)))
        # On a slow link the answer may still be on its way; but a peer that was busy for a long time must not silence
        # us.
        return min(max(wait_s, 2 * smoothed_s), PATIENCE_MAX * longest_s)
