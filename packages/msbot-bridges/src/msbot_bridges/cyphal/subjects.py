"""Which subjects are in use on a bus, and which are free. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

FIRST, LAST = 2048, 6143
"""Those that the bridge gives, of the subjects 0 to 6143 that anybody may use."""
MOST_NODES: Final = 128


class Subjects:
    """What each node publishes and subscribes to, by what it says of itself."""

    def __init__(self) -> None:
        self._used: dict[tuple[int, str], frozenset[int]] = {}

    def uses(self, node_id: int, how: str, subjects: Iterable[int]) -> None:
        """A node says which subjects it has; of each way to say it the newest counts.

        Args:
            node_id: the node.
            how: `subscribed` for those by which it is driven; any other word for others.
            subjects: all of them.
        """
        self._used[node_id, how] = frozenset(subjects)

    def forget(self, node_id: int) -> None:
        """It is gone."""
        for key in [key for key in self._used if key[0] == node_id]:
            del self._used[key]

    def give(self, registers: Iterable[str]) -> Mapping[str, int]:
        """A free subject for each register; without those for which there is none."""
        used = frozenset[int]().union(*self._used.values())
        free = (subject for subject in range(FIRST, LAST + 1) if subject not in used)
        return dict(zip(registers, free, strict=False))

    def others_driven_by(self, subject: int, node_id: int) -> list[int]:
        """Other nodes that are driven by a subject."""
        return sorted(
            other
            for (other, how), subjects in self._used.items()
            if other != node_id and how.startswith("subscribed") and subject in subjects
        )
