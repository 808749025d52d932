"""The computer that parts are wired to: its buses, its /sys and /dev. Tests use one of their own."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import field
from pathlib import Path

from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.i2c import SmBus, open_smbus
from msbot_xrce.lazy import dataclass

KEEPER = "from msbot.hardware.output_guard import main; main()"
"""Its program; `-m msbot.hardware.output_guard` would warn first, since the package imports that file."""


@dataclass(slots=True)
class Machine:
    """Where things are on this computer."""

    root: Path = Path("/")
    """The root of the file system: /sys and /dev are looked up below it."""
    open_i2c: Callable[[int], SmBus] = open_smbus
    clock: Callable[[], float] = time.monotonic
    wait: Callable[[float], None] = time.sleep
    """Waits in the thread of a bus, for chips that need time."""
    keeper: list[str] = field(default_factory=lambda: [sys.executable, "-P", "-c", KEEPER])
    """The command of the process that makes outputs safe when this one is killed; [] = none."""

    def path(self, text: str) -> Path:
        """A path on this computer, such as `/sys/bus/w1/devices`."""
        return self.root / text.lstrip("/")


def read_text(path: Path, what: str, remedy: str) -> str:
    """The text of a file provided by the kernel.

    Raises:
        HardwareFault: there is no such file, or the kernel's driver reports that the chip does not answer.
    """
    try:
        return path.read_text("ascii", "replace").strip()
    except FileNotFoundError:
        raise HardwareFault(f"there is no {what} ({path}): {remedy}") from None
    except PermissionError:
        raise HardwareFault(
            f"no permission to read {path}: `sudo chmod a+r {path}`, or run as a user who may"
        ) from None
    except OSError as error:
        raise HardwareFault(f"the {what} does not answer ({error.strerror}): check its supply and its wires") from None


def read_number(path: Path, what: str, remedy: str) -> float:
    """The number in a file provided by the kernel.

    Raises:
        HardwareFault: as `read_text`, or it is not a number.
    """
    text = read_text(path, what, remedy)
    try:
        return float(text)
    except ValueError:
        raise HardwareFault(f"the {what} says {text[:40]!r}, which is not a number ({path})") from None
