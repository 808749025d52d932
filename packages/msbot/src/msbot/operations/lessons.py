"""Lessons as people begin, do and end them at a running robot; the lesson desk, if it has one, carries them out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from msbot.operations.outcome import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.registry import EditKind
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class LessonControl(Protocol):
    """The lesson desk of this robot."""

    async def begin(self, lesson: str, who: str) -> str:
        """Set the robot up for a lesson; says what was done."""

    async def end(self, who: str) -> str:
        """Put everything back; says what was done."""

    def join(self, who: str) -> str:
        """Let a person take part."""

    def answer(self, check: str, answer: str, who: str) -> str:
        """Answer a question of the lesson."""

    def hand(self, who: str, *, up: bool) -> str:
        """A person asks for help, or does not any more."""

    def as_json(self) -> Mapping[str, object]:
        """The lesson that runs."""


class Lessons:
    """The operations of a robot's lesson desk."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._desk: LessonControl | None = None

    def use(self, desk: LessonControl) -> None:
        """Say who carries lessons out."""
        self._desk = desk

    def note(self, words: str, who: str) -> None:
        """Note in the journal what a lesson did; for the desk."""
        self.running.note(EditKind.LESSON, words, who)

    async def start_lesson(self, lesson: str, who: str) -> Outcome:
        """Begin a lesson."""
        return Outcome(await self._the_desk().begin(lesson, who))

    async def stop_lesson(self, who: str) -> Outcome:
        """End the lesson that runs."""
        return Outcome(await self._the_desk().end(who))

    def join_lesson(self, who: str) -> Outcome:
        """Take part in the lesson that runs."""
        return Outcome(self._the_desk().join(who))

    def answer_lesson(self, check: str, answer: str, who: str) -> Outcome:
        """Answer a question of the lesson that runs."""
        return Outcome(self._the_desk().answer(check, answer, who))

    def raise_hand(self, who: str, *, up: bool) -> str:
        """Somebody's hand is up, or down: the lesson that runs knows it; empty: none runs."""
        if self._desk is None or self._desk.as_json().get("lesson") is None:
            return ""
        return self._desk.hand(who, up=up)

    def lesson(self) -> Outcome:
        """The lesson that runs."""
        return Outcome(answer=dict(self._the_desk().as_json()))

    def _the_desk(self) -> LessonControl:
        if self._desk is None:
            raise ConfigError(said("this robot runs without lessons"))
        return self._desk
