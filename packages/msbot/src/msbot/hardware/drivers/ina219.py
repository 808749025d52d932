"""INA219: voltage and current of a battery (Texas Instruments SBOS448G)."""

from __future__ import annotations

from msbot.hardware.driver import Values
from msbot.hardware.drivers.i2c_driver import I2cDriver
from msbot.hardware.faults import HardwareFault
from msbot.hardware.i2c import signed

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
