"""What every link on a CAN bus has in common, in the native mode and in foreign ones: its port and its events."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final

from msbot_agent.link.base import BaseLink
from msbot_agent.link.can.controller import BusState, CanBus, CanBusInfo, FrameTap
from msbot_agent.link.can.controller_port import CanPort
from msbot_agent.link.can.protocol.frame_queue import QUEUE_FRAMES
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import CanIds, stop_words
from msbot_agent.link.contract import LinkInfo, Peer, Signal

BUS_LEFT: Final = "still waiting when the controller left the bus"


class CanEnd(BaseLink, ABC):
    """Base of the links on a CAN bus; the `PortOwner` of its port."""

    def __init__(
        self,
        bus: CanBus,
        *,
        mtu: int,
        remote: Peer | None = None,
        ids: CanIds | None = None,
        compresses: bool = False,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        """Connect with the controller."""
        ids = ids or CanIds()
        bits_per_second = bus.info.bits_per_second
        super().__init__(
            LinkInfo(bus.info.name, mtu, bits_per_second, shared_bus=True, compresses=compresses), remote=remote
        )
        self.foreign = 0
        """Frames of other equipment on the bus, which are ignored."""
        self._ids = ids
        self._port = CanPort(bus, self, ids=ids, queue_frames=queue_frames)

    def on_frame(self, tap: FrameTap) -> None:
        """Call `tap`, too, with every frame that this end sends or receives."""
        earlier = self._port.frame_tap
        self._port.tap(tap if earlier is None else _both(earlier, tap))

    @property
    def bus_info(self) -> CanBusInfo:
        """The bus that the controller is on."""
        return self._port.bus.info

    @property
    def bus_state(self) -> BusState:
        """Fault confinement state of the controller."""
        return self._port.state

    @abstractmethod
    def has_room(self, peer: Peer) -> bool:
        """See `Link`."""

    @abstractmethod
    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`."""

    @abstractmethod
    def describe(self, peer: Peer) -> str:
        """See `Link`."""

    async def run(self) -> None:
        """See `Link`."""
        await self._port.run()

    def _count_frames(self, reason: str, frames: int) -> None:
        if frames:
            self.counters.dropped.count(reason, frames)

    # What the port calls (`PortOwner`), where most ends do the same

    @abstractmethod
    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""

    def stopped(self, reason: int, now: float) -> None:
        """See `PortOwner`."""
        self._signal_handler(Signal.STOP, None, stop_words(reason), now)

    def room_again(self, peer: int) -> None:
        """See `PortOwner`."""
        self._room_handler(peer)

    def drained(self, now: float) -> None:
        """See `PortOwner`; by default it does nothing."""

    def bus_up(self, now: float) -> None:
        """See `PortOwner`."""
        self._signal_handler(Signal.LINK_UP, self.remote, "on the bus", now)

    def bus_down(self, reason: str, lost_frames: int, now: float) -> None:
        """See `PortOwner`."""
        self._count_frames(BUS_LEFT, lost_frames)
        self._signal_handler(Signal.LINK_DOWN, self.remote, reason, now)

    def timer(self) -> float | None:
        """See `PortOwner`; by default there is no timer."""
        return None

    def handle_timer(self, now: float) -> None:
        """See `PortOwner`."""


def _both(first: FrameTap, second: FrameTap) -> FrameTap:
    def tap(at: float, sender: str, frame: Frame) -> None:
        first(at, sender, frame)
        second(at, sender, frame)

    return tap
