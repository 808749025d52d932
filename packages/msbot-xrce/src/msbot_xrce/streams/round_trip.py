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

DOUBTFUL = 4
"""A measurement that is so many times shorter than the known round trip replaces it: that one included a loss."""

AT_ONCE = 16
"""A first HEARTBEAT that is answered in such a fraction of the whole wait was asked after a loss."""

QUICK = 2
"""On a lossy link so many repetitions of a question wait no longer than the question itself."""


_NEVER_YET = float("-inf")


class RoundTrip:
    """The measured time from handing a message to the link until its acknowledgement, and recent losses."""

    __slots__ = ("_spread_s", "count", "latest_s", "lossy_until", "smoothed_s")

    def __init__(self) -> None:
        self.smoothed_s: float | None = None
        """None before the first measurement."""
        self.count = 0
        """How often `measure` was told of a message and its acknowledgement."""
        self.latest_s = 0.0
        self._spread_s = 0.0
        self.lossy_until = _NEVER_YET

    def measure(self, sample_s: float, since_asked_s: float | None = None, now: float = 0.0) -> None:
        """Take one measurement.

        Args:
            sample_s: from the message to its acknowledgement.
            since_asked_s: from the HEARTBEAT in between to the acknowledgement, if there was one: nobody knows which of
                the two was acknowledged. On a lossy link it was the HEARTBEAT; elsewhere, what is more like before. The
                first time it was the HEARTBEAT if that was answered much sooner: something had been lost.
            now: the time.
        """
        self.count += 1
        if since_asked_s is not None and self._is_answer_to_heartbeat(sample_s, since_asked_s, now):
            sample_s = since_asked_s
        self.latest_s = sample_s
        self.learn(sample_s)

    def learn(self, sample_s: float) -> None:
        """Take the time of something else that was answered."""
        known = self.smoothed_s
        if known is None or sample_s * DOUBTFUL < known:
            self.smoothed_s = sample_s
            self._spread_s = sample_s / 2
        else:
            self._spread_s += (abs(sample_s - known) - self._spread_s) / 4
            self.smoothed_s = known + (sample_s - known) / 8

    def _is_answer_to_heartbeat(self, sample_s: float, since_asked_s: float, now: float) -> bool:
        known = self.smoothed_s
        if self.is_lossy(now):
            return True
        if known is None:
            return since_asked_s * AT_ONCE < sample_s
        return abs(since_asked_s - known) < abs(sample_s - known)

    def note_loss(self, now: float) -> None:
        """A message was lost, in either direction."""
        self.lossy_until = now + MEMORY_S

    def is_lossy(self, now: float) -> bool:
        """Whether a message was lost a short while ago."""
        return now < self.lossy_until

    def patience_s(self, now: float, longest_s: float, shortest_s: float, unanswered: int) -> float:
        """How long to wait for an answer before asking.

        Args:
            now: when the wait begins.
            longest_s: the wait while nothing is lost or the round trip is not known, and otherwise the longest wait; if
                the round trip itself takes longer, up to five times this.
            shortest_s: the shortest wait on a lossy link.
            unanswered: questions asked since the last answer.
        """
        # Spelled out without `min` and `max`: on a lossy link it is asked with every message.
        smoothed_s = self.smoothed_s
        if smoothed_s is None:
            return longest_s
        usual_s = 2 * smoothed_s
        wait_s = longest_s
        if now < self.lossy_until:
            expected_s = smoothed_s + 4 * self._spread_s
            expected_s = expected_s if expected_s > shortest_s else shortest_s
            if unanswered > QUICK:
                expected_s *= 1 << min(unanswered - QUICK, 16)
            if expected_s < longest_s:
                wait_s = expected_s
        elif usual_s <= longest_s:
            return longest_s
        # On a slow link the answer may still be on its way; but a peer that was busy for a long time must not silence
        # us.
        wait_s = wait_s if wait_s > usual_s else usual_s
        most_s = PATIENCE_MAX * longest_s
        return wait_s if wait_s < most_s else most_s


# Repeats a client's login or logout until there is an answer (seen on the wire: 10 times, 1 s apart).


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
