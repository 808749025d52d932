"""What single messages cost on the bus, in each framing: pure arithmetic on the frames as they are sent."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from bench.buses import bits, classic, fast, table, thesis
from msbot_agent.link.can.protocol import Frame
from msbot_xrce import compress
from msbot_xrce.messages import (
    FIRST_REQUEST,
    STREAM_BEST_EFFORT,
    STREAM_NONE,
    STREAM_RELIABLE,
    Acknack,
    Data,
    Header,
    Submessage,
    WriteData,
    encode_message,
    read_request_id,
    write_request_id,
)

THESIS_BYTES = 418
"""The message that took "over a minute" (thesis 4.2.5)."""
NUMBER = 1000
"""Sequence number of the messages below."""
IN_SESSION = 0x81
REQUESTER = 0x0017

Packets = list[tuple[bool, bytes]]
"""Messages as pairs of (from part to master, octets)."""
Cut = Callable[[bytes, int], list[Frame]]


def written(stream_id: int, object_id: int, payload: bytes) -> tuple[bool, bytes]:
    """A message of our client, from part to master."""
    write = WriteData(write_request_id(stream_id, NUMBER), object_id, payload)
    return True, _message(stream_id, NUMBER, write, pad_end=True)


def read(stream_id: int, object_id: int, payload: bytes) -> tuple[bool, bytes]:
    """A message of the agent, from master to part."""
    return False, _message(stream_id, NUMBER, Data(read_request_id(object_id), object_id, payload), pad_end=False)


def acknowledged(*, up: bool) -> tuple[bool, bytes]:
    """The ACKNACK of a reliable message."""
    return up, _message(STREAM_NONE, 0, Acknack(NUMBER + 1, 0, STREAM_RELIABLE), pad_end=False)


def _message(stream_id: int, sequence_nr: int, content: Submessage, *, pad_end: bool) -> bytes:
    return encode_message(Header(IN_SESSION, stream_id, sequence_nr), [content], pad_end=pad_end)


LEASE = bytes.fromhex("a3d81173")
ONE = bytes.fromhex("0000803f")
RELATED = write_request_id(STREAM_BEST_EFFORT, NUMBER).to_bytes(2, "big") + REQUESTER.to_bytes(2, "big")
NOISE = Random(3).randbytes(THESIS_BYTES - 12)

BEAT: Packets = [
    written(STREAM_BEST_EFFORT, REQUESTER, LEASE),
    read(STREAM_BEST_EFFORT, REQUESTER, RELATED + (1).to_bytes(4, "little")),
]
"""A part's heartbeat and its answer."""
LARGE: Packets = [read(STREAM_BEST_EFFORT, 0x0026, NOISE)]
CREATE_CLIENT: Packets = [(True, bytes.fromhex("8000000000011000585243450100010f3b80883d81007405"))]
STATUS_AGENT: Packets = [(False, bytes.fromhex("8100000004010b000000585243450100010f00"))]
HEARTBEAT: Packets = [(False, bytes.fromhex("810000000b0105000700070080"))]

THESIS_REQUEST = bytes.fromhex("0500000041424344000000000b000000414243442d6c6f63616c00").ljust(96, b"\0")
THESIS_REPLY = bytes.fromhex("050000004142434400").ljust(96, b"\0")
THESIS_BEAT: Packets = [
    (
        True,
        _message(STREAM_RELIABLE, NUMBER, WriteData(FIRST_REQUEST + NUMBER, REQUESTER, THESIS_REQUEST), pad_end=True),
    ),
    acknowledged(up=False),
    (
        False,
        _message(STREAM_RELIABLE, NUMBER, Data(FIRST_REQUEST + 1, REQUESTER, RELATED + THESIS_REPLY), pad_end=False),
    ),
    acknowledged(up=True),
]
"""The same in the thesis' programs: 96 octets each way, on reliable streams."""

MESSAGES: tuple[tuple[str, Packets], ...] = (
    ("heartbeat round trip", BEAT),
    ("4-byte sample from a part, best effort", [written(STREAM_BEST_EFFORT, 0x0015, ONE)]),
    ("4-byte sample to a part, best effort", [read(STREAM_BEST_EFFORT, 0x0026, ONE)]),
    (
        "4-byte sample from a part, reliable, with its ACKNACK",
        [written(STREAM_RELIABLE, 0x0015, ONE), acknowledged(up=False)],
    ),
    (
        "4-byte sample to a part, reliable, with its ACKNACK",
        [read(STREAM_RELIABLE, 0x0026, ONE), acknowledged(up=True)],
    ),
    (f"{THESIS_BYTES}-byte message, noise", LARGE),
)

MODES: tuple[tuple[str, Cut, Callable[[bytes], bytes], tuple[int, int]], ...] = (
    ("thesis", thesis, bytes, (0x123, 0x120)),
    ("classic", classic, bytes, (0x101, 0x181)),
    ("classic, compressed", classic, compress, (0x101, 0x181)),
    ("FD", fast, bytes, (0x101, 0x181)),
    ("FD, compressed", fast, compress, (0x101, 0x181)),
)
"""Name, frames of a packet, what is done to the packet before, identifiers up and down."""


def frames_of(packets: Packets, mode: str) -> list[Frame]:
    """The frames of these messages in a mode."""
    _, cut, prepare, (up_id, down_id) = next(row for row in MODES if row[0] == mode)
    return [frame for up, packet in packets for frame in cut(prepare(packet), up_id if up else down_id)]


def cost_table() -> list[str]:
    """What the commonest messages cost in each mode."""
    rows = []
    for name, packets in MESSAGES:
        row = [name]
        for mode, *_ in MODES:
            frames = frames_of(packets, mode)
            nominal, data = bits(frames)
            row.append(f"{len(frames)}: {nominal}" + (f" + {data}" if data else ""))
        rows.append(row)
    return table(["message", *(name for name, *_ in MODES)], rows)
