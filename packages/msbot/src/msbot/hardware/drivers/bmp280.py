"""BMP280: air pressure and temperature (Bosch BST-BMP280-DS001-19)."""

from __future__ import annotations

import struct
from typing import NamedTuple

from msbot.hardware.driver import Values
from msbot.hardware.drivers.i2c_driver import I2cDriver
from msbot.hardware.faults import HardwareFault

IDENTITY, CONTROL, CONFIG, CALIBRATION, PRESSURE = 0xD0, 0xF4, 0xF5, 0x88, 0xF7
"""Table 18, memory map."""
IDENTITIES = (0x56, 0x57, 0x58, 0x60)
"""Engineering samples, the chip itself, and the BME280, which measures both in the same way."""
NORMAL = 0b010_101_11
"""Temperature oversampled twice, pressure 16 times, normal (continuous) mode (tables 21 to 23)."""
STANDBY = 0b000_000_00
"""0.5 ms between two measurements, no filter."""
FIRST_S = 0.05
"""Longest time of a measurement with these settings (table 13: 43.2 ms)."""
NOT_MEASURED = 0x80000
"""The content of the registers before the first measurement (table 18: reset state)."""


class Calibration(NamedTuple):
    """The calibration values that Bosch measured for this chip (table 17)."""

    t1: int
    t2: int
    t3: int
    p1: int
    p2: int
    p3: int
    p4: int
    p5: int
    p6: int
    p7: int
    p8: int
    p9: int


class Bmp280(I2cDriver):
    """A barometer with a thermometer."""

    samples = True

    def open(self) -> None:
        """Read the calibration, and start measuring."""
        super().open()
        self.chip.expect(IDENTITY, IDENTITIES)
        self._calibration = Calibration(*struct.unpack("<HhhHhhhhhhhh", self.chip.block(CALIBRATION, 24)))
        if self._calibration.t1 == 0 or self._calibration.p1 == 0:
            raise HardwareFault("the BMP280 tells no calibration: it is broken, or SDA is disturbed")
        self.chip.write(CONFIG, STANDBY)
        self.chip.write(CONTROL, NORMAL)
        self.machine.wait(FIRST_S)

    def sample(self, values: Values) -> Values | None:  # noqa: ARG002 - as its base
        """Pressure in hPa and temperature in degrees; None until the first measurement is done."""
        octets = self.chip.block(PRESSURE, 6)
        pressure, temperature = (int.from_bytes(octets[at : at + 3]) >> 4 for at in (0, 3))
        if temperature == NOT_MEASURED:
            # A chip that lost power in between has forgotten its settings.
            raise HardwareFault("the BMP280 does not measure any more: it had no power in between")
        celsius, pascal = compensate(self._calibration, temperature, pressure)
        return {"air": celsius, "weather": pascal / 100}


def compensate(c: Calibration, temperature: int, pressure: int) -> tuple[float, float]:
    """Degrees and Pa from the raw register values (section 8.1, "Compensation formula in floating point")."""
    x = (temperature / 16384 - c.t1 / 1024) * c.t2
    y = (temperature / 131072 - c.t1 / 8192) ** 2 * c.t3
    fine = x + y
    celsius = fine / 5120
    x = fine / 2 - 64000
    y = x * x * c.p6 / 32768
    y = y + x * c.p5 * 2
    y = y / 4 + c.p4 * 65536
    x = (c.p3 * x * x / 524288 + c.p2 * x) / 524288
    x = (1 + x / 32768) * c.p1
    if x == 0:
        return celsius, 0.0
    pascal = (1048576 - pressure - y / 4096) * 6250 / x
    x = c.p9 * pascal * pascal / 2147483648
    y = pascal * c.p8 / 32768
    return celsius, pascal + (x + y + c.p7) / 16
