"""WS2812B: a strip of colour lamps on the data wire of SPI (Worldsemi WS2812B data sheet; kernel: spidev)."""

from __future__ import annotations

import contextlib
import struct
from typing import BinaryIO

from msbot.hardware.driver import Driver, Values
from msbot.hardware.hardware_fault import HardwareFault

LAMPS = 8
SPEED_HZ = 2_400_000
"""Three bits of SPI for each bit of the strip: 0.42 us high is a 0, 0.83 us is a 1 (0.4 and 0.8 us +-0.15)."""
ZERO, ONE = 0b100, 0b110
RESET = bytes(90)
"""Low for 300 us: newer chips need 280 us to latch the colours."""
SET_SPEED = 0x40046B04
"""SPI_IOC_WR_MAX_SPEED_HZ (linux/spi/spidev.h)."""


class Strip(Driver):
    """Eight lamps; `device` is the SPI device, /dev/spidev0.0."""

    drives = True

    def open(self) -> None:
        """Open the SPI; all lamps are dark."""
        self._file: BinaryIO | None = None
        path = self.machine.path(self.wiring.device)
        try:
            self._file = path.open("r+b", buffering=0)
            set_speed(self._file)
        except FileNotFoundError:
            raise HardwareFault(
                f"there is no {path}: switch SPI on with `sudo raspi-config nonint do_spi 0`, and wire DIN to GPIO 10"
            ) from None
        except PermissionError:
            raise HardwareFault(f"no permission for {path}: `sudo usermod -aG spi $USER`, then log in again") from None
        except OSError as error:
            raise HardwareFault(f"{path} is no SPI ({error.strerror}): name one with --device /dev/spidev0.0") from None
        self.drive((0, (0, 0, 0)))

    def close(self) -> None:
        """Make all lamps dark."""
        file, self._file = getattr(self, "_file", None), None
        if file is not None:
            with contextlib.suppress(OSError):  # it is closed because it fails, which has been reported
                file.write(frame([(0, 0, 0)] * LAMPS))
            file.close()

    def outputs_for(self, values: Values) -> object:
        """How many lamps are on, and their colour."""
        colour = tuple(min(255, max(0, round(float(values[name])))) for name in ("red", "green", "blue"))
        return int(float(values["lamps_on"])), colour

    def drive(self, wanted: object) -> None:
        """Send a colour to each lamp."""
        assert isinstance(wanted, tuple)
        lamps, colour = wanted
        assert self._file is not None
        try:
            self._file.write(frame([colour] * lamps + [(0, 0, 0)] * (LAMPS - lamps)))
        except OSError as error:
            raise HardwareFault(f"{self.wiring.device} does not take the colours ({error.strerror})") from None


def set_speed(file: BinaryIO) -> None:
    """Set the rate of an SPI device; a plain file, as used by tests, is left alone."""
    import fcntl
    import stat
    from os import fstat

    if stat.S_ISCHR(fstat(file.fileno()).st_mode):
        fcntl.ioctl(file.fileno(), SET_SPEED, struct.pack("=I", SPEED_HZ))


def frame(colours: list[tuple[int, int, int]]) -> bytes:
    """The octets to send over SPI for these colours: green, red, blue, highest bit first."""
    bits = 0
    count = 0
    for red, green, blue in colours:
        for octet in (green, red, blue):
            for position in range(7, -1, -1):
                bits = bits << 3 | (ONE if octet >> position & 1 else ZERO)
                count += 3
    return bits.to_bytes(count // 8) + RESET
