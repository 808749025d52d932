"""Clocks for what lasts a certain time: sessions and tickets. A wall clock that is set back lengthens no life."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")

if sys.platform == "linux":

    def since_boot_s() -> float:
        """Seconds since the computer's start; they pass also while it sleeps."""
        return time.clock_gettime(time.CLOCK_BOOTTIME)

else:

    def since_boot_s() -> float:
        """Seconds, monotonic."""
        return time.monotonic()


def boot_id() -> str:
    """Tells this start of the computer from every other; empty: the system does not say."""
    try:
        return _BOOT_ID.read_text("ascii").strip()
    except OSError:
        return ""


class NonDecreasingClock:
    """The wall clock, which never goes back: when somebody sets it back, the seconds go on from where it was.

    Args:
        wall: seconds since 1970.
        steady: seconds, monotonic.
    """

    def __init__(self, wall: Callable[[], float], steady: Callable[[], float]) -> None:
        self._wall = wall
        self._steady = steady
        self._at, self._steady_at = wall(), steady()

    def now(self) -> float:
        """Seconds since 1970."""
        steady = self._steady()
        self._at = max(self._wall(), self._at + max(0.0, steady - self._steady_at))
        self._steady_at = steady
        return self._at

    def not_before(self, at: float) -> None:
        """It was that late already, in an earlier run."""
        self._at = max(self.now(), at)
