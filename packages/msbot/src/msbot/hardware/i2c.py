"""I2C with the library smbus2, and what its errors mean at the bench."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from typing import Protocol

from msbot.hardware.hardware_fault import HardwareFault, missing_library

_ABSENT = (errno.ENXIO, errno.ENODEV, errno.EREMOTEIO, errno.EIO)
"""The errors of adapters when no chip acknowledges an address (kernel: Documentation/i2c/fault-codes.rst)."""
_STUCK = (errno.ETIMEDOUT, errno.EAGAIN, errno.EBUSY)


class SmBus(Protocol):
    """The part of `smbus2.SMBus` that is used here."""

    def write_quick(self, i2c_addr: int) -> None:
        """Send only the address."""

    def read_byte(self, i2c_addr: int) -> int:
        """One octet."""

    def write_byte(self, i2c_addr: int, value: int) -> None:
        """One octet."""

    def read_byte_data(self, i2c_addr: int, register: int) -> int:
        """One octet of a register."""

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        """One octet into a register."""

    def read_word_data(self, i2c_addr: int, register: int) -> int:
        """Two octets of a register, the lower one first."""

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        """Octets from a register on."""

    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None:
        """Two octets into a register, the lower one first."""

    def close(self) -> None:
        """Release the bus."""


def open_smbus(bus: int) -> SmBus:
    """Open /dev/i2c-BUS.

    Raises:
        HardwareFault: the library is missing, there is no such bus, or this user may not use it.
    """
    try:
        from smbus2 import SMBus
    except ImportError:
        raise missing_library("parts on I2C", "smbus2") from None
    try:
        opened: SmBus = SMBus(bus)
    except FileNotFoundError:
        raise HardwareFault(
            f"there is no I2C bus {bus} (/dev/i2c-{bus}): switch I2C on with `sudo raspi-config nonint do_i2c 0`; "
            "`i2cdetect -l` lists the buses"
        ) from None
    except PermissionError:
        raise HardwareFault(
            f"no permission for /dev/i2c-{bus}: `sudo usermod -aG i2c $USER`, then log in again"
        ) from None
    except OSError as error:
        raise HardwareFault(f"I2C bus {bus} cannot be opened: {error.strerror}") from None
    return opened


class Chip:
    """One chip on a bus; every method raises HardwareFault when the chip does not answer."""

    def __init__(self, bus: SmBus, number: int, address: int, name: str) -> None:
        """Take an open bus.

        Args:
            bus: the open bus.
            number: its number, for messages.
            address: the chip's address.
            name: what the chip is, for messages.
        """
        self._bus = bus
        self._number = number
        self._address = address
        self._name = name

    def read(self, register: int) -> int:
        """One octet of a register."""
        try:
            return self._bus.read_byte_data(self._address, register)
        except OSError as error:
            raise self.fault(error) from None

    def write(self, register: int, value: int) -> None:
        """One octet into a register."""
        try:
            self._bus.write_byte_data(self._address, register, value)
        except OSError as error:
            raise self.fault(error) from None

    def command(self, value: int) -> None:
        """One octet for a chip without registers."""
        try:
            self._bus.write_byte(self._address, value)
        except OSError as error:
            raise self.fault(error) from None

    def block(self, register: int, length: int) -> bytes:
        """Octets from a register on, at most 32."""
        try:
            return bytes(self._bus.read_i2c_block_data(self._address, register, length))
        except OSError as error:
            raise self.fault(error) from None

    def write_word(self, register: int, value: int) -> None:
        """Two octets into a register, the higher one first."""
        try:
            self._bus.write_word_data(self._address, register, (value & 0xFF) << 8 | value >> 8)
        except OSError as error:
            raise self.fault(error) from None

    def word(self, register: int) -> int:
        """Two octets of a register, the higher one first, as in most chips."""
        try:
            word = self._bus.read_word_data(self._address, register)
        except OSError as error:
            raise self.fault(error) from None
        return (word & 0xFF) << 8 | word >> 8

    def expect(self, register: int, identities: Iterable[int]) -> int:
        """Read the register with the chip's identity.

        Raises:
            HardwareFault: another chip answers.
        """
        known = list(identities)
        found = self.read(register)
        if found not in known:
            wanted = " or ".join(f"0x{one:02x}" for one in known)
            raise HardwareFault(
                f"the chip at 0x{self._address:02x} on I2C bus {self._number} is no {self._name}: it calls itself "
                f"0x{found:02x}, not {wanted}; `msbot hardware scan` shows what is there"
            )
        return found

    def fault(self, error: OSError) -> HardwareFault:
        """What an error means, and what to check."""
        where = f"0x{self._address:02x} on I2C bus {self._number}"
        look = f"`i2cdetect -y {self._number}` shows who answers"
        if error.errno == errno.EBUSY:
            words = f"the kernel's own driver has the {self._name} at {where}: remove its dtoverlay, or use --device"
        elif error.errno in _ABSENT:
            words = (
                f"no {self._name} answers at {where}: check its supply, the wires SDA and SCL, and its address; {look}"
            )
        elif error.errno in _STUCK:
            words = (
                f"I2C bus {self._number} is stuck while the {self._name} at 0x{self._address:02x} is asked: something "
                f"holds SDA or SCL low, or the pull-up resistors are missing; {look}"
            )
        else:
            words = f"the {self._name} at {where} fails ({error.strerror or error}); {look}"
        return HardwareFault(words)


def signed(value: int, bits: int = 16) -> int:
    """A number in two's complement."""
    return value - (1 << bits) if value >> (bits - 1) else value
