"""GPIO pins with the library gpiozero 2, which takes lgpio on a Raspberry Pi and other boards with /dev/gpiochip."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Any

from msbot.hardware.driver import Driver
from msbot.hardware.hardware_fault import HardwareFault, missing_library

# Imports lgpio without what it does to the current folder.
#
# On import, lgpio makes a pipe `.lgd-nfy0` in the current folder and opens it. In a folder where this user may not
# write (a service in /) the import fails; elsewhere the pipe stays behind. So the import runs in a thread whose
# current folder is a temporary one; that of the other threads stays as it is.


CLONE_FS = 0x200
"""unshare(2): this thread gets a current folder of its own."""


def import_lgpio() -> None:
    """Import lgpio if it is there; why it is not, gpiozero says when it wants it."""
    if sys.platform == "linux" and "lgpio" not in sys.modules:
        thread = threading.Thread(target=_in_a_folder_of_its_own, name="import lgpio")
        thread.start()
        thread.join()


def _in_a_folder_of_its_own() -> None:
    with contextlib.suppress(ImportError, OSError), tempfile.TemporaryDirectory(prefix="msbot-") as folder:
        if ctypes.CDLL(None).unshare(CLONE_FS) == 0:  # a container may forbid it
            os.chdir(folder)
        import_module("lgpio")


def gpiozero() -> Any:  # noqa: ANN401 - the library has no types
    """The library, after checking that its pins can be used.

    Raises:
        HardwareFault: it is not installed, or this computer has no pins that may be used.
    """
    try:
        library = import_module("gpiozero")
    except ImportError:
        raise missing_library("parts on GPIO pins", "gpiozero") from None
    if library.Device.pin_factory is None:
        import_lgpio()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gpiozero warns about each pin library that does not work here
        try:
            library.Device.ensure_pin_factory()
        except Exception as error:
            raise HardwareFault(
                f"this computer's GPIO pins cannot be used ({error}): is it a Raspberry Pi, are gpiozero and lgpio "
                "installed (`pip install 'msbot[hardware]'`), and are you in the group gpio (`sudo usermod -aG gpio "
                "$USER`, then log in again)?"
            ) from None
    return library


class PinDriver(Driver):
    """Base of drivers on pins: keeps gpiozero's devices and releases them."""

    blocking = False

    def __init__(self, place: Any) -> None:  # noqa: ANN401 - as its base
        super().__init__(place)
        self._devices: list[Any] = []

    def load_libraries(self) -> None:
        """Load gpiozero; where it is missing, `open` says so."""
        with suppress(HardwareFault):
            gpiozero()

    def device(self, kind: str, *pins: int, **options: object) -> Any:  # noqa: ANN401 - the library has no types
        """Make one of gpiozero's devices; it is closed with the driver.

        Raises:
            HardwareFault: a pin is taken, or does not exist.
        """
        made = self._guard(pins, lambda: getattr(gpiozero(), kind)(*pins, **options))
        self._devices.append(made)
        return made

    def raw_pin(self, number: int) -> Any:  # noqa: ANN401 - the library has no types
        """One of gpiozero's bare pins, for what no device class does; it is closed with the driver.

        Raises:
            HardwareFault: the pin is taken, or does not exist.
        """

        def take() -> object:
            factory = gpiozero().Device.pin_factory
            pin = factory.pin(number)
            factory.reserve_pins(self, pin.info.name)
            return pin

        pin: Any = self._guard((number,), take)
        self._devices.append(pin)
        return pin

    def close(self) -> None:
        """Release all pins: outputs are switched off and become inputs again."""
        devices, self._devices = self._devices, []
        for device in reversed(devices):
            device.close()
            if hasattr(device, "info"):
                device.factory.release_pins(self, device.info.name)

    def _guard(self, pins: tuple[int, ...], make: Callable[[], object]) -> object:
        library = gpiozero()
        try:
            return make()
        except library.GPIOPinInUse as error:
            raise HardwareFault(f"GPIO {_list(pins)} is used twice in this program: {error}") from None
        except (library.GPIOZeroError, OSError, ValueError) as error:
            raise HardwareFault(
                f"GPIO {_list(pins)} cannot be used ({error}): does another program or a dtoverlay have it? "
                "`pinctrl` or `gpioinfo` shows who"
            ) from None
        except Exception as error:
            if type(error).__module__.partition(".")[0] != "lgpio":
                raise
            raise HardwareFault(
                f"GPIO {_list(pins)} cannot be used ({error}): does another program have it? `gpioinfo` shows who"
            ) from None


def _list(pins: tuple[int, ...]) -> str:
    return ", ".join(map(str, pins))
