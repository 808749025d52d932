"""Whether something grows: memory, tasks, threads and open files of a process over hours. Pure."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

WARM_S = 720.0
"""The flight recorder keeps ten minutes, pages five: until then memory grows as it should."""
LEAST_S = 600.0
"""Less than this beyond the warm-up says nothing."""
MB_PER_HOUR = 20.0
MORE = 10
"""So many tasks, threads or files more at the end than at the beginning are too many."""


@dataclass(frozen=True, slots=True)
class Sample:
    """A look at a process."""

    at: float
    """Seconds since it has begun."""
    rss_mb: float
    tasks: int
    threads: int
    files: int


@dataclass(frozen=True, slots=True)
class Growth:
    """How a process has grown after its warm-up."""

    seconds: float
    first_mb: float
    last_mb: float
    mb_per_hour: float
    tasks: tuple[int, int]
    """As many as usual in the first third, and in the last: thirty silent connections are no growth."""
    threads: tuple[int, int]
    files: tuple[int, int]

    @property
    def troubles(self) -> list[str]:
        """What grows."""
        found = []
        if self.mb_per_hour > MB_PER_HOUR:
            found.append(
                f"memory grows by {self.mb_per_hour:.1f} MB an hour ({self.first_mb:.0f} to {self.last_mb:.0f})"
            )
        for name, (first, last) in (("tasks", self.tasks), ("threads", self.threads), ("open files", self.files)):
            if last > first + MORE:
                found.append(f"{name} grow from {first} to {last}")
        return found


def growth(samples: Sequence[Sample], warm_s: float = WARM_S, least_s: float = LEAST_S) -> Growth | None:
    """How it grows; None: it has not run for long enough to say."""
    found = [one for one in samples if one.at >= warm_s]
    if len(found) < 6 or found[-1].at - found[0].at < least_s:
        return None
    third = max(1, len(found) // 3)
    early, late = found[:third], found[-third:]

    def usual(name: str) -> tuple[int, int]:
        found = [statistics.median_high(getattr(one, name) for one in part) for part in (early, late)]
        return found[0], found[1]

    return Growth(
        found[-1].at - found[0].at,
        found[0].rss_mb,
        found[-1].rss_mb,
        _slope([one.at for one in found], [one.rss_mb for one in found]) * 3600.0,
        usual("tasks"),
        usual("threads"),
        usual("files"),
    )


def _slope(xs: Sequence[float], ys: Sequence[float]) -> float:
    """Least squares."""
    mean_x, mean_y = sum(xs) / len(xs), sum(ys) / len(ys)
    spread = sum((x - mean_x) ** 2 for x in xs)
    return sum((x - mean_x) * (y - mean_y) for x, y in zip(xs, ys, strict=True)) / spread if spread else 0.0
