"""The drivers of boards with MicroPython, by the name in `[driver.board]`; the code is `micropython/msbot/driver_*.py`.

A driver is general: it measures or drives *sources* of the part's model (`msbot.config.library.simulator`), which the
part type names in the same order.
"""

from __future__ import annotations

from msbot_xrce.lazy import dataclass

I2C_WIRES = ("scl", "sda")
"""The wires of every chip on I2C; several chips may share them."""
ADDRESS = "address"
"""What a wiring says, besides, of a chip on I2C."""


@dataclass(frozen=True, slots=True)
class BoardDriver:
    """One driver."""

    words: str
    """What it does on the board, in a few words."""
    sources: tuple[str, ...]
    """What its sources are; those that it measures come first."""
    measured: int
    """How many it measures; the others it drives, or needs to know."""
    module: str
    """Its file on the board."""

    @property
    def on_i2c(self) -> bool:
        """Whether its wires are those of I2C."""
        return self.module == "driver_i2c"


BOARD_DRIVERS = {
    "pwm": BoardDriver("PWM", ("percent",), 0, "driver_out"),
    "relay": BoardDriver("pin", ("on",), 0, "driver_out"),
    "shutter": BoardDriver("pin", ("count", "on"), 1, "driver_out"),
    "colour": BoardDriver("3 x PWM", ("red", "green", "blue"), 0, "driver_out"),
    "tone": BoardDriver("PWM", ("hertz", "loudness in percent"), 0, "driver_out"),
    "servo": BoardDriver("PWM", ("degrees",), 0, "driver_out"),
    "gripper": BoardDriver("PWM", ("opening", "width"), 0, "driver_out"),
    "motors": BoardDriver("PWM and pins", ("left in percent", "right in percent"), 0, "driver_out"),
    "strip": BoardDriver("neopixel", ("lamps on", "red", "green", "blue"), 0, "driver_out"),
    "switch": BoardDriver("pin", ("on",), 1, "driver_in"),
    "ultrasonic": BoardDriver("length of a pulse", ("metres",), 1, "driver_in"),
    "wheel": BoardDriver("interrupts", ("pulses", "turns a minute", "pulses of a turn", "inverted"), 2, "driver_in"),
    "knob": BoardDriver("interrupts", ("clicks", "pressed"), 2, "driver_in"),
    "keypad": BoardDriver("8 pins", ("key",), 1, "driver_in"),
    "onewire": BoardDriver("1-Wire", ("celsius",), 1, "driver_in"),
    "dht22": BoardDriver("lengths of pulses", ("celsius", "percent"), 2, "driver_in"),
    "analog": BoardDriver("ADC", ("percent",), 1, "driver_adc"),
    "stick": BoardDriver("2 x ADC", ("right in percent", "ahead in percent", "pressed"), 3, "driver_adc"),
    "gas": BoardDriver("ADC", ("ppm",), 1, "driver_adc"),
    "line": BoardDriver("8 x ADC", ("line seen", "place"), 2, "driver_adc"),
    "bmp280": BoardDriver("I2C", ("celsius", "hectopascal"), 2, "driver_i2c"),
    "bh1750": BoardDriver("I2C", ("lux",), 1, "driver_i2c"),
    "ina219": BoardDriver("I2C", ("volts", "amperes"), 2, "driver_i2c"),
    "mpu6050": BoardDriver("I2C", ("ahead", "left", "up", "roll", "pitch", "turn"), 6, "driver_i2c"),
    "tcs34725": BoardDriver("I2C", ("lux", "red", "green", "blue"), 4, "driver_i2c"),
}
