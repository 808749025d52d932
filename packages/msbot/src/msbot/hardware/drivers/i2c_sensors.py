"""What drivers of chips on I2C have in common."""

from __future__ import annotations

import struct
from typing import NamedTuple

from msbot.hardware.driver import Driver, Mount, Values
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.i2c import Chip, SmBus, signed


class I2cDriver(Driver):
    """Opens the bus; `self.chip` talks to the chip."""

    chip: Chip

    def __init__(self, place: Mount) -> None:
        super().__init__(place)
        self._bus: SmBus | None = None

    def open(self) -> None:
        """Open the bus; sends nothing to the chip yet."""
        assert self.wiring.i2c is not None
        number, address = self.wiring.i2c
        self._bus = self.machine.open_i2c(number)
        self.chip = Chip(self._bus, number, address, self.place.part_type.number)

    def close(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None


# BMP280: air pressure and temperature (Bosch BST-BMP280-DS001-19).


BMP280_IDENTITY, CONTROL, CONFIG, CALIBRATION, PRESSURE = 0xD0, 0xF4, 0xF5, 0x88, 0xF7
"""Table 18, memory map."""
BMP280_IDENTITIES = (0x56, 0x57, 0x58, 0x60)
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
        self.chip.expect(BMP280_IDENTITY, BMP280_IDENTITIES)
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


# INA219: voltage and current of a battery (Texas Instruments SBOS448G).


CONFIGURATION, SHUNT, BUS = 0x00, 0x01, 0x02
RESET_STATE = 0x399F
"""32 V, +-320 mV, 12 bits, continuous: the chip's default after reset (8.6.2.1)."""
SHUNT_STEP_V = 10e-6
BUS_STEP_V = 4e-3


class Ina219(I2cDriver):
    """Option: `shunt_ohm`, the resistor on the board. The current is the shunt's voltage divided by it, as in section
    8.5.1; so nothing has to be written into the chip that it could forget."""

    samples = True

    def open(self) -> None:
        """Start measuring."""
        super().open()
        self.chip.write_word(CONFIGURATION, RESET_STATE)

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Voltage in V and current in A."""
        shunt = signed(self.chip.word(SHUNT))
        bus = self.chip.word(BUS)
        if self.wiring.number("shunt_ohm") <= 0:
            raise HardwareFault("option shunt_ohm of the INA219 must be more than 0")
        return {
            "voltage": (bus >> 3) * BUS_STEP_V,
            "current": shunt * SHUNT_STEP_V / self.wiring.number("shunt_ohm"),
        }


# MPU-6050: acceleration and rate of turn (InvenSense PS-MPU-6000A-00 and register map RM-MPU-6000A-00).


FILTER, GYRO_RANGE, ACCELERATION_RANGE, MEASURED, POWER, MPU6050_IDENTITY = 0x1A, 0x1B, 0x1C, 0x3B, 0x6B, 0x75
MPU6050_IDENTITIES = (0x68, 0x70, 0x71, 0x72, 0x98)
"""The chip itself, its successors 6500, 9250 and 9255, and copies: they have the same registers."""
AWAKE = 0x01
"""Not asleep, clock of the X gyroscope (4.28)."""
SLOW_FILTER = 0x03
"""44 Hz."""
COUNTS_PER_G = 16384.0
"""At +-2 g (4.17)."""
COUNTS_PER_DEGREE = 131.0
"""At +-250 degrees a second (4.19)."""
GRAVITY = 9.80665


class Mpu6050(I2cDriver):
    """A motion sensor."""

    samples = True

    def open(self) -> None:
        """Wake it up."""
        super().open()
        self.chip.expect(MPU6050_IDENTITY, MPU6050_IDENTITIES)
        self.chip.write(POWER, AWAKE)
        self.chip.write(FILTER, SLOW_FILTER)
        self.chip.write(GYRO_RANGE, 0)
        self.chip.write(ACCELERATION_RANGE, 0)
        self.machine.wait(0.05)

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Acceleration in m/s2 and rate of turn in degrees a second."""
        counts = struct.unpack(">7h", self.chip.block(MEASURED, 14))
        if not any(counts):
            raise HardwareFault("the MPU-6050 sleeps: it had no power in between")
        ahead, left, up = (count / COUNTS_PER_G * GRAVITY for count in counts[:3])
        roll, pitch, turn = (count / COUNTS_PER_DEGREE for count in counts[4:])
        return {"ahead": ahead, "left": left, "up": up, "drift_x": roll, "drift_y": pitch, "turn": turn}
