"""BH1750 and TCS34725: brightness and colour over I2C, from their data sheets."""

from __future__ import annotations

from msbot.hardware.driver import Values
from msbot.hardware.drivers.i2c_sensors import I2cDriver

# BH1750FVI, ROHM Technical Note 11046EDT01.
POWER_ON = 0x01
CONTINUOUS_HIGH = 0x10
"""1 lx resolution, 120 ms."""
COUNTS_PER_LUX = 1.2
"""Data sheet, "Illuminance measurement data"."""
FIRST_S = 0.18
"""Longest time of a measurement at high resolution."""


class Bh1750(I2cDriver):
    """A light sensor without registers: send a command, read two octets."""

    samples = True

    def open(self) -> None:
        """Start measuring, and wait for the first measurement."""
        super().open()
        self.chip.command(POWER_ON)
        self.chip.command(CONTINUOUS_HIGH)
        self.machine.wait(FIRST_S)

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Brightness in lx."""
        # Read like a register: this repeats the command, which does not disturb the running measurement.
        return {"brightness": bh1750_lux(self.chip.word(CONTINUOUS_HIGH))}


def bh1750_lux(counts: int) -> float:
    """Counts of the BH1750 converted to lx."""
    return counts / COUNTS_PER_LUX


# TCS34725, ams data sheet v1-06.
COMMAND = 0x80 | 0x20
"""Register addresses have bit 7 set; with bit 5, the registers that follow are read in one go."""
ENABLE, ATIME, CONTROL, IDENTITY, STATUS, CLEAR = 0x00, 0x01, 0x0F, 0x12, 0x13, 0x14
POWERED, MEASURING = 0x01, 0x03
VALID = 0x01
STEP_MS = 2.4
"""One step of the integration time."""
INTEGRATION_STEPS = 21
"""50.4 ms: shorter than the shortest period of the part, and several periods of a lamp's flicker."""
GAINS = {1: 0, 4: 1, 16: 2, 60: 3}
DEVICE_FACTOR = 310.0
"""ams DN40, for the bare sensor: lux of one count at gain 1 and 1 ms."""
RED, GREEN, BLUE = 0.136, 1.0, -0.444
"""ams DN40: shares of the colours in the brightness, after the infrared is taken off."""


class Tcs34725(I2cDriver):
    """A colour sensor. Option: `gain` (1, 4, 16 or 60)."""

    samples = True

    def open(self) -> None:
        """Start measuring."""
        super().open()
        self.chip.expect(COMMAND | IDENTITY, (0x44, 0x4D))
        self._gain = int(self.wiring.number("gain"))
        self.chip.write(COMMAND | ATIME, 256 - INTEGRATION_STEPS)
        self.chip.write(COMMAND | CONTROL, GAINS.get(self._gain, 0))
        self.chip.write(COMMAND | ENABLE, POWERED)
        self.machine.wait(0.003)
        self.chip.write(COMMAND | ENABLE, MEASURING)
        self.machine.wait(STEP_MS * (INTEGRATION_STEPS + 1) / 1000)

    def sample(self, values: Values) -> Values | None:  # noqa: ARG002 - as its base
        """Colour and brightness; None until the first measurement is done."""
        if not self.chip.read(COMMAND | STATUS) & VALID:
            return None
        octets = self.chip.block(COMMAND | CLEAR, 8)
        clear, red, green, blue = (int.from_bytes(octets[at : at + 2], "little") for at in range(0, 8, 2))
        return {
            "brightness": tcs34725_lux(clear, red, green, blue, gain=self._gain),
            **{name: colour_octet(count, clear) for name, count in (("red", red), ("green", green), ("blue", blue))},
        }


def colour_octet(count: int, clear: int) -> int:
    """A colour as a share of all light, 0 to 255."""
    return min(255, round(255 * count / clear)) if clear else 0


def tcs34725_lux(clear: int, red: int, green: int, blue: int, *, gain: int) -> float:
    """Brightness from the four counts (ams DN40, "Lux calculation")."""
    infrared = max(0.0, (red + green + blue - clear) / 2)
    seen = RED * (red - infrared) + GREEN * (green - infrared) + BLUE * (blue - infrared)
    return max(0.0, seen * DEVICE_FACTOR / (STEP_MS * INTEGRATION_STEPS * gain))
