"""Missions, as people start, solve and stop them; the laboratory, if this robot has one, plays them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Protocol

from msbot.operations.outcome import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.registry import EditKind
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class MissionControl(Protocol):
    """What plays missions in this robot; each method raises `ConfigError` with what is wrong."""

    def start(self, name: str, toml: str, seed: int | None, who: str) -> Awaitable[str]:
        """Begin a ready mission, or, with `toml`, that of a file with this name; says what begins."""

    def stop(self, who: str) -> str:
        """End the mission that runs; says which."""

    def answer(self, kind: str, at: str, who: str) -> str:
        """Somebody says what is wrong and where; says whether that is so."""

    def repair(self, repair: str, at: str, who: str) -> str:
        """Somebody has something repaired; says what came of it."""

    def hint(self, who: str) -> str:
        """The next hint."""

    def as_json(self) -> Mapping[str, object]:
        """The mission that runs, without its answers; empty: none."""

    def report(self, number: int | None) -> Mapping[str, object]:
        """The report of a mission that is over; without number the latest."""


class Missions:
    """The operations of missions."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._control: MissionControl | None = None
        self._listeners: list[Callable[[Mapping[str, object]], object]] = []

    def use(self, control: MissionControl) -> None:
        """Say what plays missions."""
        self._control = control

    def on_note(self, listener: Callable[[Mapping[str, object]], object]) -> None:
        """Call the listener with every note of a mission, for a recording."""
        self._listeners.append(listener)

    def noted(self, note: Mapping[str, object]) -> None:
        """Tell of a note; for what plays missions."""
        for listener in self._listeners:
            listener(note)

    def journal(self, words: str, who: str) -> None:
        """Note in the journal that a mission has begun or ended; for what plays missions."""
        self.running.note(EditKind.MISSION, words, who)

    async def start_mission(self, mission: str, toml: str, seed: int | None, who: str) -> Outcome:
        """Begin a mission."""
        return Outcome(await self._the_control().start(mission, toml, seed, who))

    def stop_mission(self, who: str) -> Outcome:
        """End it."""
        return Outcome(self._the_control().stop(who))

    def answer_mission(self, kind: str, at: str, who: str) -> Outcome:
        """Say what is wrong, and where."""
        return Outcome(self._the_control().answer(kind, at, who))

    def repair(self, repair: str, at: str, who: str) -> Outcome:
        """Have something repaired."""
        return Outcome(self._the_control().repair(repair, at, who))

    def mission_hint(self, who: str) -> Outcome:
        """The next hint."""
        return Outcome(self._the_control().hint(who))

    def state(self) -> Mapping[str, object]:
        """The mission that runs, without its answers, and the numbers of those that are over."""
        return {"reports": []} if self._control is None else self._control.as_json()

    def report(self, number: int | None) -> Mapping[str, object]:
        """A mission that is over, with its notes; without number the latest.

        Raises:
            ConfigError: there is none.
        """
        return self._the_control().report(number)

    def mission(self) -> Outcome:
        """The mission that runs."""
        return Outcome(answer=dict(self.state()))

    def mission_report(self, number: int | None) -> Outcome:
        """A mission that is over."""
        return Outcome(answer=dict(self.report(number)))

    def _the_control(self) -> MissionControl:
        if self._control is None:
            raise ConfigError(said("this robot runs without missions"))
        return self._control
