"""What a driver is: a class that reads or switches one real thing. A part type names its driver in `[driver]`.

A driver knows nothing about robots. It is opened, read and switched in the thread of its bus; what it reads becomes the
value of sources in the type's model (`msbot.sim`), and it switches what the model computes. So settings such as
`invert`, `ramp` or `offset` work the same for real and simulated devices, and take effect at once.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import ClassVar

from msbot.config import BusKind, PartType, Scalar
from msbot.hardware.machine import Machine
from msbot.hardware.wiring import PartWiring, require_driver
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

Values = Mapping[str, Scalar]
"""Sources of a model by name."""


@dataclass(slots=True)
class Mount:
    """What a driver gets."""

    part_type: PartType
    wiring: PartWiring
    machine: Machine
    changed: Callable[[Values], None] = lambda _: None
    """Called with what has changed, from any thread, when the driver notices a change by itself."""


class Driver:
    """Base of all drivers; one that reads has `sample`, one that switches has `outputs_for` and `drive`.

    All but `outputs_for` are called in the thread of the bus and may block: `load_libraries` for long, the others for
    up to a second. They raise HardwareFault with a sentence that says what to check. After a fault the driver is
    closed and opened again until it works.
    """

    samples: ClassVar[bool] = False
    drives: ClassVar[bool] = False
    blocking: ClassVar[bool] = True
    """Whether `drive` may block: if not, it is called directly, and STOP needs no thread."""
    poll_s: ClassVar[float] = 0.0
    """How often to read for ports that speak on a change; 0 = the driver calls `changed` itself."""
    unknown_ports: ClassVar[tuple[str, ...]] = ()
    """Ports that stay silent because the real device cannot say anything about them."""

    def __init__(self, place: Mount) -> None:
        self.place = place
        self.wiring = place.wiring
        self.machine = place.machine

    def load_libraries(self) -> None:
        """Load the libraries that the driver needs, which may take seconds on a small computer; touches no hardware."""

    def open(self) -> None:
        """Open the hardware; afterwards the outputs are at their safe values."""

    def close(self) -> None:
        """Release the hardware with every output off; never raises HardwareFault, and may be called at any time."""

    def sample(self, values: Values) -> Values | None:
        """What the device measures now, as values of sources; None: nothing new.

        Args:
            values: the model's values, for settings that the reading depends on.
        """
        raise NotImplementedError

    def outputs_for(self, values: Values) -> object:
        """What the outputs should be according to the model; pure, and unchanged when there is nothing to do."""
        raise NotImplementedError

    def drive(self, wanted: object) -> None:
        """Set the outputs to what `outputs_for` returned."""
        raise NotImplementedError


def driver_class(part_type: PartType) -> type[Driver]:
    """The driver class of a part type.

    Raises:
        ConfigError: it has no driver, or the driver cannot be found on this computer.
    """
    spec = require_driver(part_type)
    module, _, name = spec.entry_point.partition(":")
    try:
        found: object = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"the driver {spec.entry_point} of part {part_type.number} cannot be found: {error}"
        ) from None
    except Exception as error:  # modules of others may raise anything
        words = f"{type(error).__name__}: {error}"
        raise ConfigError(
            f"the driver {spec.entry_point} of part {part_type.number} cannot be loaded: {words}"
        ) from error
    if not (isinstance(found, type) and issubclass(found, Driver)):
        raise ConfigError(f"{spec.entry_point} is not a driver: it must be a class derived from msbot.hardware.Driver")
    for flag, methods in _METHODS.items():
        _check_methods(spec.entry_point, found, flag, methods)
    return found


_METHODS = {"samples": ("sample",), "drives": ("outputs_for", "drive")}
"""What a driver needs that says so of itself."""


def _check_methods(entry_point: str, driver: type[Driver], flag: str, methods: tuple[str, ...]) -> None:
    own = [name for name in methods if getattr(driver, name) is not getattr(Driver, name)]
    missing = [f"{name}()" for name in methods if name not in own]
    if getattr(driver, flag) and missing:
        raise ConfigError(f"the driver {entry_point} has {flag} = True, but no {' and no '.join(missing)}; write it")
    is_meant = any(flag in vars(base) for base in driver.__mro__ if base is not Driver)
    if own and not is_meant:
        raise ConfigError(
            f"the driver {entry_point} has {own[0]}(), which is never called; write {flag} = True into the class"
        )


def bus_of(part_type: PartType, wiring: PartWiring, name: str) -> str:
    """The bus that a part is on: parts on one bus share a thread. Pins and the kernel's files are never shared."""
    if wiring.i2c is not None:
        return f"I2C bus {wiring.i2c[0]}"
    if part_type.driver.bus is BusKind.ADC and wiring.channels:
        return f"converter {next(iter(wiring.channels.values()))[0]}"
    return f"{part_type.driver.bus.value} of {name}"
