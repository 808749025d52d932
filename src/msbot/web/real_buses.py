"""What the page shows of real CAN buses: the frames that the master's links send and receive.

The kernel hands a link its own identifiers only, so frames of other equipment are not in the table; `msbot bus dump`
shows those. The load is worked out from frame lengths without stuff bits: up to a fifth too low, never too high.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from msbot.link import Link
from msbot.link.can import CanEnd
from msbot.link.can.protocol import Frame
from msbot.metrics.bus_meter import FrameMeter
from msbot.web.assembly import Seen
from msbot.web.frames import FrameRing
from msbot.web.views import BusMeter


class LinkMeter(FrameMeter, BusMeter):
    """The figures of the buses of some links."""


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
