"""Where one part is connected: from `--pins`, `--i2c`, `--adc`, `--device` and `--option`, and the defaults."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from pathlib import Path

from msbot.config import BusKind, DriverPin, DriverSpec, Library, PartType, Scalar
from msbot_agent.toml.document import read_document
from msbot_agent.toml.problems import Problems, suggestion
from msbot_agent.toml.table import Table
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

DEFAULT_I2C_BUS = 1
"""The bus on pins 3 and 5 of a Raspberry Pi."""
MOST_BUS = 255


@dataclass(frozen=True, slots=True)
class PartWiring:
    """Where one part is connected."""

    pins: Mapping[str, int] = field(default_factory=dict)
    """GPIO numbers (BCM), by name of the wire."""
    channels: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Converter (`iio:deviceN`) and channel, by name of the wire."""
    i2c: tuple[int, int] | None = None
    """Bus and address."""
    device: str = ""
    """Path or name of a device."""
    options: Mapping[str, Scalar] = field(default_factory=dict)

    def number(self, name: str) -> float:
        """An option that is a number."""
        return float(self.options[name])

    def flag(self, name: str) -> bool:
        """An option that is true or false."""
        return bool(self.options[name])

    def describe(self) -> str:
        """Where it is connected, in words."""
        words = [f"{name} = GPIO {gpio}" for name, gpio in self.pins.items()]
        words += [
            f"{name} = converter {device}, channel {channel}" for name, (device, channel) in self.channels.items()
        ]
        if self.i2c is not None:
            words.append(f"I2C bus {self.i2c[0]}, address 0x{self.i2c[1]:02x}")
        if self.device:
            words.append(self.device)
        return ", ".join(words)

    def claims(self) -> list[str]:
        """What no other part on this computer may use."""
        taken = [f"GPIO {gpio}" for gpio in self.pins.values()]
        taken += [f"channel {channel} of converter {device}" for device, channel in self.channels.values()]
        if self.i2c is not None:
            taken.append(f"address 0x{self.i2c[1]:02x} of I2C bus {self.i2c[0]}")
        if self.device.startswith("/"):
            taken.append(self.device)
        return taken


def require_driver(part_type: PartType) -> DriverSpec:
    """The driver of a part type.

    Raises:
        ConfigError: it has none; the text says why.
    """
    spec = part_type.driver
    if not spec.entry_point:
        why = spec.none or "its file has no table [driver]"
        raise ConfigError(f"part {part_type.number} has no driver for hardware: {why}; --simulate runs it without")
    return spec


def make_wiring(
    part_type: PartType,
    *,
    pins: str | Mapping[str, object] = "",
    adc: str | Mapping[str, object] = "",
    i2c: str = "",
    device: str = "",
    options: Iterable[str] | Mapping[str, object] = (),
) -> PartWiring:
    """Where a part of that type is connected: the values given, else the defaults of its type.

    Args:
        part_type: its type.
        pins: `trigger=23,echo=24`, or a table.
        adc: `out=0` or `out=1:0` (converter and channel), or a table.
        i2c: `1:0x76`, or a bus number alone.
        device: path or name.
        options: texts such as `full_v=5`, or a table.

    Raises:
        ConfigError: a value is given that this type does not have, or that is impossible.
    """
    spec = require_driver(part_type)
    number = part_type.number
    digital = [pin for pin in spec.pins if not pin.analog]
    analog = [pin for pin in spec.pins if pin.analog]
    wiring = PartWiring(
        pins=_pins(number, digital, _pairs("--pins", pins)),
        channels=_channels(number, analog, _pairs("--adc", adc)),
        i2c=_i2c(number, spec, i2c),
        device=_device(number, spec, device),
        options=_options(number, spec, options),
    )
    claims = wiring.claims()
    if twice := next((claim for claim in claims if claims.count(claim) > 1), None):
        raise ConfigError(f"part {number}: two wires are at {twice}; give each its own")
    return wiring


def _pairs(option: str, text: str | Mapping[str, object]) -> dict[str, str]:
    if not isinstance(text, str):
        return {name: str(value) for name, value in text.items()}
    found = {}
    for piece in filter(None, (piece.strip() for piece in text.split(","))):
        name, sign, value = piece.partition("=")
        if not sign:
            raise ConfigError(f"{option} {text}: {piece!r} needs a name and a number, as in {option} {piece}=17")
        if name.strip() in found:
            raise ConfigError(f"{option} {text}: {name.strip()} is there twice")
        found[name.strip()] = value.strip()
    return found


def _check_names(number: str, what: str, said: Iterable[str], known: list[str]) -> None:
    for name in said:
        if name not in known:
            right = suggestion(name, known, none_known="leave it out")
            raise ConfigError(f'part {number} has no {what} "{name}"; {right}')


def _pins(number: str, known: list[DriverPin], said: Mapping[str, str]) -> dict[str, int]:
    _check_names(number, "wire to a GPIO pin", said, [pin.name for pin in known])
    found: dict[str, int] = {}
    for pin in known:
        text = said.get(pin.name)
        gpio = pin.default if text is None else _whole(text.upper().removeprefix("GPIO"))
        if gpio is None and text is not None:
            raise ConfigError(f"pin {pin.name} of part {number}: {text!r} is no GPIO number; write {pin.name}=17")
        if gpio is not None:
            found[pin.name] = gpio
    return found


def _channels(number: str, known: list[DriverPin], said: Mapping[str, str]) -> dict[str, tuple[int, int]]:
    _check_names(number, "wire to a converter", said, [pin.name for pin in known])
    found: dict[str, tuple[int, int]] = {}
    for pin in known:
        text = said.get(pin.name)
        if text is None:
            if pin.default is not None:
                found[pin.name] = (0, pin.default)
            continue
        before, colon, after = text.rpartition(":")
        device, channel = _whole(before) if colon else 0, _whole(after)
        if device is None or channel is None:
            raise ConfigError(
                f"channel {pin.name} of part {number}: {text!r} is none; write {pin.name}=0, or {pin.name}=1:0 for "
                "channel 0 of iio:device1"
            )
        found[pin.name] = (device, channel)
    return found


def _i2c(number: str, spec: DriverSpec, text: str) -> tuple[int, int] | None:
    if spec.bus is not BusKind.I2C:
        if text:
            raise ConfigError(f"part {number} is not on I2C but on {spec.bus.value}; leave --i2c out")
        return None
    if not text:
        return DEFAULT_I2C_BUS, spec.addresses[0]
    before, _, after = text.partition(":")
    bus, address = _whole(before), _whole(after) if after else spec.addresses[0]
    if bus is None or bus > MOST_BUS or address is None:
        raise ConfigError(f"--i2c {text}: write bus and address, for example --i2c 1:0x{spec.addresses[0]:02x}")
    if address not in spec.addresses:
        known = ", ".join(f"0x{one:02x}" for one in spec.addresses)
        raise ConfigError(f"a {number} cannot have the I2C address 0x{address:02x}; it can have {known}")
    return bus, address


def _device(number: str, spec: DriverSpec, text: str) -> str:
    if text and spec.bus not in (BusKind.KERNEL, BusKind.SPI, BusKind.SERIAL):
        raise ConfigError(f"part {number} has no device; it is connected by {spec.bus.value}")
    return text or spec.device


def _options(number: str, spec: DriverSpec, said: Iterable[str] | Mapping[str, object]) -> dict[str, Scalar]:
    values: dict[str, Scalar] = {option.name: option.default for option in spec.options}
    known = {option.name: option for option in spec.options}
    if not isinstance(said, Mapping):
        pairs: dict[str, object] = {}
        for text in said:
            name, sign, value = text.partition("=")
            if not sign:
                raise ConfigError(f"--option {text}: write NAME=VALUE; part {number} has {', '.join(known) or 'none'}")
            pairs[name.strip()] = value.strip()
        said = pairs
    _check_names(number, "option", said, list(known))
    for name, given in said.items():
        option = known[name]
        parsed = option.kind.parse(given) if isinstance(given, str) else given
        if isinstance(parsed, bool | int | float | str):
            fault = option.fault(parsed)
        else:
            fault = f"is {given!r}; it must be {option.kind.describe}"
        if fault is not None:
            raise ConfigError(f"option {name} of part {number} {fault}")
        assert isinstance(parsed, bool | int | float | str)
        values[name] = parsed
    return values


def _whole(text: str) -> int | None:
    try:
        value = int(text.strip(), 0)
    except ValueError:
        return None
    return value if value >= 0 else None


# `parts.toml`: which parts are wired to this computer, one table `[[part]]` each.


MOST_PARTS = 64
"""Most parts of one file: a Raspberry Pi has 28 pins, and each part has a session of its own with the master."""


@dataclass(frozen=True, slots=True)
class HostedPart:
    """One part of the file."""

    name: str
    """The name of the part, unique in the file."""
    part_type: PartType
    number: str
    """The part number that it shows, perhaps with a version."""
    wiring: PartWiring | None
    """None: it is simulated."""
    key: str = ""
    """File with its key, or the key itself."""


def read_parts(path: Path, library: Library) -> list[HostedPart]:
    """The parts of a file.

    Raises:
        ConfigError: something is wrong; every problem is reported at once, with file and line.
    """
    problems = Problems()
    document = read_document(path, problems, if_missing="write one, see `msbot help raspberry_pi`")
    problems.raise_if_any()
    assert document is not None
    table = Table(document, problems, document.values)
    tables = table.tables("part")
    table.finish()
    parts: list[HostedPart] = []
    claims: dict[str, str] = {}
    if len(tables) > MOST_PARTS:
        table.report(f"there are {len(tables)} parts; {MOST_PARTS} can be in one file", "part")
        problems.raise_if_any()
    for entry in tables:
        part = _read_part(entry, library)
        if part is None:
            continue
        if part.name in [other.name for other in parts]:
            entry.report(f'there are two parts with the name "{part.name}"; give each a name of its own', "name")
            continue
        for claim in part.wiring.claims() if part.wiring is not None else ():
            if (other := claims.setdefault(claim, part.name)) != part.name:
                entry.report(f"{claim} is taken by {other}; wire one of them elsewhere")
        parts.append(part)
    problems.raise_if_any()
    return parts


def _read_part(table: Table, library: Library) -> HostedPart | None:
    number = table.name("type", "HC-SR04")
    name = table.name("name", "front", default=number or "part")
    simulate = table.flag("simulate", default=False)
    pins, adc, options = (table.scalars(key) for key in ("pins", "adc", "options"))
    i2c, device = table.text("i2c", "1:0x76"), table.text("device", "/dev/ttyACM0")
    key = table.text("key", "front.key")
    table.finish()
    if not number:
        return None
    try:
        part_type = library.require(number)
        wiring = None
        if not simulate:
            wiring = make_wiring(part_type, pins=pins, adc=adc, i2c=i2c, device=device, options=options)
    except ConfigError as error:
        table.report(str(error), "type")
        return None
    return HostedPart(name, part_type, number, wiring, key)
