"""The past of a robot, out of its recorder's ring: read by another process, so that nothing here waits for a disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from msbot.errors import ConfigError
from msbot.lab.curves.reading import ReadCurves, read_curves, ring_files
from msbot.runtime.sentence import said
from msbot.runtime.worker import TooMuchWork, WorkLimits, Workshop

LIMITS = WorkLimits(cpu_s=20, memory_mb=900, wall_s=60.0)
MOST_POINTS = 1500
"""Points of each curve that a page draws."""


class RecordedPast:
    """What the recorder has.

    Args:
        folder: where its ring is; empty: this robot is not recorded.
    """

    def __init__(self, folder: Callable[[], str]) -> None:
        self._folder = folder
        self._workshop = Workshop(LIMITS)

    async def curves(self, names: Sequence[str], from_s: float, to_s: float) -> ReadCurves:
        """Curves between two times, seconds since 1970.

        Raises:
            ConfigError: the robot is not recorded, or it takes too long.
        """
        folder = self._folder()
        if not folder:
            raise ConfigError(said("this robot runs with `--rec off`: nothing of its past is known"))
        try:
            return await self._workshop.run(read_ring, folder, tuple(names), from_s, to_s)
        except TooMuchWork:
            raise ConfigError(said("so much of the past takes too long to read: choose a shorter time")) from None


def read_ring(folder: str, names: Sequence[str], from_s: float, to_s: float) -> ReadCurves:
    """What the other process does."""
    files = ring_files(Path(folder), from_s, to_s)
    return read_curves(files, names, from_s=from_s, to_s=to_s, most_points=MOST_POINTS)
