"""What a world takes of a CAN bus: identifiers, kinds of frames, traffic. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Final

from msbot_agent.link.can.protocol import Frame, frame_bits
from msbot_xrce.lazy import dataclass

_TRIED: Final = 32
"""Frames with different octets whose mean is the cost of one: stuff bits depend on them."""


@dataclass(frozen=True, slots=True)
class Identifiers:
    """A range of identifiers."""

    what: str
    """Who has them, in the words of that world: `PDOs`."""
    first: int
    last: int
    extended: bool = False
    """29 bits; those of 11 bits are others, whatever the numbers are."""

    def meets(self, other: Identifiers) -> bool:
        """Whether a frame of one can have the identifier of a frame of the other."""
        return self.extended == other.extended and self.first <= other.last and other.first <= self.last

    def __str__(self) -> str:
        """As people write them."""
        bits = " in 29 bits" if self.extended else ""
        last = "" if self.first == self.last else f" to {self.last:#05x}"
        return f"{self.what} ({self.first:#05x}{last}{bits})"


@dataclass(frozen=True, slots=True)
class BridgeTraffic:
    """Frames that are sent all the time: an estimate for the load of the bus."""

    what: str
    can_id: int
    octets: int
    """Data bytes of a frame."""
    frames_per_s: float
    of_bridge: bool = False
    """Sent by the bridge itself, once; else for each device."""


@dataclass(frozen=True, slots=True)
class CanClaim:
    """What a world, or the parts of a robot, take of a bus."""

    identifiers: Sequence[Identifiers]
    bitrates: Sequence[int] = ()
    """The bit rates that its devices have; none: any."""
    fd: bool = False
    """Frames of CAN FD; controllers of classic CAN destroy them."""
    traffic: Sequence[BridgeTraffic] = ()

    def bits_per_s(self, devices: int) -> float:
        """What the bridge and so many devices send."""
        return sum(
            one.frames_per_s * _bits(one, extended=self._is_extended(one.can_id)) * (1 if one.of_bridge else devices)
            for one in self.traffic
        )

    def frames_per_s(self, devices: int) -> float:
        """The same in frames."""
        return sum(one.frames_per_s * (1 if one.of_bridge else devices) for one in self.traffic)

    def _is_extended(self, can_id: int) -> bool:
        return any(one.extended and one.first <= can_id <= one.last for one in self.identifiers)


def _bits(traffic: BridgeTraffic, *, extended: bool) -> float:
    random = Random(traffic.can_id)
    frames = (Frame(traffic.can_id, random.randbytes(traffic.octets), extended) for _ in range(_TRIED))
    return sum(sum(frame_bits(frame)) for frame in frames) / _TRIED
