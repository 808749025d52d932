"""The events that the simulated bus reports to its owner."""

from __future__ import annotations

from dataclasses import field

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.common.tally import Tally


@dataclass(frozen=True, slots=True)
class Delivered:
    """A frame has arrived at these nodes."""

    at: float
    nodes: list[int]
    frame: Frame


@dataclass(frozen=True, slots=True)
class Sent:
    """A node's frame has left its controller, acknowledged by at least one other node."""

    at: float
    node: int
    frame: Frame


@dataclass(frozen=True, slots=True)
class StateChanged:
    """A node became error-active, error-passive or bus-off."""

    at: float
    node: int
    state: BusState


BusEvent = Delivered | Sent | StateChanged


@dataclass(slots=True)
class BusCounters:
    """What happened on the bus since it was made."""

    frames: int = 0
    """Frames that were transmitted."""
    bits: int = 0
    """Bits on the bus, intermission and error frames included."""
    busy_s: float = 0.0
    """Seconds that these bits took."""
    errors: int = 0
    """Attempts that failed."""
    overloads: int = 0
    """Overload frames: the intermission was disturbed."""
    by_error: Tally = field(default_factory=Tally)
    """Failed attempts by cause, in words."""
