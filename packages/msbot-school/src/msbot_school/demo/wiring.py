"""The wire of the demo: a simulated CAN bus, or UDP on this machine."""

from __future__ import annotations

from enum import Enum
from random import Random

from msbot_agent.link import Link
from msbot_agent.link.can import CanMasterLink, CanPartLink, Codec
from msbot_agent.link.can.protocol import NodeIds
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_agent.link.net import UdpClientLink, UdpServerLink
from msbot_xrce import compress, decompress


class Wire(Enum):
    """What connects the robot; the value is what a person types."""

    CAN = "can"
    FD = "fd"
    UDP = "udp"


class Wiring:
    """The wire, and each part's connection to it."""

    def __init__(
        self,
        wire: Wire,
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
        if wire is Wire.UDP:
            self._server = UdpServerLink("127.0.0.1", 0)
            self.master_link: Link = self._server
            self.name = "UDP on 127.0.0.1"
            return
        fd = wire is Wire.FD
        bus = SimBus(bitrate, data_bitrate=data_bitrate if fd else None, fd=fd)
        self.driver = SimBusDriver(bus, name=bus_name)
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
