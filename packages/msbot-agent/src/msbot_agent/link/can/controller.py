"""The interface to a CAN controller, real or simulated: a link sees only this.

A controller takes a few frames at a time (real ones have about three mailboxes), so that waiting frames stay in the
link, where they can be interleaved, overtaken by STOP, and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from enum import Enum
from typing import Protocol, runtime_checkable

from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.lazy import dataclass


class BusState(Enum):
    """Fault confinement of a controller (ISO 11898-1:2015 12.1.4), and whether it is there at all."""

    ACTIVE = "error-active"
    PASSIVE = "error-passive"
    OFF = "bus-off"
    GONE = "gone"


@dataclass(frozen=True, slots=True)
class CanBusInfo:
    """What never changes while a controller is open."""

    name: str
    """Address in words, for example `can:can0` or `sim:500000`."""
    bits_per_second: int | None
    """Nominal bit rate; None when the adapter does not report it (virtual buses)."""
    data_bits_per_second: int | None = None
    """Bit rate of the FD data phase; None without a bit-rate switch."""
    fd: bool = False
    """The controller sends and receives CAN FD frames."""


FrameHandler = Callable[[Frame, float], None]
"""`(frame, now)`; must not block and must not raise."""

FrameTap = Callable[[float, str, Frame], None]
"""`(at, sender, frame)` for each frame that was transmitted; sender: a name on a simulated bus, `here`, or `bus`."""
StateHandler = Callable[[BusState, str, float], None]
"""`(state, reason in words, now)`."""

RoomHandler = Callable[[float], None]
"""`(now)`: a frame has left the controller."""


@runtime_checkable
class SelectiveCanBus(Protocol):
    """A controller that can be told later which frames its owner ignores, as those on a simulated bus."""

    def ignore(self, ids: Collection[int]) -> None:
        """Data frames with these 11-bit identifiers need not be passed on from now on; empty: all are."""


class CanBus(Protocol):
    """One controller on one bus. All call-backs come in the event loop's thread."""

    info: CanBusInfo

    def attach(
        self,
        *,
        frame: FrameHandler | None = None,
        room: RoomHandler | None = None,
        state: StateHandler | None = None,
    ) -> None:
        """Set those of the owner's handlers that are given; each replaces the previous one.

        Args:
            frame: takes the frames of other nodes (own frames are not heard).
            room: is called each time a frame has left the controller.
            state: is called when the controller's state changes.
        """

    def has_room(self) -> bool:
        """Whether the controller accepts another frame now."""

    def pending(self) -> int:
        """Frames handed over that have not left yet; 0 where the adapter cannot tell."""

    def send(self, frame: Frame) -> None:
        """Hand over one frame; never blocks.

        Raises:
            LinkFull: the controller has no room.
            LinkDown: the controller is off the bus.
        """

    def restart(self) -> None:
        """Return to the bus after bus-off, as soon as the bus allows it."""

    async def run(self) -> None:
        """Serve the controller until cancelled; closes it on the way out.

        Raises:
            LinkDown: it cannot be opened or has gone for good; the text names the remedy.
        """
