"""LCD1602 with the I2C backpack: an HD44780U behind a PCF8574 (Hitachi ADE-207-272(Z), NXP PCF8574 rev. 5)."""

from __future__ import annotations

from msbot.hardware.driver import Values
from msbot.hardware.drivers.i2c_sensors import I2cDriver

RS, ENABLE, LIGHT = 0x01, 0x04, 0x08
"""Bits of the PCF8574; its upper four are D4 to D7. RW is always low: nothing is read."""
ROWS, COLUMNS = 2, 16
ROW_AT = (0x00, 0x40)
"""Addresses of the rows in DDRAM (figure 5)."""
CLEAR, ENTRY_MODE, DISPLAY_ON, FOUR_BITS_TWO_LINES, SET_ADDRESS = 0x01, 0x06, 0x0C, 0x28, 0x80
CLEAR_S = 0.002
"""Table 6: 1.52 ms."""


class Lcd1602(I2cDriver):
    """A display of two lines."""

    drives = True

    def open(self) -> None:
        """Initialise by instruction (figure 24), and clear it."""
        super().open()
        self._light = LIGHT
        for nibble, wait_s in ((0x30, 0.005), (0x30, 0.0002), (0x30, 0.0002), (0x20, 0.0002)):
            self._nibble(nibble)
            self.machine.wait(wait_s)
        for command in (FOUR_BITS_TWO_LINES, DISPLAY_ON, ENTRY_MODE, CLEAR):
            self._octet(command)
        self.machine.wait(CLEAR_S)
        self._shown = [" " * COLUMNS] * ROWS

    def outputs_for(self, values: Values) -> object:
        """Both rows, and whether the backlight is on."""
        rows = [*str(values["screen"]).split("\n"), "", ""][:ROWS]
        return tuple(row.ljust(COLUMNS)[:COLUMNS] for row in rows), bool(values["lit"])

    def drive(self, wanted: object) -> None:
        """Write the rows that have changed."""
        assert isinstance(wanted, tuple)
        rows, lit = wanted
        self._light = LIGHT if lit else 0
        self.chip.command(self._light)
        for number, row in enumerate(rows):
            if row == self._shown[number]:
                continue
            self._shown[number] = "?"  # in case it fails in the middle
            self._octet(SET_ADDRESS | ROW_AT[number])
            for letter in row:
                self._octet(character(letter), RS)
            self._shown[number] = row

    def _octet(self, value: int, flags: int = 0) -> None:
        self._nibble(value & 0xF0, flags)
        self._nibble(value << 4 & 0xF0, flags)

    def _nibble(self, upper: int, flags: int = 0) -> None:
        """Send four bits: the chip takes them when ENABLE falls; I2C is slower than all its minimum times but one."""
        octet = upper | flags | self._light
        self.chip.command(octet | ENABLE)
        self.chip.command(octet)


_OTHERS = {"°": 0xDF, "ä": 0xE1, "ö": 0xEF, "ü": 0xF5, "ß": 0xE2, "µ": 0xE4, "Ω": 0xF4, "÷": 0xFD, "→": 0x7E, "←": 0x7F}
"""Table 4, character ROM A00."""


def character(letter: str) -> int:
    """The code of a letter in the display's ROM A00; a question mark for a letter that it does not have."""
    code = ord(letter)
    if 0x20 <= code <= 0x7D and letter != "\\":
        return code
    return _OTHERS.get(letter, ord("?"))
