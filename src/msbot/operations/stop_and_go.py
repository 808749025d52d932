"""STOP and GO as a person's deeds: said to the robot's master, and kept in its journal with who said it."""

from __future__ import annotations

from msbot.master import answer_of
from msbot.operations.outcome import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.pnp import StopStatus
from msbot.registry import EditKind


class Stopping:
    """Says STOP and GO to the parts of one running robot, and journals both, whoever says them and by whatever way."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        running.master.on_stop(self._said)

    @property
    def status(self) -> StopStatus:
        """STOP as it stands: who said it, which parts have confirmed it, which have not."""
        return self._running.master.stop

    def stop(self, reason: str, who: str) -> Outcome:
        """Say STOP to all parts, first of all; what is to be written comes after."""
        told = self._running.master.say_stop(who, reason).told
        why = f": {reason}" if reason else ""
        return Outcome(f"STOP: {_parts(told)} told to go to the safe state{why}")

    def go(self, who: str) -> Outcome:
        """Let the parts work again.

        Raises:
            ConfigError: nobody said STOP.
        """
        told = self._running.master.say_go(who)
        return Outcome(f"STOP is over: {told} part{'' if told == 1 else 's'} may work again")

    def stop_report(self) -> Outcome:
        """STOP as it stands, as JSON: who said it, which parts have confirmed it in how many ms, which have not."""
        return Outcome(answer=answer_of(self.status))

    def _said(self, status: StopStatus) -> None:
        if status.stopped:
            why = f": {status.reason}" if status.reason else ""
            self._running.note(EditKind.STOP, f"STOP by {status.by}{why}", status.by)
        else:
            self._running.note(EditKind.GO, f"{status.by} ended STOP", status.by)


def _parts(count: int) -> str:
    return f"{count} part is" if count == 1 else f"{count} parts are"
