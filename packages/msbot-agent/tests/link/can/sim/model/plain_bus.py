"""A second, plain model of a CAN bus, beside `msbot_agent.link.can.sim.model`: every node decides bit by bit what it
drives.

It follows ISO 11898-1:2015, 10.4 and chapter 12, with the simplification that the module says of itself: an
error-passive node's flag keeps nobody from going on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import repeat

from msbot_agent.link.can.protocol.bits import WireBit
from msbot_agent.link.can.sim.model.arbitration import Rates
from msbot_agent.link.can.sim.model.events import is_tail


class Mode(Enum):
    FRAME = 0
    FLAG = 1
    WAIT = 2
    DELIMITER = 3
    DONE = 4


@dataclass
class PlainNode:
    """A controller that decides bit by bit."""

    sends: bool
    passive: bool = False
    classic: bool = False
    mode: Mode = Mode.FRAME
    left: int = 0
    run: int = 0
    last: int = -1
    altered: bool = False
    counted: tuple[int, int] = (0, 0)
    """What is added to its transmit and its receive error counter."""

    def drive(self, bit: WireBit) -> int:
        if self.mode is Mode.FLAG:
            return int(self.passive)
        if self.mode is not Mode.FRAME:
            return 1
        if bit.field == "ACK":
            return 1 if self.sends or self.altered else 0
        return bit.level if self.sends else 1

    def see(self, bit: WireBit, driven: int, level: int) -> None:
        if self.mode is Mode.FRAME:
            if self._finds_error(bit, driven, level):
                self.mode, self.left = Mode.FLAG, 6
                self.counted = (8, 0) if self.sends else (0, 1)
        elif self.mode is Mode.FLAG:
            self.left -= 1
            if not self.left:
                self.mode = Mode.WAIT
        elif self.mode is Mode.WAIT and level == 1:
            self.mode, self.left = Mode.DELIMITER, 7
        elif self.mode is Mode.WAIT and not (self.sends or self.passive):
            self.counted = (0, 9)  # rule b: a dominant bit follows the flag of a receiver
        elif self.mode is Mode.DELIMITER:
            self.left -= 1
            if not self.left:
                self.mode = Mode.DONE

    def _finds_error(self, bit: WireBit, driven: int, level: int) -> bool:
        if self.sends and bit.field in ("ID", "RTR", "SRR", "IDE", "RRS") and driven > level and not bit.stuff:
            self.sends = False  # arbitration lost, even to a disturbance
        self.run = self.run + 1 if level == self.last else 1
        wrong_fixed = bit.fixed and level == self.last
        self.last = level
        self.altered = self.altered or (level != bit.level and not is_tail(bit))
        if bit.field == "ACK":
            return level == 1 and (self.sends or not self.altered)
        if self.sends:
            return level != driven
        if is_tail(bit):
            return level == 0 or (bit.field == "ACK DELIMITER" and self.altered)
        return wrong_fixed or self.run == 6 or (self.classic and bit.field == "FDF" and level == 1)


@dataclass(frozen=True)
class Course:
    """What it came to."""

    bits: int
    """Until the bus is free, intermission included."""
    seconds: float
    """The same."""


def plain_bus(
    nodes: Sequence[tuple[PlainNode, list[WireBit]]],
    rates: Rates,
    *,
    flip: int = -1,
    leaves_at: int = -1,
    shorted_from: int = 1 << 30,
) -> Course:
    """Let the nodes meet, each with the frame it sends, or takes what it sees for.

    Args:
        nodes: at least one error-active, or all passive and alone.
        rates: bit times.
        flip: the bit that is disturbed.
        leaves_at: the bit from which on the first node is not there any more.
        shorted_from: the bit from which on no dominant one is seen.
    """
    wires = [[*wire[:-3], *repeat(WireBit(1, "IDLE"), 200)] for _, wire in nodes]
    ends = [len(wire) - 3 for _, wire in nodes]
    deciding = [it for it, _ in nodes if not it.passive] or [it for it, _ in nodes]
    seconds = 0.0
    for index in range(min(map(len, wires))):
        for (it, _), end in zip(nodes, ends, strict=True):
            it.mode = Mode.DONE if it.mode is Mode.FRAME and index == end else it.mode
        if index == leaves_at:
            nodes[0][0].mode = Mode.DONE
        if all(it.mode is Mode.DONE for it in deciding):
            return Course(index + 3, seconds + 3 * rates.bit_s)
        driven = [it.drive(wire[index]) for (it, _), wire in zip(nodes, wires, strict=True)]
        level = 1 if index >= shorted_from else min(driven) ^ (index == flip)
        is_fast = any(it.mode is Mode.FRAME and wire[index].fast for (it, _), wire in zip(nodes, wires, strict=True))
        seconds += rates.fast_bit_s if is_fast else rates.bit_s
        for (it, _), wire, own in zip(nodes, wires, driven, strict=True):
            it.see(wire[index], own, level)
    raise AssertionError("the bus never gets free")
