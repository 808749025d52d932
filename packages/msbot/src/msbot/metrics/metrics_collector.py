"""Collects the figures: everything is read from what is counted anyway, in the loop that counts it.

Some things are noted between questions, by a task of their own: how late the event loop is, the beats, and how long
messages take, of which the agent measures a few.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import Final

from msbot.master import Master
from msbot.metrics.figures import (
    AgentFigures,
    Buckets,
    BusLoad,
    DatabaseFigures,
    FrameMeter,
    LinkFigures,
    MomentFigures,
    PageFigures,
    RobotFigures,
)
from msbot.pnp import PartState
from msbot_agent.agent import Acknowledgements, Agent
from msbot_agent.link import bound_name

DELAYS: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
INTERVALS: Final = (0.1, 0.2, 0.3, 0.5, 0.8, 1.0, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0)
LATENCIES: Final = (0.0001, 0.0002, 0.0005, *DELAYS)
DELAY_S: Final = 0.1
LOOK_EVERY: Final = 10
"""The parts are looked at once in so many rounds: once a second."""
MOST_TOPICS: Final = 200
"""Topics that are told; those with the most samples."""


class MetricsSampler:
    """What only a continuous look shows.

    Args:
        agent: whose messages are measured.
        master: whose beats are noted; None: an agent has none.
    """

    def __init__(self, agent: Agent, master: Master | None) -> None:
        self._agent = agent
        self._master = master
        self._acknowledgements = Acknowledgements()
        self._seen: dict[int, tuple[int, float]] = {}
        """By client key: beats counted so far, and when the latest came."""
        self.beats = 0
        self.delays = Buckets(DELAYS)
        self.intervals = Buckets(INTERVALS)
        self.latencies = Buckets(LATENCIES)
        self.acknowledgements = Buckets(LATENCIES)

    async def run(self) -> None:
        """Note until cancelled."""
        loop = asyncio.get_running_loop()
        rounds = 0
        self._agent.latency.on_delivery(self.latencies.add)
        while True:
            due = loop.time() + DELAY_S
            await asyncio.sleep(DELAY_S)
            self.delays.add(max(0.0, loop.time() - due))
            rounds += 1
            if rounds % LOOK_EVERY == 0:
                self.sample(loop.time())

    def sample(self, now: float) -> None:
        """Note the beats since the last look, of several by one part their mean interval; and of each client, how long
        it took to acknowledge the message that was measured last."""
        for _, seconds in self._acknowledgements.newest(self._agent.latency.acknowledgements()):
            self.acknowledgements.add(seconds)
        if self._master is not None:
            self._look_at_beats(self._master, now)

    def _look_at_beats(self, master: Master, now: float) -> None:
        seen: dict[int, tuple[int, float]] = {}
        for info in master.inventory.view(now):
            if info.beat_age_s is None:
                continue
            at = now - info.beat_age_s
            count, before = self._seen.get(info.client_key, (info.beats, at))
            news = info.beats - count
            if news > 0 and at > before:
                self.beats += news
                self.intervals.add((at - before) / news, news)
            seen[info.client_key] = (info.beats, at)
        self._seen = seen


class MetricsCollector:
    """Reads the figures of this process; to be called in its event loop.

    Args:
        agent: the agent.
        master: the robot, if it is one's.
        database: how its database is.
        page: how its page is; None: it has none.
        bus: measures its CAN bus where no page does.
        noting: what is noted between questions.
    """

    def __init__(
        self,
        agent: Agent,
        *,
        master: Master | None = None,
        database: Callable[[], DatabaseFigures] | None = None,
        page: Callable[[], PageFigures | None] | None = None,
        noting: MetricsSampler | None = None,
        bus: FrameMeter | None = None,
    ) -> None:
        self._agent = agent
        self._master = master
        self._database = database
        self._page = page
        self._noting = noting
        self._bus = bus

    def __call__(self) -> MomentFigures:
        """The figures of this moment."""
        noting = self._noting
        return MomentFigures(
            agent=_of_agent(self._agent),
            robot=None if self._master is None else _of_robot(self._master),
            database=None if self._database is None else self._database(),
            page=None if self._page is None else self._page(),
            bus=None if (bus := self._bus) is None else BusLoad(bus.name, bus.load_percent() / 100, bus.bitrate),
            tasks=len(asyncio.all_tasks()),
            beats=0 if noting is None else noting.beats,
            beat_intervals=None if noting is None or self._master is None else noting.intervals.read(),
            loop_delays=None if noting is None else noting.delays.read(),
            latencies=None if noting is None else noting.latencies.read(),
            acknowledgements=None if noting is None else noting.acknowledgements.read(),
        )


def _of_agent(agent: Agent) -> AgentFigures:
    links = []
    for link, sessions in agent.sessions_by_link():
        counters = link.counters
        links.append(
            LinkFigures(
                name=bound_name(link),
                sessions=sessions,
                packets_in=counters.packets_in,
                packets_out=counters.packets_out,
                octets_in=counters.bytes_in,
                octets_out=counters.bytes_out,
                lost=dict(counters.dropped),
            )
        )
    topics = sorted(agent.topics(), key=lambda topic: (-topic[1], topic[0]))[:MOST_TOPICS]
    return AgentFigures(tuple(links), agent.dropped(), tuple(topics))


def _of_robot(master: Master) -> RobotFigures:
    counts: Counter[str] = Counter({state.value: 0 for state in PartState})
    counts.update(info.state.value for info in master.inventory.view(asyncio.get_running_loop().time()))
    return RobotFigures(master.profile.name, counts, len(master.inventory.slots.names()), master.stop.stopped)
