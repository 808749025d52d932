"""The wire of the demo: a simulated CAN bus, or UDP on this machine."""

from __future__ import annotations

import asyncio
from enum import Enum
from random import Random

from msbot_agent.link import Link
from msbot_agent.link.can import CanMasterLink, CanPartLink, Codec
from msbot_agent.link.can.protocol import NodeIds
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_agent.link.net import UdpClientLink, UdpServerLink
from msbot_agent.process.timer_grid import rounds_timers
from msbot_xrce import compress, decompress
from msbot_xrce.lazy import dataclass

AHEAD_S = 0.01
"""How far the bus may be ahead of the clock of a loop that rounds its timers: what all parts say at one point of its
grid, and the answers, take some 5 ms."""


class DemoLinkKind(Enum):
    """What connects the robot; the value is what a person types."""

    CAN = "can"
    FD = "fd"
    UDP = "udp"


class DemoLinks:
    """The wire, and each part's connection to it. Must be made inside a running event loop."""

    def __init__(
        self,
        wire: DemoLinkKind,
        *,
        bitrate: int,
        data_bitrate: int,
        profile_hash: int,
        random: Random,
        node_ids: NodeIds | None,
        compression: bool,
        bus_name: str = "",
    ) -> None:
        self.wire = wire
        self.driver: SimBusDriver | None = None
        self._random = random
        self._codec = Codec(compress, decompress) if compression else None
        self._server: UdpServerLink | None = None
        if wire is DemoLinkKind.UDP:
            self._server = UdpServerLink("127.0.0.1", 0)
            self.master_link: Link = self._server
            self.name = "UDP on 127.0.0.1"
            return
        fd = wire is DemoLinkKind.FD
        bus = SimBus(bitrate, data_bitrate=data_bitrate if fd else None, fd=fd)
        ahead_s = AHEAD_S if rounds_timers(asyncio.get_running_loop()) and not bus_name else 0.0
        self.driver = SimBusDriver(bus, name=bus_name, ahead_s=ahead_s)
        # A bus needs two nodes before any frame is acknowledged: the monitor does it, as a student's adapter would.
        self.driver.attach("monitor")
        self.master_link = CanMasterLink(
            self.driver.attach("master"),
            profile_hash=profile_hash,
            random=random,
            node_ids=node_ids,
            fd=fd,
            codec=self._codec,
        )
        self.name = f"simulated CAN {'FD ' if fd else ''}bus, {bitrate // 1000} kbit/s" + (
            f" and {data_bitrate // 1000} kbit/s" if fd else ""
        )

    def part_link(self, name: str, uid: bytes) -> Link:
        """A new link for a part that has just been plugged in."""
        if self.driver is not None:
            return CanPartLink(self.driver.attach(name), uid=uid, random=self._random, codec=self._codec)
        assert self._server is not None
        return UdpClientLink("127.0.0.1", self._server.port)

    def pull(self, name: str) -> None:
        """Cut a part off without a goodbye."""
        if self.driver is not None:
            self.driver.detach(name)


# What the demo shows of its robot at one moment: plain values, for tables, lines and JSON.


@dataclass(frozen=True, slots=True)
class DemoStateChange:
    """One change of a part's state."""

    at_s: float
    """Seconds since the start of the robot."""
    part: str
    """The part's name in the demo; before it has claimed, its name on the wire."""
    from_state: str
    to_state: str
    reason: str
    slot: str = ""
    """The slot that it holds, or has lost by this change."""


@dataclass(frozen=True, slots=True)
class PartSnapshot:
    """One part as the demo shows it."""

    name: str
    part_number: str
    slot: str
    state: str
    plugged: bool
    life: int
    beat_age_s: float | None
    beats: int
    messages_in: int
    messages_out: int
    plug_in_to_active_ms: float | None
    """Time from when it was last plugged in to `active`; None until then."""
    outputs: tuple[bool, ...]
    """Levels of the part's GPIO board; empty without one."""


@dataclass(frozen=True, slots=True)
class TopicSnapshot:
    """The traffic of one topic since all its parts were active for the first time."""

    name: str
    published: int
    """Samples that a part wrote and the agent accepted."""
    delivered: int
    """Samples that arrived in the parts that read the topic."""


@dataclass(frozen=True, slots=True)
class BusSnapshot:
    """The simulated bus since the start."""

    bitrate: int
    frames: int
    bits: int
    load_percent: float
    """Mean over the whole run."""
    load_now_percent: float
    """Over the last second."""
    errors: int


@dataclass(frozen=True, slots=True)
class DemoSnapshot:
    """The whole robot at one moment."""

    robot: str
    link: str
    at_s: float
    parts: tuple[PartSnapshot, ...]
    topics: tuple[TopicSnapshot, ...]
    bus: BusSnapshot | None
