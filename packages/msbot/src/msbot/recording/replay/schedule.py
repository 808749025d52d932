"""When each recorded sample is due. Pure: the time comes in, deadlines go out.

Theory of operation. The time of the recording passes while the schedule goes, `speed` times as fast as the clock, and
stands still while it is held. Nothing is ever skipped: a sample that was due when the schedule was held is due at once
when it goes on, and those after it keep their distances to it.
"""

from __future__ import annotations

from collections.abc import Sequence

NS = 1_000_000_000


class Schedule:
    """The state of one replay: how far it is, and whether it goes.

    The owner calls `go` and `hold`, publishes what `due` names and says `done`, and comes back when `timer` says so.

    Args:
        times_ns: when the samples happened, in order.
        begin_ns: the moment in the recording at which the replay begins, not after the first sample.
        speed: seconds of the recording in one second; more than 0.
    """

    def __init__(self, times_ns: Sequence[int], *, begin_ns: int, speed: float = 1.0) -> None:
        self._times_ns = times_ns
        self._speed = speed
        self._next = 0
        self._position_ns = begin_ns
        """The moment of the recording at `_since`; while it is held, the present one."""
        self._since: float | None = None
        """Seconds of the owner's clock; None: it is held."""

    @property
    def is_going(self) -> bool:
        """Whether time passes."""
        return self._since is not None

    @property
    def ended(self) -> bool:
        """Whether every sample is done."""
        return self._next == len(self._times_ns)

    def go(self, now: float) -> None:
        """Let time pass from now on; nothing changes if it does."""
        if self._since is None:
            self._since = now

    def hold(self, now: float) -> None:
        """Let time stand still from now on; nothing changes if it does."""
        if self._since is None:
            return
        position_ns = self._position_ns + round((now - self._since) * self._speed * NS)
        limit_ns = position_ns if self.ended else min(position_ns, self._times_ns[self._next])
        self._position_ns = max(self._position_ns, limit_ns)
        self._since = None

    def due(self, now: float) -> int | None:
        """The number of the sample to be published now; None: there is none now."""
        at = self.timer()
        return self._next if at is not None and at <= now else None

    def done(self) -> None:
        """The sample that was due has been published."""
        self._next += 1

    def timer(self) -> float | None:
        """When the next sample is due; None: it is held, or over."""
        if self._since is None or self.ended:
            return None
        return self._since + (self._times_ns[self._next] - self._position_ns) / (self._speed * NS)
