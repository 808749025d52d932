"""How often messages come, and how large they are: over a window of the newest ones. Pure."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Rate:
    """How often messages came."""

    hz: float
    least_s: float
    most_s: float
    deviation_s: float
    window: int
    """Messages that this is about."""

    @property
    def describe(self) -> str:
        """Two lines, as `ros2 topic hz` has them."""
        spread = f"min: {self.least_s:.3f}s max: {self.most_s:.3f}s std dev: {self.deviation_s:.5f}s"
        return f"average rate: {self.hz:.3f}\n\t{spread} window: {self.window}"

    def as_json(self) -> dict[str, object]:
        """The same for programs."""
        return {
            "hz": round(self.hz, 6),
            "min_s": round(self.least_s, 6),
            "max_s": round(self.most_s, 6),
            "std_dev_s": round(self.deviation_s, 6),
            "window": self.window,
        }


@dataclass(frozen=True, slots=True)
class Bandwidth:
    """How many octets messages brought."""

    octets_per_s: float
    mean: float
    least: int
    most: int
    window: int

    @property
    def describe(self) -> str:
        """Two lines, as `ros2 topic bw` has them."""
        sizes = f"mean: {_octets(self.mean)} min: {_octets(self.least)} max: {_octets(self.most)}"
        return f"{_octets(self.octets_per_s)}/s from {self.window} messages\n\tMessage size {sizes}"

    def as_json(self) -> dict[str, object]:
        """The same for programs."""
        return {
            "octets_per_s": round(self.octets_per_s, 3),
            "mean": round(self.mean, 3),
            "min": self.least,
            "max": self.most,
            "window": self.window,
        }


class MessageWindow:
    """The newest messages: when each came, and its size.

    Args:
        most: how many count.
    """

    def __init__(self, most: int) -> None:
        self._seen: deque[tuple[float, int]] = deque(maxlen=most)

    def add(self, at: float, octets: int) -> None:
        """One more came at that time, in seconds."""
        self._seen.append((at, octets))

    @property
    def rate(self) -> Rate | None:
        """How often they came; None: fewer than two are known."""
        steps = [later - earlier for (earlier, _), (later, _) in pairwise(self._seen)]
        whole = sum(steps)
        if not steps or whole <= 0:
            return None
        mean = whole / len(steps)
        deviation = math.sqrt(sum((step - mean) ** 2 for step in steps) / len(steps))
        return Rate(1 / mean, min(steps), max(steps), deviation, len(self._seen))

    def bandwidth(self, now: float) -> Bandwidth | None:
        """How many octets they brought until now; None: there was none."""
        if not self._seen:
            return None
        sizes = [octets for _, octets in self._seen]
        whole_s = now - self._seen[0][0]
        per_s = sum(sizes) / whole_s if whole_s > 0 else 0.0
        return Bandwidth(per_s, sum(sizes) / len(sizes), min(sizes), max(sizes), len(sizes))


def _octets(count: float) -> str:
    if count < 1000:
        return f"{count:.0f} B"
    return f"{count / 1000:.2f} KB" if count < 1_000_000 else f"{count / 1_000_000:.2f} MB"
