"""How busy the CAN buses of some links are, from the frames that these links send and receive.

Each frame counts with all its bits, stuff bits and intermission included, at the bit rates of its bus. Nothing else is
known here: what other equipment says to each other, frames that were sent again, and error frames are missing, so the
bus itself may be busier than this, never less busy.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence

from msbot_agent.link import Link
from msbot_agent.link.can import CanBusInfo, CanEnd, FrameTap
from msbot_agent.link.can.protocol import Frame, busy_seconds

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

    def hear(self, ends: Iterable[CanEnd]) -> None:
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
    meter.hear(ends)
    return meter
