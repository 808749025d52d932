"""Bounded counts by name: what was dropped, refused or seen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

OTHERS = "(others)"
"""Everything that came after a tally was full is counted under this name."""

MOST_NAMES = 64
"""Names counted separately by default; it is bounded because some names contain a number chosen by the sender."""


class Tally(dict[str, int]):
    """Counts by name, for at most `limit` names; more are counted together as `(others)`."""

    __slots__ = ("limit",)

    def __init__(self, counts: Mapping[str, int] | Iterable[tuple[str, int]] = (), *, limit: int = MOST_NAMES) -> None:
        if counts:
            self.update(counts)
        self.limit = limit

    def count(self, name: str, times: int = 1) -> None:
        """Count under that name."""
        if name not in self and len(self) >= self.limit:
            name = OTHERS
        self[name] = self.get(name, 0) + times

    def count_all(self, counts: Mapping[str, int]) -> None:
        """Add what was counted elsewhere."""
        for name, times in counts.items():
            self.count(name, times)


# Numbers of things in what a command prints: one is one.


def amount(count: int, one: str, many: str = "") -> str:
    """A number with its noun, `1 file`, `2 files`; `many` where it is not `one` with an s.

    For sentences that are translated, see `msbot_agent.text.sentence.counted`.
    """
    return f"{count} {one if count == 1 else many or f'{one}s'}"
