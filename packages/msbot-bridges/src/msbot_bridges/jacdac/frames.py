"""Jacdac's frames: several packets of one sender, or several commands for one device.

A frame is a CRC (2 bytes), the size of its packets (1), flags (1), a device (8), then the packets, each with its size
(1), a service of the device (1), a command (2) and data, padded to 4 bytes. Numbers are little-endian. Source: the
specification of Jacdac's protocol (microsoft.github.io/jacdac-docs/reference/protocol).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field

from msbot_xrce.errors import MsbotError
from msbot_xrce.lazy import dataclass

HEADER = 12
MOST_DATA = 236
"""Bytes of data that a packet may have."""
MOST_SIZE = 240
"""Bytes that the packets of a frame may have together."""
IS_COMMAND = 0x01
"""For the device that the frame names; otherwise it is from that device."""
TO_CLASS = 0x04
"""For all services of one class; the device is no device then."""

ANNOUNCE = 0x0000
GET, SET, EVENT = 0x1000, 0x2000, 0x8000
"""What a command is, in its upper bits; the register of GET and SET is in the lower twelve."""


class BadFrame(MsbotError):
    """What has come is no frame of Jacdac; the text says why."""


@dataclass(frozen=True, slots=True)
class Packet:
    """One command, or one report."""

    service: int
    """Index among the services of the device; 0 is control."""
    command: int
    data: bytes = field(default=b"")


@dataclass(frozen=True, slots=True)
class JacdacFrame:
    """What one device has sent, or what is for it."""

    device: bytes
    """8 bytes, unique for each device."""
    packets: tuple[Packet, ...]
    is_command: bool
    to_class: bool = False


def checksum(data: bytes) -> int:
    """CRC-16 with the polynomial 0x1021, from 0xFFFF."""
    value = 0xFFFF
    for byte in data:
        mixed = (value >> 8) ^ byte
        mixed ^= mixed >> 4
        value = ((value << 8) ^ (mixed << 12) ^ (mixed << 5) ^ mixed) & 0xFFFF
    return value


def decode_frame(data: bytes) -> JacdacFrame:
    """Read a frame.

    Raises:
        BadFrame: it is none.
    """
    if len(data) < HEADER:
        raise BadFrame(f"{len(data)} bytes, fewer than the {HEADER} of a header")
    size, flags = data[2], data[3]
    end = HEADER + size
    if size > MOST_SIZE or len(data) < end:
        raise BadFrame(f"packets of {size} bytes are announced, and {len(data) - HEADER} have come")
    if int.from_bytes(data[:2], "little") != checksum(data[2:end]):
        raise BadFrame("the checksum is wrong")
    packets = []
    at = HEADER
    while at + 4 <= end:
        length = data[at]
        if at + 4 + length > end:
            raise BadFrame(f"a packet announces {length} bytes of data, and {end - at - 4} are left")
        command = int.from_bytes(data[at + 2 : at + 4], "little")
        packets.append(Packet(data[at + 1] & 0x3F, command, data[at + 4 : at + 4 + length]))
        at += (4 + length + 3) & ~3
    return JacdacFrame(data[4:HEADER], tuple(packets), bool(flags & IS_COMMAND), bool(flags & TO_CLASS))


def encode_commands(device: bytes, packets: Iterable[Packet]) -> list[bytes]:
    """Frames with these commands for a device, as few as they fit in."""
    frames: list[bytes] = []
    body = b""
    for packet in packets:
        if len(packet.data) > MOST_DATA:
            raise ValueError(f"{len(packet.data)} bytes of data, and a packet has room for {MOST_DATA}")
        one = bytes((len(packet.data), packet.service)) + packet.command.to_bytes(2, "little") + packet.data
        one += bytes(-len(one) % 4)
        if len(body) + len(one) > MOST_SIZE:
            frames.append(_frame(device, body))
            body = b""
        body += one
    if body:
        frames.append(_frame(device, body))
    return frames


def _frame(device: bytes, body: bytes) -> bytes:
    rest = bytes((len(body), IS_COMMAND)) + device + body
    return checksum(rest).to_bytes(2, "little") + rest
