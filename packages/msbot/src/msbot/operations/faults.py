"""Faults on purpose, as people plant and clear them; the fault lab, if this robot has one, carries them out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from msbot.operations.fault_wish import FaultWish
from msbot.operations.outcome import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.registry import EditKind
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class FaultControl(Protocol):
    """The fault lab of this robot."""

    def plant(self, wish: FaultWish, who: str) -> str:
        """Plant a fault; says what will happen."""

    def clear(self, number: int | None, who: str) -> str:
        """End one fault, or all; says what was ended."""

    def as_json(self, *, with_answers: bool) -> Mapping[str, object]:
        """What is planted; without answers, nothing of what a mission wants to be found."""

    def told(self, slot: str) -> Sequence[str]:
        """What may be told to everybody of the faults at a slot, or, for an empty slot, of those of the robot."""


class Faults:
    """The operations of a robot's fault lab."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._lab: FaultControl | None = None
        self._listeners: list[Callable[[Mapping[str, object]], object]] = []
        self._looked_listeners: list[Callable[[str], object]] = []

    def use(self, lab: FaultControl) -> None:
        """Say who carries faults out."""
        self._lab = lab

    def on_change(self, listener: Callable[[Mapping[str, object]], object]) -> None:
        """Call the listener with every beginning and end of a fault."""
        self._listeners.append(listener)

    def on_looked(self, listener: Callable[[str], object]) -> None:
        """Call the listener with the name of everybody who has had the answers of a mission shown."""
        self._looked_listeners.append(listener)

    def changed(self, change: Mapping[str, object], words: str, who: str) -> None:
        """Note in the journal, and tell, that a fault has begun or ended; for the lab."""
        self.running.note(EditKind.FAULT, words, who)
        for listener in self._listeners:
            listener(change)

    def told(self, slot: str) -> Sequence[str]:
        """See `FaultControl.told`; nothing without a lab."""
        return () if self._lab is None else self._lab.told(slot)

    def listed(self) -> Sequence[Mapping[str, object]]:
        """What is planted, also what is hidden, but no answers of a mission; nothing without a lab."""
        found = () if self._lab is None else self._lab.as_json(with_answers=False)["faults"]
        assert isinstance(found, Sequence)
        return found

    def plant_fault(  # noqa: PLR0917 - the arguments of the table
        self, kind: str, at: str, amount: float | None, jitter_ms: float | None, port: str, number: str,
        after_s: float, for_s: float | None, when: str, chance: float | None, seed: int | None,
        hidden: bool,
        who: str,
    ) -> Outcome:  # fmt: skip
        """Plant a fault."""
        wish = FaultWish(kind, at, amount, jitter_ms, port, number, after_s, for_s, when, chance, seed, hidden=hidden)
        return Outcome(self.plant(wish, who))

    def plant(self, wish: FaultWish, who: str) -> str:
        """Plant a fault; says what will happen.

        Raises:
            ConfigError: it cannot be planted; the text says why.
        """
        return self._the_lab().plant(wish, who)

    def clear_fault(self, fault: int | None, who: str) -> Outcome:
        """End one fault, or all."""
        return Outcome(self._the_lab().clear(fault, who))

    def faults(self, answers: bool, who: str) -> Outcome:
        """What is planted, also what is hidden from the class; with `answers` also what a mission wants found."""
        found = self._the_lab().as_json(with_answers=answers)
        for listener in self._looked_listeners if answers else ():
            listener(who)
        return Outcome(answer=dict(found))

    def _the_lab(self) -> FaultControl:
        if self._lab is None:
            raise ConfigError(said("this robot runs without a fault lab"))
        return self._lab
