"""What the page shows of real CAN buses: the frames that the master's links send and receive.

The kernel hands a link its own identifiers only, so frames of other equipment are not in the table nor in the load;
`msbot bus dump` shows those.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from msbot.metrics.figures import FrameMeter
from msbot_agent.link import Link
from msbot_agent.link.can import CanEnd
from msbot_web.assembly import PageSources
from msbot_web.frame_ring import FrameRing
from msbot_web.model_builder import BusMeter


class LinkMeter(FrameMeter, BusMeter):
    """The figures of the buses of some links."""


def seen_of_links(links: Sequence[Link]) -> PageSources:
    """What the page shows of a master's links."""
    frames = FrameRing()
    ends = [link for link in links if isinstance(link, CanEnd)]
    if not ends:
        return PageSources(frames)
    meter = LinkMeter([end.bus_info for end in ends], asyncio.get_running_loop().time)
    for end in ends:
        end.on_frame(frames.tap)
    meter.listen_to(ends)
    return PageSources(frames, meter)
