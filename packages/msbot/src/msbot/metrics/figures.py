"""The figures of one moment, as plain values."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import field

from msbot_xrce.common.lazy_dataclass import dataclass


class Buckets:
    """A histogram: how many values were at most each bound, and their sum.

    Args:
        bounds: upper bounds, rising; one more bucket takes all that is larger.
    """

    __slots__ = ("_bounds", "_counts", "_sum")

    def __init__(self, bounds: Sequence[float]) -> None:
        self._bounds = tuple(bounds)
        self._counts = [0] * (len(bounds) + 1)
        self._sum = 0.0

    def add(self, value: float, times: int = 1) -> None:
        """Note a value."""
        self._counts[bisect_left(self._bounds, value)] += times
        self._sum += value * times

    def read(self) -> Histogram:
        """As it is now."""
        rising, total = [], 0
        for bound, count in zip((*map(repr, self._bounds), "+Inf"), self._counts, strict=True):
            total += count
            rising.append((bound, float(total)))
        return Histogram(tuple(rising), self._sum)


@dataclass(frozen=True, slots=True)
class Histogram:
    """A histogram at one moment, as Prometheus has it."""

    rising: tuple[tuple[str, float], ...]
    """`(upper bound, how many values were at most that)`."""
    total: float
    """Sum of all values."""


@dataclass(frozen=True, slots=True)
class LinkFigures:
    """One link."""

    name: str
    sessions: int
    packets_in: int
    packets_out: int
    octets_in: int
    octets_out: int
    lost: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class AgentFigures:
    """An agent."""

    links: tuple[LinkFigures, ...]
    lost: Mapping[str, int]
    """Packets that belonged to no session, by reason in words."""
    topics: tuple[tuple[str, int, int], ...]
    """`(name, published, delivered)`."""


@dataclass(frozen=True, slots=True)
class RobotFigures:
    """A robot."""

    name: str
    parts: Mapping[str, int]
    """By state."""
    slots: int
    stopped: bool


@dataclass(frozen=True, slots=True)
class DatabaseFigures:
    """A database."""

    waiting: int
    lost: int
    is_well: bool


@dataclass(frozen=True, slots=True)
class PageFigures:
    """A page."""

    sessions: int
    connections: int
    bus: str = ""
    """Name of the CAN bus; empty: there is none."""
    bus_load: float = 0.0
    """Share of the last second in which it was busy, 1 = always."""
    bus_bitrate: int = 0


@dataclass(frozen=True, slots=True)
class BusLoad:
    """The CAN bus, where no page measures it."""

    name: str
    load: float
    """Share of the last second in which it was busy, 1 = always."""
    bitrate: int


@dataclass(frozen=True, slots=True)
class MomentFigures:
    """Everything of one moment; what the process does not have is None."""

    agent: AgentFigures
    robot: RobotFigures | None = None
    database: DatabaseFigures | None = None
    page: PageFigures | None = None
    bus: BusLoad | None = None
    """None also where the page has it."""
    tasks: int = 0
    """Tasks of the event loop: what runs at the same time in the process."""
    beats: int = 0
    """Beats of all parts since they are noted."""
    beat_intervals: Histogram | None = None
    loop_delays: Histogram | None = None
    latencies: Histogram | None = None
    acknowledgements: Histogram | None = None
    labels: Mapping[str, str] = field(default_factory=dict)
