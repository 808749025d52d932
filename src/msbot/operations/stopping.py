"""STOP: all parts go to their safe states, and how long that took."""

from __future__ import annotations

from dataclasses import dataclass, field

from msbot.errors import ConfigError
from msbot.operations.outcome import Outcome
from msbot.operations.running import RunningRobot


@dataclass(slots=True)
class StopReport:
    """A STOP that holds."""

    at: float
    """When it was said, by the robot's clock."""
    who: str
    reason: str
    told: int
    """Parts that were told."""
    waiting: set[int] = field(default_factory=set)
    """Client keys of parts that have not confirmed it yet."""
    latency_ms: float | None = None
    """Until the last part had confirmed it; None: not all have yet."""

    @property
    def confirmed(self) -> int:
        """Parts that have confirmed it."""
        return self.told - len(self.waiting)


class Stopping:
    """Says STOP and GO to the parts of one running robot."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self.report: StopReport | None = None
        """The STOP that holds, or None."""
        running.master.on_stop = lambda reason: self.stop(reason, "somebody at the robot")

    def stop(self, reason: str, who: str) -> Outcome:
        """Say STOP to all parts, first of all; what is to be written comes after."""
        now = self._running.now()
        told = self._running.master.stop_parts()
        registered = {info.client_key for info in self._running.inventory.view(now) if info.state.is_registered}
        self.report = StopReport(now, who, reason, len(registered), registered)
        self._running.inventory.beat_heard = self._confirmed
        why = f": {reason}" if reason else ""
        words = f"STOP: {told} parts are told to go to their safe states{why}"
        self._running.note("stop", f"STOP by {who}{why}", who)
        return Outcome(words)

    def go_on(self, who: str) -> Outcome:
        """Let the parts work again."""
        if self.report is None:
            raise ConfigError("nobody said STOP: there is nothing to end")
        told = self._running.master.go_parts()
        self.report = None
        self._running.inventory.beat_heard = None
        self._running.note("go", f"{who} ended STOP", who)
        return Outcome(f"STOP is over: {told} parts may work again")

    def _confirmed(self, client_key: int, now: float) -> None:
        report = self.report
        if report is None or client_key not in report.waiting:
            return
        report.waiting.discard(client_key)
        if not report.waiting:
            report.latency_ms = (now - report.at) * 1000
            self._running.inventory.beat_heard = None
