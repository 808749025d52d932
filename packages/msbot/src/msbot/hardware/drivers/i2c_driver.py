"""What drivers of chips on I2C have in common."""

from __future__ import annotations

from msbot.hardware.driver import Driver, Mount
from msbot.hardware.i2c import Chip, SmBus


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
