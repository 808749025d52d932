"""The buses that everything about CAN is measured on, and the framings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from msbot_agent.link.can import Codec
from msbot_agent.link.can.protocol import Frame, FrameBits, frame_bits
from msbot_agent.link.can.protocol.frames import split
from msbot_agent.link.can.sim import SimBus
from msbot_xrce import compress, decompress

CODEC = Codec(compress, decompress)


@dataclass(frozen=True)
class Rates:
    """One kind of bus."""

    nominal: int
    data: int | None = None

    @property
    def fd(self) -> bool:
        """Whether it is CAN FD."""
        return self.data is not None

    @property
    def name(self) -> str:
        """In a table's words."""
        if self.data is None:
            return f"{self.nominal // 1000}k"
        return f"FD {self.nominal // 1000}k/{self.data // 1_000_000}M"

    def seconds(self, frames: Iterable[Frame]) -> float:
        """Time the frames occupy the bus."""
        return sum(frame_bits(frame).seconds(self.nominal, self.data) for frame in frames)

    def bus(self) -> SimBus:
        """A simulated bus."""
        return SimBus(self.nominal, data_bitrate=self.data, fd=self.fd)


BUSES = (
    *(Rates(bitrate) for bitrate in (125_000, 250_000, 500_000, 1_000_000)),
    Rates(500_000, 2_000_000),
    Rates(1_000_000, 5_000_000),
)
SIZES = (1, 10, 50, 120)
"""Parts on a bus."""


def bits(frames: Iterable[Frame]) -> FrameBits:
    """What the frames take on the wire, all together."""
    nominal = data = 0
    for frame in frames:
        one = frame_bits(frame)
        nominal, data = nominal + one.nominal_bits, data + one.data_bits
    return FrameBits(nominal, data)


def classic(packet: bytes, can_id: int) -> list[Frame]:
    """Our frames on classic CAN."""
    return [Frame(can_id, data) for data in split(packet, 0, False)]


def fast(packet: bytes, can_id: int) -> list[Frame]:
    """Our frames on CAN FD with bit-rate switch."""
    return [Frame(can_id, data, fd=True, brs=True) for data in split(packet, 0, True)]


def thesis(packet: bytes, can_id: int) -> list[Frame]:
    """The frames of the thesis' firmware: 7 bytes behind an index that counts down to 0."""
    chunks = [packet[start : start + 7] for start in range(0, len(packet), 7)]
    return [Frame(can_id, bytes((len(chunks) - 1 - n,)) + chunk) for n, chunk in enumerate(chunks)]


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """A table of a page."""
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return [lines[0], "|---" * len(head) + "|", *lines[1:]]
