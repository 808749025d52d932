"""What is measured at the robot itself: the time between beats, how late its event loop does what is due, and how long
messages take."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

from msbot.pnp import PartInfo
from msbot_agent.agent import Acknowledgements, Agent, Maximum
from msbot_agent.process.timer_grid import until_step
from msbot_xrce.lazy import dataclass

STEP_S: Final = 0.1
LOOK_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Measured:
    """What was measured since the last time."""

    late_ms: float
    """How late the master was at most."""
    latency_ms: float | None
    """How long a sample took through it at most; None: none was measured."""
    beats: Sequence[tuple[str, float, float]]
    """Those that came since: slot, when by the robot's clock, seconds since the one before."""
    acks_ms: Sequence[tuple[str, float]]
    """For each slot with news: how long a message took to its part, and the acknowledgement back."""


class Beats:
    """Finds the times between beats by looking at the inventory; to be looked at about as often as beats come."""

    def __init__(self) -> None:
        self._beats: dict[int, tuple[int, float]] = {}
        """By client key: beats counted so far, and when the latest came."""

    def sample(self, infos: Iterable[PartInfo], now: float) -> Iterator[tuple[str, float, float]]:
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
        self._timer: asyncio.TimerHandle | None = None

    async def run(self) -> None:
        """Measure until cancelled."""
        loop = asyncio.get_running_loop()
        self._arm(loop)
        try:
            await loop.create_future()
        finally:
            if self._timer is not None:
                self._timer.cancel()

    def _arm(self, loop: asyncio.AbstractEventLoop) -> None:
        # At the same times for all who measure: the computer wakes up once for them.
        now = loop.time()
        due = now + until_step(now, STEP_S)
        self._timer = loop.call_at(due, self._look, loop, due)

    def _look(self, loop: asyncio.AbstractEventLoop, due: float) -> None:
        self._worst_s = max(self._worst_s, loop.time() - due)
        self._arm(loop)

    def take_ms(self) -> float:
        """The worst since the last call, milliseconds."""
        worst_s, self._worst_s = self._worst_s, 0.0
        return worst_s * 1e3


class Acks:
    """Finds how long the parts in slots took to acknowledge a message."""

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self._acknowledgements = Acknowledgements()

    def sample(self, infos: Iterable[PartInfo]) -> Iterator[tuple[str, float]]:
        """(slot, milliseconds) for each slot with news since the last look."""
        slots = {info.client_key: info.slot for info in infos if info.slot and info.state.is_registered}
        for key, seconds in self._acknowledgements.newest(self._agent.latency.acknowledgements()):
            if key in slots:
                yield slots[key], seconds * 1e3


async def keep_measuring(
    agent: Agent,
    view: Callable[[float], Sequence[PartInfo]],
    tell: Callable[[Measured, Sequence[PartInfo]], None],
) -> None:
    """Tell a robot's recorder once a second what was measured.

    Args:
        agent: the robot's.
        view: the parts, at a time of the robot's clock.
        tell: takes what was measured, and the parts.
    """
    loop, beats, lateness, latency, acks = asyncio.get_running_loop(), Beats(), Lateness(), Maximum(), Acks(agent)
    agent.latency.on_delivery(latency.add)
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(lateness.run())
        while True:
            await asyncio.sleep(LOOK_S)
            now = loop.time()
            infos = view(now)
            measured = Measured(
                lateness.take_ms(), latency.take_ms(), [*beats.sample(infos, now)], [*acks.sample(infos)]
            )
            tell(measured, infos)
