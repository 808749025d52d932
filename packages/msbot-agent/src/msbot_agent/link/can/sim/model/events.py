"""The events that the simulated bus reports to its owner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import WireBit
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass


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


# The effects of errors on a CAN bus: which node notices when, and the counters that take a bad controller off the bus.
#
# Pure rules of ISO 11898-1:2015 chapter 12 (fault confinement) and 10.4.4 (error frame), used by the bus simulator.


ERROR_FLAG = 6
"""Bits of an error flag: dominant when error-active, recessive when error-passive."""
ERROR_DELIMITER = 8
"""Recessive bits after the flags."""
SUSPEND = 8
"""Bits an error-passive transmitter waits longer than others."""
RECOVERY_SEQUENCES = 128
"""How many times 11 recessive bits in a row a controller waits for after bus-off."""
RECOVERY_BITS = 11

PASSIVE_LIMIT = 127
"""A counter above this makes the controller error-passive."""
OFF_LIMIT = 255
"""A transmit error counter above this takes the controller off the bus."""

DOMINANT, RECESSIVE = 0, 1


@dataclass(slots=True)
class ErrorCounters:
    """Fault confinement of one controller."""

    transmit: int = 0
    receive: int = 0
    off: bool = False

    @property
    def state(self) -> BusState:
        """The controller's state, which follows from the counters."""
        if self.off:
            return BusState.OFF
        if self.transmit > PASSIVE_LIMIT or self.receive > PASSIVE_LIMIT:
            return BusState.PASSIVE
        return BusState.ACTIVE

    @property
    def active(self) -> bool:
        """Whether its error flags are dominant."""
        return not self.off and self.transmit <= PASSIVE_LIMIT and self.receive <= PASSIVE_LIMIT

    def transmit_failed(self) -> None:
        """Rule c: a transmitter sent an error flag."""
        self.transmit += 8
        self.off = self.off or self.transmit > OFF_LIMIT

    def transmit_succeeded(self) -> None:
        """Rule g: a frame was sent."""
        self.transmit = max(0, self.transmit - 1)

    def receive_failed(self, *, first: bool = False) -> None:
        """Rule a, and rule b for the receiver that was the `first` to send an error flag."""
        self.receive += 9 if first else 1

    def receive_succeeded(self) -> None:
        """Rule h: a frame was received; an error-passive counter goes to the lower end of 119 to 127."""
        self.receive = 119 if self.receive > PASSIVE_LIMIT else max(0, self.receive - 1)


def is_tail(bit: WireBit) -> bool:
    """Whether a bit is in the part of the frame with a fixed form and no stuff bits."""
    return bit.field in ("CRC DELIMITER", "ACK", "ACK DELIMITER", "EOF", "INTERMISSION")


def noticed_at(bits: Sequence[WireBit], broken: int, broken_level: int, level: int) -> int | None:
    """The bit at which a receiver finds the frame wrong when the bus has one level from bit `broken` + 1 on.

    That level is dominant during a node's error flag, recessive if the transmitter has fallen silent. A receiver finds
    a stuff error at the sixth equal bit, a form error at a wrong fixed stuff bit or a dominant bit in the tail, and a
    CRC error after the ACK delimiter.

    Args:
        bits: the frame as intended.
        broken: index of the last bit before the level stays constant; -1 = none was sent.
        broken_level: the level of that bit on the bus.
        level: the level from then on.

    Returns:
        Index of the bit, at least `broken`; None when the receiver sees a perfect frame.
    """
    seen = [bit.level for bit in bits[: max(broken, 0)]]
    if broken >= 0:
        seen.append(broken_level)
    altered = broken >= 0 and broken_level != bits[broken].level and not is_tail(bits[broken])
    run = _trailing_run(seen)
    if broken >= 0 and _is_wrong(bits[broken], seen, run):
        return broken
    for index in range(broken + 1, len(bits)):
        bit = bits[index]
        run = run + 1 if seen and seen[-1] == level else 1
        seen.append(level)
        altered = altered or (level != bit.level and not is_tail(bit))
        if _is_wrong(bit, seen, run) or (altered and bit.field == "ACK DELIMITER"):
            return index
    return None


def _is_wrong(bit: WireBit, seen: Sequence[int], run: int) -> bool:
    if bit.field in ("ACK", "INTERMISSION"):
        return False
    if is_tail(bit):
        return seen[-1] == DOMINANT
    if bit.fixed:
        return len(seen) > 1 and seen[-1] == seen[-2]
    return run >= 6


def _trailing_run(levels: Sequence[int]) -> int:
    run = 0
    while run < len(levels) and levels[-1 - run] == levels[-1]:
        run += 1
    return run
