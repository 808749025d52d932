"""A robot without parts: checks look at it as at a real one."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Robot:
    """What it is like can be said freely."""

    states: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    parts: dict[str, str] = field(default_factory=dict)
    settings: dict[tuple[str, str], str] = field(default_factory=dict)
    wires: set[tuple[str, str]] = field(default_factory=set)
    types: set[str] = field(default_factory=lambda: {"LED"})
    is_stopped: bool = False

    def state(self, slot: str) -> str:
        return self.states.get(slot, "empty")

    def is_in_state(self, slot: str, state: str) -> bool:
        return self.state(slot) == state

    def number(self, source: str) -> float | None:
        return self.numbers.get(source)

    def numbers_since(self, source: str, heard: int | None) -> tuple[list[float], int]:
        return [self.numbers[source]] if source in self.numbers else [], 0 if heard is None else heard + 1

    def part_in(self, slot: str) -> str:
        return self.parts.get(slot, "")

    def identity_in(self, slot: str) -> str:
        return self.parts.get(slot, "")

    def has_slot(self, slot: str) -> bool:
        return slot in self.states

    def knows(self, number: str) -> bool:
        return number in self.types

    def setting(self, slot: str, name: str) -> str | None:
        return self.settings.get((slot, name))

    def is_wired(self, source: str, target: str) -> bool:
        return (source, target) in self.wires
