"""Draws the frame of the docs as an oscilloscope shows it: CAN-H and CAN-L, bit by bit, with what each piece means.

    python tools/can_picture.py docs/explain/can_frame.svg

The frame is a real one, a part's heartbeat; `msbot_agent.explain.frame_picture`, which `msbot plot --frame` uses too,
draws it.
"""

from __future__ import annotations

import sys
from pathlib import Path

from msbot_agent.explain.frame_picture import BitSpan, frame_svg, split_by_octets
from msbot_agent.link.can.protocol import CanIds, Frame, WireBit, wire_bits
from msbot_agent.link.can.protocol.frames import split
from msbot_xrce import compress
from msbot_xrce.messages import STREAM_BEST_EFFORT, Header, WriteData, encode_message, write_request_id

BITRATE = 500_000
LEASE = bytes.fromhex("a3d81173")
NUMBER = 1000
REQUESTER = 0x0017


def heartbeat() -> Frame:
    """A part's heartbeat: the lease, best effort, in one classic frame."""
    write = WriteData(write_request_id(STREAM_BEST_EFFORT, NUMBER), REQUESTER, LEASE)
    message = encode_message(Header(0x81, STREAM_BEST_EFFORT, NUMBER), [write], pad_end=True)
    (data,) = split(compress(message), 0, fd=False)
    return Frame(CanIds().up + 1, data)


def rows_of(bits: list[WireBit]) -> list[list[BitSpan]]:
    """The frame in four rows: who speaks and how, what is said (two rows), and what makes it safe."""
    by_field: dict[str, list[WireBit]] = {}
    for bit in bits:
        by_field.setdefault(bit.field, []).append(bit)
    segment, code, number, lease = split_by_octets(by_field["DATA"], (1, 1, 2, 4))
    crc = "".join(str(bit.level) for bit in by_field["CRC"] if not bit.stuff)

    def span(name: str, meaning: str, kind: str, field: str) -> BitSpan:
        return BitSpan(name, meaning, kind, by_field[field])

    return [
        [
            span("SOF", "", "start", "SOF"),
            span("ID 0x101", "from part 1 to the master", "who", "ID"),
            span("RTR", "", "control", "RTR"),
            span("IDE", "", "control", "IDE"),
            span("r0", "", "control", "R0"),
            span("DLC 8", "8 bytes", "control", "DLC"),
            BitSpan("DATA C0", "first and last frame, no. 0", "data", segment),
        ],
        [
            BitSpan("DATA 10", "a request to the inventory", "data", code),
            BitSpan("DATA E8 03", f"message {NUMBER}", "data", number),
        ],
        [BitSpan("DATA A3 D8 11 73", "the part's lease: “I am alive”", "data", lease)],
        [
            span(f"CRC {int(crc, 2):04X}", "check sum of all bits so far", "check", "CRC"),
            span("CRC end", "", "check", "CRC DELIMITER"),
            span("ACK", "", "answer", "ACK"),
            span("ACK end", "", "ends", "ACK DELIMITER"),
            span("EOF", "end of the frame", "ends", "EOF"),
            span("pause", "", "ends", "INTERMISSION"),
        ],
    ]


def picture() -> str:
    """The whole picture as SVG."""
    return frame_svg("One heartbeat of a part on the wire", rows_of(wire_bits(heartbeat())), bitrate=BITRATE)


def main() -> None:
    """Write the picture to the file that is named."""
    Path(sys.argv[1]).write_text(picture())


if __name__ == "__main__":
    main()
