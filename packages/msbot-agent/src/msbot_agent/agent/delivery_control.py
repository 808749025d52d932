"""How a READ_DATA limits the samples sent to the client: how many, for how long, how fast.

All four limits of the delivery control are obeyed (XRCE 1.0 §7.7.9; the genuine agent ignores the pace). A sample that
may not go yet stays in the reader's history.
"""

from __future__ import annotations

import math

from msbot_xrce.messages import DeliveryControl

UNLIMITED_SAMPLES = 0xFFFF
"""The `max_samples` that means no limit."""

NEVER = math.inf
"""A time that never comes."""

_ROUNDING = 1e-3
"""Octets by which rounding may fall short after exactly the time that was waited."""


class ReadTask:
    """One running READ_DATA of a reader, requester or replier.

    The byte rate is a token bucket that holds one second's worth. A sample larger than that may go when the bucket is
    full; the debt then delays the next one. DEVIATION: the genuine agent never sends a sample larger than the rate and
    gets stuck behind it.
    """

    __slots__ = ("_bytes_per_s", "_filled_at", "_next_at", "_pace_s", "_remaining", "_tokens", "_until", "limited",
                 "request_id", "stream_id")  # fmt: skip

    def __init__(self, request_id: int, stream_id: int, control: DeliveryControl | None, now: float) -> None:
        """Start a read; no control means exactly one sample (seen on the wire)."""
        self.request_id = request_id
        self.stream_id = stream_id
        samples = 1 if control is None else control.max_samples
        self._remaining = None if samples == UNLIMITED_SAMPLES else samples
        self._until = now + control.max_elapsed_s if control is not None and control.max_elapsed_s else NEVER
        self._bytes_per_s = control.max_bytes_per_second if control is not None else 0
        self._pace_s = control.min_pace_ms / 1000 if control is not None else 0.0
        self._tokens = float(self._bytes_per_s)
        self._filled_at = now
        self._next_at = now
        self.limited = bool(self._remaining is not None or self._until < NEVER or self._bytes_per_s or self._pace_s)
        """False when every sample may go at once: `ready_at` and `sent` need not be called."""

    @property
    def finished(self) -> bool:
        """Whether the number of samples is used up."""
        return self._remaining == 0

    def ready_at(self, size: int, now: float) -> float:
        """When a sample of that many octets may go: `now` = at once, `NEVER` = not in this read."""
        if self._remaining == 0 or now >= self._until:
            return NEVER
        ready_at = self._next_at
        if self._bytes_per_s:
            ready_at = max(ready_at, self._affordable_at(size, now))
        if ready_at <= now:
            return now
        return ready_at if ready_at < self._until else NEVER

    def sent(self, size: int, now: float) -> None:
        """Account for a sample that was sent."""
        if self._remaining is not None:
            self._remaining -= 1
        if self._bytes_per_s:
            self._fill(now)
            self._tokens -= size
        self._next_at = now + self._pace_s

    def _affordable_at(self, size: int, now: float) -> float:
        self._fill(now)
        missing = min(size, self._bytes_per_s) - self._tokens
        return now if missing <= _ROUNDING else now + missing / self._bytes_per_s

    def _fill(self, now: float) -> None:
        gained = (now - self._filled_at) * self._bytes_per_s
        self._tokens = min(float(self._bytes_per_s), self._tokens + gained)
        self._filled_at = now
