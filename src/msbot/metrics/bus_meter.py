"""How busy the CAN buses of some links are, from the lengths of their frames.

Stuff bits are not counted: the load is up to a fifth too low, never too high.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from msbot.link import Link
from msbot.link.can import CanEnd
from msbot.link.can.protocol import Frame

_WINDOW_S = 1.0
_CLASSIC_BITS, _EXTENDED_BITS = 47, 67
"""Bits of a classic frame without data: ISO 11898-1 10.4.2, with intermission, without stuff bits."""


class FrameMeter:
    """Measures the frames that it is given."""

    def __init__(self, name: str, bitrate: int, clock: Callable[[], float]) -> None:
        self.name = name
        self.bitrate = bitrate
        self._clock = clock
        self._frames: deque[tuple[float, int]] = deque()
        self._bits = 0

    def tap(self, at: float, sender: str, frame: Frame) -> None:  # noqa: ARG002 - what a bus calls
        """Count a frame."""
        bits = (_EXTENDED_BITS if frame.extended else _CLASSIC_BITS) + 8 * len(frame.data)
        self._frames.append((at, bits))
        self._bits += bits
        self._forget(at)

    def load_percent(self) -> float:
        """Share of the last second in which the buses were busy."""
        self._forget(self._clock())
        return 100 * self._bits / (self.bitrate * _WINDOW_S) if self.bitrate else 0.0

    def _forget(self, now: float) -> None:
        while self._frames and self._frames[0][0] <= now - _WINDOW_S:
            self._bits -= self._frames.popleft()[1]


def meter_of(links: Iterable[Link], clock: Callable[[], float]) -> FrameMeter | None:
    """A meter that hears the CAN links among these from now on; None: there are none."""
    buses = [link for link in links if isinstance(link, CanEnd)]
    if not buses:
        return None
    bitrate = sum(link.info.bits_per_second or 0 for link in buses)
    meter = FrameMeter(", ".join(link.info.name for link in buses), bitrate, clock)
    for link in buses:
        link.on_frame(meter.tap)
    return meter
