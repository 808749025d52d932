"""NEO-6M: the sentence GGA of NMEA 0183 over a serial port (u-blox 6 protocol specification, 22.3)."""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

from msbot.hardware.driver import Driver, Values
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.serial_stream import SerialStream
from msbot_xrce.errors import LinkDown

BAUDRATE = 9600
LONGEST_LINE = 200
SILENT_S = 3.0
"""Longer silence is a fault: the receiver sends every second."""
READ_S = 0.05


class Fix(NamedTuple):
    """A position."""

    latitude: float
    longitude: float
    altitude: float
    satellites: int


class Gps(Driver):
    """Publishes what the receiver says; nothing while it sees too few satellites."""

    samples = True

    def open(self) -> None:
        """Open the port."""
        self._stream: SerialStream | None = None
        self._stream = SerialStream(str(self.machine.path(self.wiring.device)), BAUDRATE, "a GPS receiver")
        self._text = b""
        self._heard_at = self.machine.clock()

    def close(self) -> None:
        """Close the port."""
        stream, self._stream = getattr(self, "_stream", None), None
        if stream is not None:
            stream.close()

    def sample(self, values: Values) -> Values | None:  # noqa: ARG002 - as its base
        """The newest position since the last call, if there is one.

        Raises:
            HardwareFault: it is silent or unplugged.
        """
        assert self._stream is not None
        found = None
        try:
            received = self._stream.read(READ_S)
        except LinkDown as error:
            raise HardwareFault(str(error)) from None
        now = self.machine.clock()
        *lines, self._text = (self._text + received).split(b"\n")
        self._text = self._text[-LONGEST_LINE:]
        for line in lines:
            fields = sentence(line)
            if fields:
                self._heard_at = now
                found = place(fields) or found
        if now - self._heard_at > SILENT_S:
            raise HardwareFault(
                f"the GPS receiver at {self.wiring.device} says nothing that makes sense: check that its TX goes to "
                "RX of the computer, and that the serial console is off (`sudo raspi-config nonint do_serial_cons 1`)"
            )
        if found is None:
            return None
        return {
            "north": found.latitude,
            "east": found.longitude,
            "height": found.altitude,
            "satellites": found.satellites,
        }


def sentence(line: bytes) -> list[str]:
    """The fields of a sentence whose checksum is right; empty for anything else."""
    text = line.strip().decode("ascii", "replace")
    body, star, checksum = text.removeprefix("$").rpartition("*")
    if not (text.startswith("$") and star and len(checksum) == 2):
        return []
    if f"{reduce(lambda sum_, octet: sum_ ^ octet, body.encode(errors='replace'), 0):02X}" != checksum.upper():
        return []
    return body.split(",")


def place(fields: list[str]) -> Fix | None:
    """The position in a GGA sentence; None for any other sentence, or when the receiver has no fix."""
    if len(fields) < 10 or not fields[0].endswith("GGA") or fields[6] in ("", "0"):
        return None
    try:
        latitude, longitude = _degrees(fields[2], 2), _degrees(fields[4], 3)
        altitude, satellites = float(fields[9]), int(fields[7])
    except ValueError:
        return None
    south, west = fields[3] == "S", fields[5] == "W"
    return Fix(-latitude if south else latitude, -longitude if west else longitude, altitude, satellites)


def _degrees(text: str, digits: int) -> float:
    """Degrees from `ddmm.mmmmm`."""
    return int(text[:digits]) + float(text[digits:]) / 60
