"""Which subjects are in use on a bus, and which are free. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

FIRST, LAST = 2048, 6143
"""Those that the bridge gives, of the subjects 0 to 6143 that anybody may use."""
MOST_OWNERS: Final = 500
"""Nodes of which it is remembered what they were given, though they may be gone; then the oldest is forgotten."""


class Subjects:
    """What each node publishes and subscribes to, by what it says of itself; and what was given to whom."""

    def __init__(self) -> None:
        self._used: dict[tuple[int, str], frozenset[int]] = {}
        self._given: dict[bytes, frozenset[int]] = {}

    def uses(self, node_id: int, how: str, subjects: Iterable[int]) -> None:
        """A node says which subjects it has; of each way to say it the newest counts.

        Args:
            node_id: the node.
            how: begins with `published` or `subscribed`.
            subjects: all of them.
        """
        self._used[node_id, how] = frozenset(subjects)

    def forget(self, node_id: int) -> None:
        """It is gone; what it was given is still its own, for it may come back."""
        for key in [key for key in self._used if key[0] == node_id]:
            del self._used[key]

    def give(self, unique: bytes, registers: Iterable[str]) -> Mapping[str, int]:
        """A free subject for each register of a node; without those for which there is none."""
        self._given.pop(unique, None)
        used = frozenset[int]().union(*self._used.values(), *self._given.values())
        free = (subject for subject in range(FIRST, LAST + 1) if subject not in used)
        given = dict(zip(registers, free, strict=False))
        self._given[unique] = frozenset(given.values())
        if len(self._given) > MOST_OWNERS:
            del self._given[next(iter(self._given))]
        return given

    def others(self, how: str, subject: int, node_id: int) -> list[int]:
        """Other nodes that have a subject in a way that begins so."""
        return sorted(
            {
                other
                for (other, way), subjects in self._used.items()
                if other != node_id and way.startswith(how) and subject in subjects
            }
        )
