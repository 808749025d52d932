"""STOP and GO said by a person: passed to the robot's master, and journalled with the person's name."""

from __future__ import annotations

from msbot.master import answer_of
from msbot.operations.outcome import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.pnp import StopStatus
from msbot.registry import EditKind
from msbot.runtime.sentence import counted, said


class Stopping:
    """Says STOP and GO to the parts of one running robot, and journals both, whoever says them and however."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        running.master.on_stop(self._said)

    @property
    def status(self) -> StopStatus:
        """The state of STOP: who said it, which parts have confirmed it, which have not."""
        return self._running.master.stop

    def stop(self, reason: str, who: str) -> Outcome:
        """Say STOP to all parts, before anything else; writing comes afterwards."""
        told = self._running.master.say_stop(who, reason).told
        words = counted(
            told, "STOP: {count} part is told to go to the safe state",
            "STOP: {count} parts are told to go to the safe state",
        )  # fmt: skip
        return Outcome(said("{words}: {reason}", words=words, reason=reason) if reason else words)

    def go(self, who: str) -> Outcome:
        """Let the parts work again.

        Raises:
            ConfigError: nobody said STOP.
        """
        told = self._running.master.say_go(who)
        return Outcome(
            counted(told, "STOP is over: {count} part may work again", "STOP is over: {count} parts may work again")
        )

    def stop_report(self) -> Outcome:
        """The state of STOP, as JSON: who said it, which parts have confirmed it after how many ms, which have not."""
        return Outcome(answer=answer_of(self.status))

    def _said(self, status: StopStatus) -> None:
        if status.stopped:
            words = said("STOP by {name}", name=status.by)
            if status.reason:
                words = said("{words}: {reason}", words=words, reason=status.reason)
            self._running.note(EditKind.STOP, words, status.by)
        else:
            self._running.note(EditKind.GO, said("{by} ended STOP", by=status.by), status.by)
