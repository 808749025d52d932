"""MPU-6050: acceleration and rate of turn (InvenSense PS-MPU-6000A-00 and register map RM-MPU-6000A-00)."""

from __future__ import annotations

import struct

from msbot.hardware.driver import Values
from msbot.hardware.drivers.i2c_driver import I2cDriver
from msbot.hardware.faults import HardwareFault

FILTER, GYRO_RANGE, ACCELERATION_RANGE, MEASURED, POWER, IDENTITY = 0x1A, 0x1B, 0x1C, 0x3B, 0x6B, 0x75
IDENTITIES = (0x68, 0x70, 0x71, 0x72, 0x98)
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
        self.chip.expect(IDENTITY, IDENTITIES)
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
