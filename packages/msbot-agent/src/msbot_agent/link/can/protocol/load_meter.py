"""How busy a medium was in the last second."""

from __future__ import annotations

from collections import deque
from typing import Final

WINDOW_S: Final = 1.0
"""Time over which the load is averaged."""


class LoadMeter:
    """Keeps the busy spans of the last `WINDOW_S` seconds; spans come in order and do not overlap."""

    def __init__(self) -> None:
        """Start idle."""
        self._spans: deque[tuple[float, float]] = deque()
        self._busy_s = 0.0

    def add(self, start: float, end: float) -> None:
        """The medium was busy from `start` to `end`."""
        self._spans.append((start, end))
        self._busy_s += end - start
        self._forget(end - WINDOW_S)

    def load(self, now: float, since: float | None = None) -> float:
        """Busy part of the last second before `now`, 0 to 1; `since` begins a span that is not over yet."""
        window_start = now - WINDOW_S
        self._forget(window_start)
        busy = self._busy_s
        if self._spans:
            start, _ = self._spans[0]
            _, end = self._spans[-1]
            busy -= max(0.0, window_start - start) + max(0.0, end - now)
        if since is not None and since < now:
            busy += now - max(since, window_start)
        return min(1.0, max(0.0, busy / WINDOW_S))

    def _forget(self, before: float) -> None:
        while self._spans and self._spans[0][1] <= before:
            start, end = self._spans.popleft()
            self._busy_s -= end - start
        if not self._spans:
            self._busy_s = 0.0
