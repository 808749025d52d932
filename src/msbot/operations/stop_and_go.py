"""STOP and GO said by a person: passed to the robot's master, and journalled with the person's name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msbot.master import answer_of
from msbot.operations.outcome import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.pnp import StopStatus
from msbot.registry import EditKind
from msbot.runtime.sentence import counted, said


class Stopping:
    """Says STOP and GO to the parts of one running robot, and journals both, whoever says them and however.

    Args:
        running: the robot.
        on_said: called with the operation (`stop` or `go`), who said it, its arguments and the journal's words, also
            where it came by a way of its own: the socket of `msbot stop`, an agent elsewhere.
    """

    def __init__(
        self, running: RunningRobot, *, on_said: Callable[[str, str, Mapping[str, object], str], object]
    ) -> None:
        self._running = running
        self._on_said = on_said
        running.master.on_stop_said(self._said)

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

    def _said(self, is_stop: bool, by: str, reason: str) -> None:
        if is_stop:
            words = said("STOP by {name}", name=by)
            if reason:
                words = said("{words}: {reason}", words=words, reason=reason)
            self._running.note(EditKind.STOP, words, by)
            self._on_said("stop", by, {"reason": reason} if reason else {}, words)
        else:
            words = said("{by} ended STOP", by=by)
            self._running.note(EditKind.GO, words, by)
            self._on_said("go", by, {}, words)
