"""The figures of one moment, as plain values."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field

from msbot_agent.link import Link
from msbot_agent.link.can import CanBusInfo, CanEnd, FrameTap
from msbot_agent.link.can.protocol import Frame, busy_seconds
from msbot_xrce.lazy import dataclass


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


# How busy the CAN buses of some links are, from the frames that these links send and receive.
#
# Each frame counts with all its bits, stuff bits and intermission included, at the bit rates of its bus. Nothing else
# is known here: what other equipment says to each other, frames that were sent again, and error frames are missing,
# so the bus itself may be busier than this, never less busy.


_WINDOW_S = 1.0


class FrameMeter:
    """Measures the frames of some buses.

    Args:
        buses: what is known of each; those of unknown bit rate do not count.
        clock: seconds.
    """

    def __init__(self, buses: Sequence[CanBusInfo], clock: Callable[[], float]) -> None:
        self.name = ", ".join(bus.name for bus in buses)
        self.bitrate = sum(bus.bits_per_second or 0 for bus in buses)
        self.data_bitrate = max((bus.data_bits_per_second or 0 for bus in buses), default=0)
        self._measured = sum(bus.bits_per_second is not None for bus in buses)
        self._clock = clock
        self._frames: deque[tuple[float, float]] = deque()
        """(when, seconds on its bus) of each frame of the last second."""
        self._busy_s = 0.0

    def tap_of(self, bus: CanBusInfo) -> FrameTap | None:
        """What is to be called with the frames of that bus; None: its bit rate is not known."""
        bitrate, data_bitrate = bus.bits_per_second, bus.data_bits_per_second
        if bitrate is None:
            return None

        def tap(at: float, sender: str, frame: Frame) -> None:  # noqa: ARG001 - what a bus calls
            seconds = busy_seconds(frame, bitrate, data_bitrate)
            self._frames.append((at, seconds))
            self._busy_s += seconds
            self._forget(at)

        return tap

    def listen_to(self, ends: Iterable[CanEnd]) -> None:
        """Measure the frames of these links from now on."""
        for end in ends:
            tap = self.tap_of(end.bus_info)
            if tap is not None:
                end.on_frame(tap)

    def load_percent(self) -> float:
        """Share of the last second in which the buses were busy; of several buses, their mean."""
        self._forget(self._clock())
        return 100 * self._busy_s / (self._measured * _WINDOW_S) if self._measured else 0.0

    def _forget(self, now: float) -> None:
        frames = self._frames
        while frames and frames[0][0] <= now - _WINDOW_S:
            self._busy_s -= frames.popleft()[1]
        if not frames:
            self._busy_s = 0.0  # what rounding has left


def meter_of(links: Sequence[Link], clock: Callable[[], float]) -> FrameMeter | None:
    """A meter that hears the CAN links among these from now on; None: there are none."""
    ends = [link for link in links if isinstance(link, CanEnd)]
    if not ends:
        return None
    meter = FrameMeter([end.bus_info for end in ends], clock)
    meter.listen_to(ends)
    return meter
