"""Chips at the boundary of smbus2: registers that a test fills, chips that vanish, a bus that is stuck."""

from __future__ import annotations

import errno
from dataclasses import dataclass, field


@dataclass
class Chip:
    """Registers of one chip, 16 bits wide as in the kernel's `i2c-stub`, which behaves the same."""

    registers: dict[int, int] = field(default_factory=dict)
    written: list[tuple[int, int]] = field(default_factory=list)
    """Octets written, each with its register; -1 for a plain octet."""

    def fill(self, register: int, octets: bytes) -> None:
        """Registers from that one on."""
        for offset, octet in enumerate(octets):
            self.registers[register + offset] = octet

    def fill_word(self, register: int, value: int) -> None:
        """A register of two octets, of which the chip sends the higher one first."""
        self.registers[register] = (value & 0xFF) << 8 | value >> 8


class Bus:
    """What a driver sees of `smbus2.SMBus`."""

    def __init__(self, **chips: Chip) -> None:
        self.chips = {int(name.removeprefix("at_"), 16): chip for name, chip in chips.items()}
        self.stuck = False
        self.is_open = True

    def chip(self, address: int) -> Chip:
        """The chip that answers."""
        if self.stuck:
            raise TimeoutError(errno.ETIMEDOUT, "Connection timed out")
        if address not in self.chips:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        return self.chips[address]

    def write_quick(self, i2c_addr: int) -> None:
        self.chip(i2c_addr)

    def read_byte(self, i2c_addr: int) -> int:
        return self.chip(i2c_addr).registers.get(0, 0) & 0xFF

    def write_byte(self, i2c_addr: int, value: int) -> None:
        self.chip(i2c_addr).written.append((-1, value))

    def read_byte_data(self, i2c_addr: int, register: int) -> int:
        return self.chip(i2c_addr).registers.get(register, 0)

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        chip = self.chip(i2c_addr)
        chip.written.append((register, value))
        chip.registers[register] = value

    def read_word_data(self, i2c_addr: int, register: int) -> int:
        return self.chip(i2c_addr).registers.get(register, 0)

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        registers = self.chip(i2c_addr).registers
        return [registers.get(register + offset, 0) for offset in range(length)]

    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None:
        self.chip(i2c_addr).registers[register] = value

    def close(self) -> None:
        self.is_open = False


def bmp280() -> Chip:
    """The worked example of the data sheet: 25.08 degrees, 100653.27 Pa (BST-BMP280-DS001-19, section 3.12)."""
    chip = Chip({0xD0: 0x58})
    words = (27504, 26435, -1000, 36477, -10685, 3024, 2855, 140, -7, 15500, -14600, 6000)
    chip.fill(0x88, b"".join((word & 0xFFFF).to_bytes(2, "little") for word in words))
    chip.fill(0xF7, (415148 << 4).to_bytes(3) + (519888 << 4).to_bytes(3))
    return chip


def bh1750() -> Chip:
    """28067 lx: 10000011 10010000 (ROHM 11046EDT01, "Illuminance measurement data")."""
    chip = Chip()
    chip.fill_word(0x10, 0b10000011_10010000)
    return chip


def ina219() -> Chip:
    """10 A through 2 milliohms at 11.98 V (SBOS448G, section 8.5.2, table 8): 07D0h and 5D98h."""
    chip = Chip()
    chip.fill_word(0x01, 0x07D0)
    chip.fill_word(0x02, 0x5D98)
    return chip


def mpu6050() -> Chip:
    """1 g upwards and one degree a second: 16384 and 131 counts (RM-MPU-6000A-00, sections 4.17 and 4.19)."""
    chip = Chip({0x75: 0x68})
    counts = (0, 0, 16384, 0, 0, 0, 131)
    chip.fill(0x3B, b"".join((count & 0xFFFF).to_bytes(2) for count in counts))
    return chip


def tcs34725() -> Chip:
    """White light of 1000 counts, a third of it each colour, and no infrared."""
    chip = Chip({0xA0 | 0x12: 0x44, 0xA0 | 0x13: 0x01})
    chip.fill(0xA0 | 0x14, b"".join(count.to_bytes(2, "little") for count in (999, 333, 333, 333)))
    return chip
