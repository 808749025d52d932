"""The bits of a CAN frame on the wire: their number, exactly, and the bits themselves (ISO 11898-1:2015).

Theory of operation. Classic frames are stuffed from SOF to the last bit of the CRC-15: after five equal bits comes one
of the other level, which counts for the next run; so a stuff bit may follow the last CRC bit. CAN FD frames are stuffed
like this only to the end of the data field. Then follow the stuff count (number of stuff bits modulo 8, Gray coded,
with a parity bit) and the CRC, with a fixed stuff bit before the stuff count and after every fourth bit. Where a
dynamic stuff bit would directly precede the first fixed one, there is only the fixed one (ISO 11898-1:2015 10.5), and
it is not counted. The FD CRC covers the dynamic stuff bits and the stuff count, the classic one no stuff bits.

A bit-rate switch happens at the sample point of BRS, and back at the sample point of the CRC delimiter (ISO
11898-1:2015 11.3.2). Whatever the sample points are, these two bits together take one nominal and one data bit time;
here BRS counts as the nominal one and the CRC delimiter as the other.

`frame_bits` counts with tables, eight bits a step, because the bus simulator needs it for every frame; `wire_bits`
is the plain, bit-by-bit description. The tests compare the two.
"""

from __future__ import annotations

from array import array
from dataclasses import replace
from functools import cache, lru_cache
from typing import NamedTuple

from msbot_agent.link.can.protocol.frames import FD_LENGTHS, Frame, check_frame
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.lazy import dataclass

INTERMISSION = 3
"""Recessive bits between two frames."""
TAIL = 1 + 1 + 1 + 7 + INTERMISSION
"""CRC delimiter, ACK slot, ACK delimiter, end of frame, intermission: never stuffed."""

CRC15_POLYNOMIAL = 0x4599
CRC17_POLYNOMIAL = 0x1685B
CRC21_POLYNOMIAL = 0x102899

_STUFF_COUNT = tuple(gray << 1 | gray.bit_count() & 1 for gray in (count ^ count >> 1 for count in range(8)))


class FrameBits(NamedTuple):
    """Length of a frame in bits, stuff bits and the 3 bits of intermission included."""

    nominal_bits: int
    """Bits at the nominal bit rate; with a bit-rate switch: up to and including BRS, and from the ACK slot on."""
    data_bits: int
    """Bits at the data bit rate: from ESI to the CRC delimiter; 0 without a bit-rate switch."""

    def seconds(self, bitrate: float, data_bitrate: float | None = None) -> float:
        """Time on the bus at these bit rates (bit/s)."""
        return self.nominal_bits / bitrate + self.data_bits / (data_bitrate or bitrate)


@dataclass(frozen=True, slots=True)
class WireBit:
    """One bit as it is on the wire."""

    level: int
    """0 dominant, 1 recessive."""
    field: str
    """Which part of the frame it belongs to; a stuff bit belongs to the part it follows."""
    stuff: bool = False
    fixed: bool = False
    """A stuff bit at a fixed position (FD CRC field)."""
    fast: bool = False
    """Sent at the data bit rate."""


def frame_bits(frame: Frame) -> FrameBits:
    """Exact length of a frame, intermission included.

    Raises:
        LocalProtocolError: no controller could send this frame.
    """
    check_frame(frame)
    if frame.fd:
        bits = _fd_phase_bits(frame)
        return bits if frame.brs else FrameBits(bits.nominal_bits + bits.data_bits, 0)
    return _classic_frame_bits(frame)


def busy_seconds(frame: Frame, bitrate: float, data_bitrate: float | None = None) -> float:
    """How long a frame that was heard keeps the bus busy; 0 for what is no frame of a controller: an error frame, or
    what somebody else has recorded."""
    try:
        return frame_bits(frame).seconds(bitrate, data_bitrate)
    except LocalProtocolError:
        return 0.0


def phase_bits(frame: Frame) -> FrameBits:
    """As `frame_bits`, but with the phases of a CAN FD frame separate even if it has no bit-rate switch.

    Raises:
        LocalProtocolError: no controller could send this frame.
    """
    check_frame(frame)
    return _fd_phase_bits(frame) if frame.fd else _classic_frame_bits(frame)


def wire_bits(frame: Frame, *, acknowledged: bool = True) -> list[WireBit]:
    """Every bit of a frame in order, from SOF to the last bit of the intermission.

    Raises:
        LocalProtocolError: no controller could send this frame.
    """
    check_frame(frame)
    writer = _Writer(frame)
    for level, name in _header_fields(frame):
        writer.put(level, name)
    for octet in frame.data:
        writer.put_number(octet, 8, "DATA")
    if frame.fd:
        writer.close_fd()
    else:
        writer.put_number(writer.crc, 15, "CRC")
    levels = (1, 0 if acknowledged else 1, 1, *(1,) * 7, *(1,) * INTERMISSION)
    names = ("CRC DELIMITER", "ACK", "ACK DELIMITER", *("EOF",) * 7, *("INTERMISSION",) * INTERMISSION)
    delimiter, *tail = [WireBit(level, name) for level, name in zip(levels, names, strict=True)]
    return [*writer.bits, replace(delimiter, fast=frame.brs), *tail]


def arbitration_rank(frame: Frame) -> int:
    """The arbitration field as a number: of frames that start together, the lowest wins the bus.

    Bit by bit as on the wire: 11 identifier bits, RTR (or SRR), IDE, 18 more identifier bits, RTR. A standard frame
    wins against an extended one with the same first 11 bits, a data frame against a remote frame.
    """
    if frame.extended:
        return (frame.can_id >> 18) << 21 | 0b11 << 19 | (frame.can_id & 0x3FFFF) << 1 | frame.remote
    return frame.can_id << 21 | frame.remote << 20


def _header_fields(frame: Frame) -> list[tuple[int, str]]:
    bits: list[tuple[int, str]] = [(0, "SOF")]
    if frame.extended:
        bits += [*_number(frame.can_id >> 18, 11, "ID"), (1, "SRR"), (1, "IDE")]
        bits += _number(frame.can_id & 0x3FFFF, 18, "ID")
    else:
        bits += _number(frame.can_id, 11, "ID")
    if frame.fd:
        bits += [(0, "RRS")] + ([] if frame.extended else [(0, "IDE")])
        bits += [(1, "FDF"), (0, "RES"), (int(frame.brs), "BRS"), (int(frame.esi), "ESI")]
    else:
        bits += [(int(frame.remote), "RTR")] + ([(0, "R1")] if frame.extended else [(0, "IDE")]) + [(0, "R0")]
    return bits + _number(data_length_code(frame), 4, "DLC")


def data_length_code(frame: Frame) -> int:
    """The data length code in the frame's control field, 0 to 15."""
    if frame.long_dlc:
        return frame.long_dlc
    if frame.remote:
        return frame.remote_length
    return FD_LENGTHS.index(len(frame.data))


def _number(value: int, width: int, name: str) -> list[tuple[int, str]]:
    return [(value >> place & 1, name) for place in reversed(range(width))]


class _Writer:
    """Writes bits one by one with stuffing and CRC; `crc` is the classic CRC-15 so far."""

    def __init__(self, frame: Frame) -> None:
        self.bits: list[WireBit] = []
        self.crc = 0
        self._fd = frame.fd
        self._fast = frame.brs
        self._in_data_phase = False
        self._size = len(frame.data)
        self._run = 0
        self._last = -1
        self._stuffed = 0

    def put(self, level: int, name: str) -> None:
        """One bit, and the stuff bit that five equal ones call for."""
        self._in_data_phase = self._in_data_phase or (self._fast and name == "ESI")
        self._append(level, name, stuff=False)
        self.crc = _crc_step(self.crc, level, 15, CRC15_POLYNOMIAL)
        if self._run == 5:
            self._append(1 - level, name, stuff=True)
            self._stuffed += 1

    def put_number(self, value: int, width: int, name: str) -> None:
        """A field, most significant bit first."""
        for place in reversed(range(width)):
            self.put(value >> place & 1, name)

    def close_fd(self) -> None:
        """Stuff count and CRC of an FD frame, with their fixed stuff bits."""
        if self.bits[-1].stuff:
            # There must not be two stuff bits in a row: the fixed one, of the same level, takes its place.
            self.bits.pop()
            self._stuffed -= 1
        width, polynomial = (17, CRC17_POLYNOMIAL) if self._size <= 16 else (21, CRC21_POLYNOMIAL)
        count = _number(_STUFF_COUNT[self._stuffed % 8], 4, "STUFF COUNT")
        crc = 1 << (width - 1)
        for level in [bit.level for bit in self.bits] + [level for level, _ in count]:
            crc = _crc_step(crc, level, width, polynomial)
        for position, (level, name) in enumerate(count + _number(crc, width, "CRC")):
            if position % 4 == 0:
                self.bits.append(WireBit(1 - self.bits[-1].level, name, True, True, self._in_data_phase))
            self.bits.append(WireBit(level, name, False, False, self._in_data_phase))

    def _append(self, level: int, name: str, *, stuff: bool) -> None:
        self._run = self._run + 1 if level == self._last else 1
        self._last = level
        self.bits.append(WireBit(level, name, stuff, False, self._in_data_phase))


def _crc_step(crc: int, level: int, width: int, polynomial: int) -> int:
    feedback = crc >> (width - 1) ^ level
    crc = crc << 1 & (1 << width) - 1
    return crc ^ polynomial if feedback & 1 else crc


# Counting by tables, small ones, because most frames come when the processor's caches have forgotten them. A stuffing
# state is the level of the last bit on the wire and how many equal ones end there (1 to 4: at 5 the stuff bit has
# already followed), packed as level * 4 + run - 1.


def _classic_frame_bits(frame: Frame) -> FrameBits:
    header = _header((frame.can_id, frame.extended, frame.remote, False, False, False, data_length_code(frame)))
    state, stuffed, crc = header.state, header.nominal_stuffed, header.crc
    octets, rest, crc_table = _stuffing_table(8), _stuffing_table(7), _crc15_table()
    for octet in frame.data:
        crc = (crc << 8 & 0x7FFF) ^ crc_table[crc >> 7 ^ octet]
        entry = octets[state][octet]
        state = entry & 7
        stuffed += entry >> 3
    entry = octets[state][crc >> 7]
    stuffed += (entry >> 3) + (rest[entry & 7][crc & 0x7F] >> 3)
    return FrameBits(header.bits + 8 * len(frame.data) + 15 + TAIL + stuffed, 0)


def _fd_phase_bits(frame: Frame) -> FrameBits:
    header = _header((frame.can_id, frame.extended, False, True, frame.brs, frame.esi, data_length_code(frame)))
    state, stuffed = header.state, header.data_stuffed
    octets = _stuffing_table(8)
    for octet in frame.data:
        entry = octets[state][octet]
        state = entry & 7
        stuffed += entry >> 3
    last = frame.data[-1] & 1 if frame.data else data_length_code(frame) & 1
    if state >> 2 != last:
        stuffed -= 1  # the level changed after the last bit: a stuff bit whose place the first fixed one takes
    nominal = header.bits - 5 + header.nominal_stuffed + TAIL - 1
    data = 5 + 8 * len(frame.data) + stuffed + (4 + 17 + 6 if len(frame.data) <= 16 else 4 + 21 + 7) + 1
    return FrameBits(nominal, data)


_HeaderKey = tuple[int, bool, bool, bool, bool, bool, int]
"""Identifier, extended, remote, fd, brs, esi, data length code."""


class _Header(NamedTuple):
    bits: int
    """SOF to DLC, without stuff bits."""
    nominal_stuffed: int
    """Stuff bits up to BRS; in a classic frame, all of them."""
    data_stuffed: int
    """Stuff bits of ESI and DLC."""
    state: int
    crc: int


@lru_cache(maxsize=4096)
def _header(key: _HeaderKey) -> _Header:
    can_id, extended, remote, fd, brs, esi, dlc = key
    data = b"" if remote else bytes(FD_LENGTHS[dlc])
    frame = Frame(can_id, data, extended, fd, brs, remote, esi=esi, remote_length=dlc if remote else 0)
    writer = _Writer(frame)
    fields = _header_fields(frame)
    nominal_stuffed = 0
    for level, name in fields:
        if name == "ESI":
            nominal_stuffed = len(writer.bits) - (len(fields) - 5)
        writer.put(level, name)
    stuffed = len(writer.bits) - len(fields)
    if not fd:
        nominal_stuffed = stuffed
    levels = [bit.level for bit in writer.bits]
    run = next((i for i, level in enumerate(reversed(levels)) if level != levels[-1]), len(levels))
    return _Header(len(fields), nominal_stuffed, stuffed - nominal_stuffed, levels[-1] * 4 + run - 1, writer.crc)


@cache
def _stuffing_table(width: int) -> tuple[bytes, ...]:
    """By state and value of `width` bits: stuff bits inserted * 8 + state afterwards."""
    return tuple(bytes(_stuff(state, value, width) for value in range(1 << width)) for state in range(8))


def _stuff(state: int, value: int, width: int) -> int:
    last, run = state >> 2, (state & 3) + 1
    stuffed = 0
    for place in reversed(range(width)):
        level = value >> place & 1
        run = run + 1 if level == last else 1
        last = level
        if run == 5:
            last, run = 1 - level, 1
            stuffed += 1
    return stuffed << 3 | last << 2 | run - 1


@cache
def _crc15_table() -> array[int]:
    table = array("H")
    for octet in range(256):
        crc = 0
        for place in reversed(range(8)):
            crc = _crc_step(crc, octet >> place & 1, 15, CRC15_POLYNOMIAL)
        table.append(crc)
    return table
