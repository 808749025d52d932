"""Sensors with a kernel driver: what they measure is a number in a file below /sys."""

from __future__ import annotations

import re
from pathlib import Path

from msbot.hardware.driver import Driver, Values
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.machine import Machine, read_number, read_text

W1 = "/sys/bus/w1/devices"
IIO = "/sys/bus/iio/devices"
POWER_ON_MILLI = 85_000
"""What a DS18B20 reports before its first measurement (data sheet, table 1)."""


class Ds18b20(Driver):
    """A thermometer on 1-Wire, kernel driver w1_therm. Its `device` is its id, `28-...`, when there are several."""

    samples = True

    def open(self) -> None:
        """Find it."""
        self._file = self._find() / "w1_slave"
        self._last_milli = 0

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """The temperature; the kernel takes 0.75 s.

        Raises:
            HardwareFault: it does not answer, or its answer was garbled.
        """
        name = self._file.parent.name
        remedy = "check its wires, and the resistor of 4.7 kilo-ohms between DATA and VCC"
        text = read_text(self._file, f"1-Wire thermometer {name}", remedy)
        found = re.search(r"t=(-?\d+)", text)
        if "YES" not in text or found is None:
            raise HardwareFault(f"what the 1-Wire thermometer {name} says is disturbed (wrong CRC): {remedy}")
        milli = int(found[1])
        if milli == POWER_ON_MILLI and abs(self._last_milli - milli) > 5_000:
            raise HardwareFault(f"the 1-Wire thermometer {name} has lost its power in between: {remedy}")
        self._last_milli = milli
        return {"water": milli / 1000}

    def _find(self) -> Path:
        folder = self.machine.path(W1)
        known = sorted(path.name for path in folder.glob("28-*"))
        wanted = self.wiring.device
        if wanted in known:
            return folder / wanted
        if not wanted and len(known) == 1:
            return folder / known[0]
        if not wanted and known:
            raise HardwareFault(f"there are several 1-Wire thermometers: name one with --device {' or '.join(known)}")
        what = f"1-Wire thermometer {wanted}" if wanted else "1-Wire thermometer"
        here = f"; there are {', '.join(known)}" if known else ""
        raise HardwareFault(
            f"there is no {what}{here}: is dtoverlay=w1-gpio in /boot/firmware/config.txt, and a resistor of 4.7 "
            "kilo-ohms between DATA and VCC?"
        )


class Dht22(Driver):
    """Temperature and humidity, kernel driver dht11 (`dtoverlay=dht11,gpiopin=4`)."""

    samples = True

    def open(self) -> None:
        """Find it."""
        self._folder = iio_device(self.machine, self.wiring.device, "DHT22", "dtoverlay=dht11,gpiopin=4")

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Temperature and humidity; the kernel gives both in thousandths of a unit."""
        remedy = "check the wire DATA and its resistor of 10 kilo-ohms to VCC"
        return {
            "air": read_number(self._folder / "in_temp_input", "DHT22", remedy) / 1000,
            "moisture": read_number(self._folder / "in_humidityrelative_input", "DHT22", remedy) / 1000,
        }


NOTHING_MM = 2000.0
"""Anything further away counts as nothing seen (it then reports 8190 mm)."""


class Vl53l0x(Driver):
    """Time of flight, kernel driver vl53l0x: no public data sheet says how to set up the chip, but the kernel knows."""

    samples = True

    def open(self) -> None:
        """Find it."""
        self._folder = iio_device(
            self.machine,
            self.wiring.device,
            "VL53L0X",
            "`echo vl53l0x 0x29 | sudo tee /sys/bus/i2c/devices/i2c-1/new_device`",
        )

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """The distance in m."""
        remedy = "check its supply, SDA and SCL"
        raw = read_number(self._folder / "in_distance_raw", "VL53L0X", remedy)
        scale = read_number(self._folder / "in_distance_scale", "VL53L0X", remedy)
        metres = raw * scale
        return {"obstacle": metres if metres * 1000 < NOTHING_MM else 10.0}


def iio_device(machine: Machine, wanted: str, what: str, remedy: str) -> Path:
    """The folder of the sensor whose name begins with `wanted`, or of the device named.

    Raises:
        HardwareFault: the kernel has no such sensor.
    """
    folder = machine.path(IIO)
    for path in sorted(folder.glob("iio:device*")):
        name = path / "name"
        if path.name == wanted or (name.exists() and read_text(name, what, remedy).startswith(wanted)):
            return path
    raise HardwareFault(f"the kernel knows no {what}: is its driver loaded ({remedy})?")
