"""A CAN receiver that reads levels off the wire one by one and checks every rule (ISO 11898-1:2015 10.4, 10.5).

It shares nothing with `msbot_agent.link.can.protocol.bits`: that one writes frames, this one reads them, with shift
registers as a controller has them. Where both agree on every frame, both know the same standard.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from msbot_agent.link.can.protocol.frames import Frame

FD_SIZES = {**{code: code for code in range(9)}, 9: 12, 10: 16, 11: 20, 12: 24, 13: 32, 14: 48, 15: 64}
STUFF_COUNTS = {0b0000: 0, 0b0011: 1, 0b0110: 2, 0b0101: 3, 0b1100: 4, 0b1111: 5, 0b1010: 6, 0b1001: 7}
"""Stuff count field with its parity bit, as ISO 11898-1:2015 table 8 lists it."""


class ShiftRegister:
    """One CRC, bit by bit."""

    def __init__(self, width: int, taps: int, start: int) -> None:
        self.width, self.taps, self.value = width, taps, start

    def shift(self, level: int) -> None:
        highest = self.value >> (self.width - 1) & 1
        self.value = self.value * 2 % (1 << self.width)
        if highest != level:
            self.value ^= self.taps


@dataclass
class Received:
    """What was read."""

    frame: Frame
    nominal_bits: int
    data_bits: int
    """From ESI to the CRC delimiter, with or without a bit-rate switch."""
    stuff_bits: int
    """Dynamic and fixed."""


class Receiver:
    """Reads one frame and the intermission behind it; an AssertionError tells which rule is broken."""

    def __init__(self, levels: Sequence[int]) -> None:
        self._wire: Iterator[int] = iter(levels)
        self._read = 0
        self._equal = 0
        self._previous: int | None = None
        self._destuffing = True
        self._dynamic = 0
        self._fixed = 0
        self._crc15 = ShiftRegister(15, 0x4599, 0)
        self._crc17 = ShiftRegister(17, 0x1685B, 1 << 16)
        self._crc21 = ShiftRegister(21, 0x102899, 1 << 20)

    def receive(self) -> Received:
        assert self._bit() == 0, "SOF is dominant"
        can_id, remote, extended = self._number(11), self._bit(), self._bit()
        if extended:
            assert remote == 1, "SRR is recessive"
            can_id = can_id << 18 | self._number(18)
            remote = self._bit()
        fd = self._bit()
        if fd:
            assert remote == 0, "RRS is dominant"
            return self._receive_fd(can_id, extended=bool(extended))
        if extended:
            assert self._bit() == 0, "r0 is dominant"
        return self._receive_classic(can_id, extended=bool(extended), remote=bool(remote))

    def _receive_classic(self, can_id: int, *, extended: bool, remote: bool) -> Received:
        code = self._number(4)
        size = min(code, 8)  # classic frames have 8 bytes with the codes 9 to 15, too
        data = b"" if remote else bytes(self._number(8) for _ in range(size))
        expected = self._crc15.value
        assert self._number(15) == expected, "CRC-15"
        if self._equal == 5:
            self._take_stuff_bit()  # a stuff bit may follow the last bit of the CRC
        self._destuffing = False
        self._tail()
        asked, long_dlc = size if remote else 0, code if code > 8 else 0
        frame = Frame(can_id, data, extended, remote=remote, remote_length=asked, long_dlc=long_dlc)
        return Received(frame, self._read, 0, self._dynamic)

    def _receive_fd(self, can_id: int, *, extended: bool) -> Received:
        assert self._bit() == 0, "res is dominant"
        brs = self._bit()
        before = self._read
        esi = self._bit()
        data = bytes(self._number(8) for _ in range(FD_SIZES[self._number(4)]))
        # Dynamic stuffing ends with the data field. Five equal bits at its very end are followed by the first fixed
        # stuff bit, not by one of each kind.
        self._destuffing = False
        register = self._crc17 if len(data) <= 16 else self._crc21
        count = 0
        self._take_fixed_stuff_bit()
        for _ in range(4):
            level = self._level()
            register.shift(level)
            count = count << 1 | level
        assert STUFF_COUNTS[count] == self._dynamic % 8, "stuff count"
        expected, crc = register.value, 0
        for place in range(register.width):
            if place % 4 == 0:
                self._take_fixed_stuff_bit()
            crc = crc << 1 | self._level()
        assert crc == expected, f"CRC-{register.width}"
        data_bits = self._read - before + 1  # the CRC delimiter
        self._tail()
        frame = Frame(can_id, data, extended, True, bool(brs), esi=bool(esi))
        return Received(frame, self._read - data_bits, data_bits, self._dynamic + self._fixed)

    def _tail(self) -> None:
        levels = [self._level() for _ in range(13)]
        assert levels[0] == 1, "CRC delimiter"
        assert levels[2:] == [1] * 11, "ACK delimiter, end of frame, intermission"
        assert next(self._wire, None) is None, "nothing follows"

    def _number(self, width: int) -> int:
        value = 0
        for _ in range(width):
            value = value << 1 | self._bit()
        return value

    def _bit(self) -> int:
        """The next bit of the frame; a stuff bit before it is taken out."""
        if self._equal == 5:
            self._take_stuff_bit()
        level = self._level()
        self._crc15.shift(level)
        self._crc17.shift(level)
        self._crc21.shift(level)
        return level

    def _take_stuff_bit(self) -> None:
        before = self._previous
        level = self._level()
        assert level != before, "stuff error"
        self._crc17.shift(level)
        self._crc21.shift(level)
        self._dynamic += 1

    def _take_fixed_stuff_bit(self) -> None:
        before = self._previous
        assert self._level() != before, "fixed stuff bit"
        self._fixed += 1

    def _level(self) -> int:
        level = next(self._wire)
        self._read += 1
        self._equal = self._equal + 1 if level == self._previous else 1
        self._previous = level
        return level
