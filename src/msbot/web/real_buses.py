"""What the page shows of real CAN buses: the frames that the master's links send and receive.

The kernel hands a link its own identifiers only, so frames of other equipment are not in the table; `msbot bus dump`
shows those. The load is worked out from frame lengths without stuff bits: up to a fifth too low, never too high.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence

from msbot.link import Link
from msbot.link.can import CanEnd
from msbot.link.can.protocol import Frame
from msbot.web.assembly import Seen
from msbot.web.frames import FrameRing
from msbot.web.views import BusMeter

_WINDOW_S = 1.0
_CLASSIC_BITS, _EXTENDED_BITS = 47, 67
"""Bits of a classic frame without data: ISO 11898-1 10.4.2, with intermission, without stuff bits."""


class LinkMeter(BusMeter):
    """The figures of the buses of some links."""

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
        """See `BusMeter.load_percent`."""
        self._forget(self._clock())
        return 100 * self._bits / (self.bitrate * _WINDOW_S) if self.bitrate else 0.0

    def _forget(self, now: float) -> None:
        while self._frames and self._frames[0][0] <= now - _WINDOW_S:
            self._bits -= self._frames.popleft()[1]


def seen_of_links(links: Sequence[Link]) -> Seen:
    """What the page shows of a master's links."""
    frames = FrameRing()
    buses = [link for link in links if isinstance(link, CanEnd)]
    if not buses:
        return Seen(frames)
    clock = asyncio.get_running_loop().time
    bitrate = sum(link.info.bits_per_second or 0 for link in buses)
    meter = LinkMeter(", ".join(link.info.name for link in buses), bitrate, clock)

    def tap(at: float, sender: str, frame: Frame) -> None:
        frames.tap(at, sender, frame)
        meter.tap(at, sender, frame)

    for link in buses:
        link.on_frame(tap)
    return Seen(frames, meter)
