"""HX711: the 24-bit converter of a load cell, clocked by the computer."""

from __future__ import annotations

from msbot.hardware.driver import Values
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.i2c import signed
from msbot.hardware.pins import PinDriver

READY_S = 0.5
"""Its slower rate is 10 measurements a second (data sheet, table 3); the first takes 0.4 s after power-up."""
LONGEST_HIGH_S = 60e-6
"""Holding PD_SCK high for longer switches the chip off (data sheet, "Power down control")."""
ATTEMPTS = 3
PULSES = 25
"""24 bits, and one more, which selects input A with gain 128 for the next time (data sheet, table 3)."""


class Hx711(PinDriver):
    """Options: `counts_per_gram`, and `zero`, the counts of the empty cell.

    Linux may preempt the program in the middle of a clock pulse; such a measurement is discarded.
    """

    samples = True
    blocking = True

    def open(self) -> None:
        """Take the pins, and switch the chip on: clock low."""
        self._clock = self.device("DigitalOutputDevice", self.wiring.pins["sck"])
        self._data = self.device("DigitalInputDevice", self.wiring.pins["dt"], pull_up=None, active_state=True)

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """The load in grams, before tare and calibration from the robot's settings.

        Raises:
            HardwareFault: it is not ready in time, or the computer is too busy to clock it.
        """
        for _ in range(ATTEMPTS):
            counts = self._read()
            if counts is not None:
                return {"load": (counts - self.wiring.number("zero")) / self.wiring.number("counts_per_gram")}
        raise HardwareFault("the computer is too busy to read the HX711: its clock pulses became too long")

    def _read(self) -> int | None:
        clock = self.machine.clock
        until = clock() + READY_S
        while self._data.value:
            if clock() > until:
                pins = self.wiring.pins
                raise HardwareFault(
                    f"the HX711 at GPIO {pins['sck']} (SCK) and GPIO {pins['dt']} (DT) is not ready: check its supply "
                    "and both wires"
                )
            self.machine.wait(0.001)
        counts = 0
        for _ in range(PULSES):
            began = clock()
            self._clock.on()
            counts = counts << 1 | int(self._data.value)
            self._clock.off()
            if clock() - began > LONGEST_HIGH_S:
                return None
        return signed(counts >> 1, 24)
