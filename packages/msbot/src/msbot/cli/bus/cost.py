"""What frames cost on the wire: `msbot bus cost`."""

from __future__ import annotations

import json
from collections.abc import Sequence

from msbot_agent.link.can.protocol import Frame, FrameBits, parse_frame, phase_bits, wire_bits
from msbot_xrce.common.lazy_dataclass import dataclass

TITLES = ("frame", "nominal bits", "data bits", "of these stuffed", "µs on the wire")


@dataclass(frozen=True, slots=True)
class FrameCost:
    """One frame and its bits."""

    text: str
    """The frame as it was written."""
    frame: Frame
    bits: FrameBits
    """The data phase of CAN FD, from ESI to the last bit of the CRC, is counted separately."""

    def microseconds(self, bitrate: int, data_bitrate: int) -> float:
        """Time on the wire at these bit rates (bit/s); without a bit-rate switch all bits take the nominal one."""
        return self.bits.seconds(bitrate, data_bitrate if self.frame.brs else bitrate) * 1e6

    def stuff_bits(self) -> int:
        """How many of the bits are stuff bits, dynamic and fixed."""
        return sum(bit.stuff for bit in wire_bits(self.frame))


def costs(texts: Sequence[str]) -> list[FrameCost]:
    """The cost of each frame.

    Raises:
        ConfigError: a frame is malformed; the text says what would be right.
        LocalProtocolError: a frame is an error report, which is never on the wire.
    """
    frames = [(text, parse_frame(text)) for text in texts]
    return [FrameCost(text, frame, phase_bits(frame)) for text, frame in frames]


def cost_json(texts: Sequence[str]) -> str:
    """The costs as a JSON list of objects, in the order of the frames."""
    return json.dumps(
        [
            {"frame": cost.text, "nominal_bits": cost.bits.nominal_bits, "data_bits": cost.bits.data_bits}
            for cost in costs(texts)
        ]
    )


def cost_table(texts: Sequence[str], bitrate: int, data_bitrate: int) -> str:
    """The costs as lines with columns, and their sum when there are several frames."""
    found = costs(texts)
    stuffed = [cost.stuff_bits() for cost in found]
    times = [cost.microseconds(bitrate, data_bitrate) for cost in found]
    rows = [
        (cost.text, cost.bits.nominal_bits, cost.bits.data_bits, stuff, time)
        for cost, stuff, time in zip(found, stuffed, times, strict=True)
    ]
    if len(rows) > 1:
        nominal, data = (sum(cost.bits[phase] for cost in found) for phase in (0, 1))
        rows.append(("together", nominal, data, sum(stuffed), sum(times)))
    width = max(len(row[0]) for row in (TITLES, *rows))
    lines = ["  ".join((TITLES[0].ljust(width), *TITLES[1:]))]
    for text, *numbers, time in rows:
        cells = [str(number).rjust(len(title)) for number, title in zip(numbers, TITLES[1:], strict=False)]
        lines.append("  ".join((text.ljust(width), *cells, f"{time:.2f}".rjust(len(TITLES[-1])))))
    return "\n".join(lines)
