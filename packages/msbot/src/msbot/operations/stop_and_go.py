"""STOP and GO said by a person: passed to the robot's master, and journalled with the person's name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from msbot.master import answer_of
from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.pnp import StopStatus
from msbot.registry import EditKind
from msbot.registry.edits.editing import NotedLine
from msbot_agent.text.sentence import counted, said

ANSWER_S = 0.8
"""Longest time that the answer waits until STOP is stored: a page that hears nothing says soon that nobody obeys."""
COUNT_S = 2.0
"""Period in which the journal says how often a person has repeated a STOP."""
MOST_PEOPLE = 32
"""People with a line of their own for one STOP; the others share one."""
OTHERS = "others"


@dataclass(slots=True)
class _JournalLine:
    """What the journal says of one person's STOP."""

    words: str
    noted: NotedLine
    first_at: float
    last_at: float
    count: int = 1
    told: int = 1
    """The count that the journal has."""


class StopOperations:
    """Says STOP and GO to the parts of one running robot, and journals both, whoever says them and however.

    Args:
        running: the robot.
        on_said: called with the operation (`stop` or `go`), who said it, its arguments and the journal's words, also
            where it came by a way of its own: the socket of `msbot stop`, an agent elsewhere. Not when a person repeats
            a STOP that holds.
    """

    def __init__(
        self, running: RunningRobot, *, on_said: Callable[[str, str, Mapping[str, object], str], object]
    ) -> None:
        self._running = running
        self._on_said = on_said
        self._lines: dict[str, _JournalLine] = {}
        """By person, of the STOP that holds."""
        self._is_counting = False
        running.master.on_stop_said(self._said)

    @property
    def status(self) -> StopStatus:
        """The state of STOP: who said it, which parts have confirmed it, which have not."""
        return self._running.master.stop

    async def stop(self, reason: str, who: str, place: str = "") -> Outcome:
        """Say STOP to all parts, before anything else; then have it stored; then answer."""
        said_now = self._running.master.say_stop(who, reason, place)
        words = counted(
            said_now.told_count,
            "STOP: {count} part is told to go to the safe state",
            "STOP: {count} parts are told to go to the safe state",
        )
        if reason:
            words = said("{words}: {reason}", words=words, reason=reason)
        status = await self._running.master.until_stop_is_stored(ANSWER_S)
        trouble = _not_stored(status)
        if trouble:
            words = said("{words}. {trouble}: it ends with this master", words=words, trouble=trouble)
        return Outcome(words, answer={"stop": said_now.number, "stored": not trouble, "trouble": trouble})

    async def go(self, stop: int | None, who: str) -> Outcome:
        """Let the parts work again.

        Raises:
            ConfigError: nobody said STOP, or somebody has said another one since that one.
        """
        told = self._running.master.say_go(who, stop)
        words = (
            counted(told, "STOP is over: {count} part may work again", "STOP is over: {count} parts may work again")
            if told
            else said("STOP is over; no part was active")
        )
        trouble = _not_stored(await self._running.master.until_stop_is_stored(ANSWER_S))
        if trouble:
            words = said("{words}. {trouble}: a master that starts may find STOP again", words=words, trouble=trouble)
        return Outcome(words)

    def stop_report(self) -> Outcome:
        """The state of STOP, as JSON: who said it, which parts have confirmed it after how many ms, which have not."""
        return Outcome(answer=answer_of(self.status))

    def _said(self, is_stop: bool, by: str, reason: str, place: str) -> None:
        if is_stop:
            self._note_stop(by, reason, place)
            return
        self._count()
        self._lines.clear()
        words = said("{by} ended STOP", by=by)
        self._running.note(EditKind.GO, words, by)
        self._on_said("go", by, {}, words)

    def _note_stop(self, by: str, reason: str, place: str) -> None:
        now = self._running.now()
        line = self._lines.get(by) or (self._lines.get(OTHERS) if len(self._lines) >= MOST_PEOPLE else None)
        if line is not None:
            line.count, line.last_at = line.count + 1, now
            if not self._is_counting:
                self._is_counting = True
                self._running.loop.call_later(COUNT_S, self._count)
            return
        words = said("STOP by {name}, from {place}", name=by, place=place) if place else said("STOP by {name}", name=by)
        if reason:
            words = said("{words}: {reason}", words=words, reason=reason)
        noted = self._running.note(EditKind.STOP, words, by)
        self._lines[by if len(self._lines) < MOST_PEOPLE else OTHERS] = _JournalLine(words, noted, now, now)
        self._on_said("stop", by, {"reason": reason} if reason else {}, words)

    def _count(self) -> None:
        """Write down how often each person has said the STOP that holds."""
        self._is_counting = False
        for line in self._lines.values():
            if line.count > line.told:
                line.told = line.count
                seconds = f"{line.last_at - line.first_at:.0f}"
                words = said(
                    "{words} ({count} times in {seconds} s)", words=line.words, count=line.count, seconds=seconds
                )
                self._running.note_again(line.noted, words)


def _not_stored(status: StopStatus) -> str:
    """Why STOP, or its end, would not survive this master; empty: it would."""
    return status.trouble or ("" if status.is_stored else said("It is not stored yet"))
