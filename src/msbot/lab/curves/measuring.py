"""What is measured at the robot itself: the time between beats, and how late its event loop does what is due."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

from msbot.pnp import PartInfo

STEP_S: Final = 0.1
LOOK_S: Final = 1.0


class Beats:
    """Finds the times between beats by looking at the inventory; to be looked at about as often as beats come."""

    def __init__(self) -> None:
        self._beats: dict[int, tuple[int, float]] = {}
        """By client key: beats counted so far, and when the latest came."""

    def look(self, infos: Iterable[PartInfo], now: float) -> Iterator[tuple[str, float, float]]:
        """(slot, when the latest beat came, seconds between the beats since the last look), for each slot with news."""
        seen: dict[int, tuple[int, float]] = {}
        for info in infos:
            if info.beat_age_s is None or not info.slot:
                continue
            at = now - info.beat_age_s
            count, before = self._beats.get(info.client_key, (info.beats, at))
            if info.beats > count and at > before:
                yield info.slot, at, (at - before) / (info.beats - count)
            seen[info.client_key] = (info.beats, at)
        self._beats = seen


class Lateness:
    """How much later than asked for the event loop goes on: a measure of how busy it is."""

    def __init__(self) -> None:
        self._worst_s = 0.0

    async def run(self) -> None:
        """Measure until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + STEP_S
            await asyncio.sleep(STEP_S)
            self._worst_s = max(self._worst_s, loop.time() - due)

    def take_ms(self) -> float:
        """The worst since the last call, milliseconds."""
        worst_s, self._worst_s = self._worst_s, 0.0
        return worst_s * 1e3


async def keep_measuring(
    view: Callable[[float], Sequence[PartInfo]],
    tell: Callable[[float, Sequence[PartInfo], Sequence[tuple[str, float, float]]], None],
) -> None:
    """Tell a robot's recorder once a second what was measured.

    Args:
        view: the parts, at a time of the robot's clock.
        tell: takes milliseconds of lateness, the parts, and for each slot with a beat since the last time what
            `Beats.look` gives.
    """
    loop, beats, lateness = asyncio.get_running_loop(), Beats(), Lateness()
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(lateness.run())
        while True:
            await asyncio.sleep(LOOK_S)
            now = loop.time()
            infos = view(now)
            tell(lateness.take_ms(), infos, [*beats.look(infos, now)])
