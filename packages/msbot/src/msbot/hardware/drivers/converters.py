"""Analog parts on a converter that has a kernel driver: files below /sys/bus/iio, in volts (kernel: sysfs-bus-iio).

A Raspberry Pi has no converter of its own. With an MCP3008: `dtoverlay=mcp3008`; with an ADS1115: `dtoverlay=ads1115`.
"""

from __future__ import annotations

import math
from typing import Any

from msbot.hardware.driver import Driver, Values
from msbot.hardware.drivers.switches import open_input
from msbot.hardware.machine import Machine, read_number
from msbot.hardware.pins import PinDriver
from msbot.hardware.wiring import PartWiring

REMEDY = (
    "is the converter's dtoverlay in /boot/firmware/config.txt (for example dtoverlay=mcp3008), and is it wired as "
    "that says? `msbot hardware scan` lists the converters"
)


def read_volts(machine: Machine, device: int, channel: int) -> float:
    """The voltage of a channel, in V.

    Raises:
        HardwareFault: there is no such converter or channel.
    """
    folder = machine.path(f"/sys/bus/iio/devices/iio:device{device}")
    what = f"channel {channel} of converter iio:device{device}"
    raw = read_number(folder / f"in_voltage{channel}_raw", what, REMEDY)
    own = folder / f"in_voltage{channel}_scale"
    scale_mv = read_number(own if own.exists() else folder / "in_voltage_scale", what, REMEDY)
    offset_file = folder / f"in_voltage{channel}_offset"
    offset = read_number(offset_file, what, REMEDY) if offset_file.exists() else 0.0
    return (raw + offset) * scale_mv / 1000


def share_of(wiring: PartWiring, machine: Machine, name: str) -> float:
    """The voltage of a wire as a share of the option `full_v`, 0 to 1."""
    return read_volts(machine, *wiring.channels[name]) / wiring.number("full_v")


class AnalogInput(Driver):
    """One channel, as percent of `full_v`."""

    samples = True
    poll_s = 0.02
    control = "knob"

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """The voltage, in percent of `full_v`."""
        return {self.control: 100 * share_of(self.wiring, self.machine, "out")}


class Loudness(AnalogInput):
    """KY-037: the analog output of a microphone. Options: `quiet_v`, `full_v`."""

    control = "loudness"

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """How loud it is."""
        quiet_v, full_v = self.wiring.number("quiet_v"), self.wiring.number("full_v")
        volts = read_volts(self.machine, *self.wiring.channels["out"])
        return {self.control: min(100.0, max(0.0, 100 * (volts - quiet_v) / ((full_v - quiet_v) or 1.0)))}


class SoilMoisture(Driver):
    """A moisture sensor. Options: `dry_v`, `wet_v`: its voltage in dry and in wet soil."""

    samples = True

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """How moist it is."""
        dry_v, wet_v = self.wiring.number("dry_v"), self.wiring.number("wet_v")
        volts = read_volts(self.machine, *self.wiring.channels["out"])
        return {"water": min(100.0, max(0.0, 100 * (dry_v - volts) / ((dry_v - wet_v) or 1.0)))}


H2_PPM = 1000.0
"""R0 is the resistance at 1000 ppm of hydrogen (MQ-2 data sheet, note to figure 2)."""
SLOPE = math.log(0.6) / math.log(3.0)
"""Concentration slope rate: from 1000 to 3000 ppm the resistance falls to 0.6 of its value (data sheet, table B)."""


class Mq2(Driver):
    """A gas sensor. Options: `supply_v`, `load_kohm`, `r0_kohm`.

    No two sensors are alike, and all burnable gases look the same to them: the figure is an estimate from the data
    sheet.
    """

    samples = True

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Gas in ppm."""
        volts = max(0.001, read_volts(self.machine, *self.wiring.channels["out"]))
        sensor_kohm = max(0.0, self.wiring.number("supply_v") - volts) * self.wiring.number("load_kohm") / volts
        return {"smoke": gas_ppm(sensor_kohm / self.wiring.number("r0_kohm"))}


def gas_ppm(ratio: float) -> float:
    """The concentration of gas when the sensor's resistance is `ratio` times its R0."""
    return min(10_000.0, H2_PPM * math.pow(max(1e-6, ratio), 1 / SLOPE))


class LineFollower(Driver):
    """QTR-8A: eight reflectance sensors in a row; a dark line reflects little. Options: `white_v`, `black_v`."""

    samples = True

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Where the line is, -1 (sensor 1) to 1 (sensor 8), and whether there is one."""
        white_v, black_v = self.wiring.number("white_v"), self.wiring.number("black_v")
        darkness = []
        for sensor in range(1, 9):
            volts = read_volts(self.machine, *self.wiring.channels[str(sensor)])
            darkness.append(min(1.0, max(0.0, (volts - white_v) / ((black_v - white_v) or 1.0))))
        if max(darkness) < 0.5:
            return {"line_there": False}
        place = sum(dark * (index - 3.5) / 3.5 for index, dark in enumerate(darkness)) / sum(darkness)
        return {"line_there": True, "place": place}


class Joystick(PinDriver):
    """KY-023: two channels, and a button that closes to ground. Option: `full_v`."""

    samples = True
    blocking = True
    poll_s = 0.02

    def open(self) -> None:
        """Take the button's pin, if it is wired."""
        gpio = self.wiring.pins.get("sw")
        self._button: Any = None if gpio is None else open_input(self, gpio, "up")

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """How far it leans, and whether it is pressed."""
        x, y = (200 * share_of(self.wiring, self.machine, name) - 100 for name in ("x", "y"))
        return {"left_right": x, "back_ahead": y, "press": self._button is not None and not self._button.value}
