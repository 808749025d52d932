"""What makes up a part type: ports, parameters, pins, supply (the thesis' Hardware Information Module, 5.4.2)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import field
from enum import Enum

from msbot.config.library.field_types import MessageType
from msbot.config.library.simulator import Simulator
from msbot.config.library.versions import ANY_VERSION, VersionRange
from msbot_agent.text.sentence import Sentence, said
from msbot_agent.toml.problems import toml_value_in_words
from msbot_agent.toml.table import Scalar
from msbot_xrce.lazy import dataclass


class Direction(Enum):
    """Which way a port's messages go, seen from the part."""

    PUBLISH = "publish"
    SUBSCRIBE = "subscribe"
    SERVE = "serve"
    """It takes requests and gives replies."""
    CALL = "call"
    """It sends requests and gets replies."""

    @property
    def is_service(self) -> bool:
        """Whether its type is a request and a reply."""
        return self in (Direction.SERVE, Direction.CALL)


class Category(Enum):
    """What a part is for, in one word; decides how its picture is drawn."""

    SENSOR = "sensor"
    INPUT = "input"
    ACTUATOR = "actuator"
    DISPLAY = "display"
    POWER = "power"
    BOARD = "board"
    OTHER = "other"


class PinKind(Enum):
    """What a pin of a connector carries."""

    POWER = "power"
    GROUND = "ground"
    SIGNAL = "signal"
    BUS = "bus"
    UNUSED = "unused"


class ParameterKind(Enum):
    """What values a parameter takes."""

    BOOL = "bool"
    INT = "int"
    FLOAT = "float"
    TEXT = "text"
    PART = "part"
    """A part that is wired to this one, and how (see `board_wiring`); a type with such a parameter is a board."""

    @property
    def describe(self) -> str:
        """The kind in a sentence: "must be ..."."""
        words = {"bool": said("true or false"), "int": said("a whole number"), "float": said("a number")}
        return words.get(self.value, said("text in quotes"))

    def takes(self, value: Scalar) -> bool:
        """Whether a TOML value is of this kind; a whole number is a number too."""
        match self:
            case ParameterKind.BOOL:
                return isinstance(value, bool)
            case ParameterKind.INT:
                return isinstance(value, int) and not isinstance(value, bool)
            case ParameterKind.FLOAT:
                return isinstance(value, int | float) and not isinstance(value, bool)
            case ParameterKind.TEXT | ParameterKind.PART:
                return isinstance(value, str)

    def parse(self, text: str) -> Scalar | None:
        """The value of a text such as `true`, `12`, `0.5`; None when it is not of this kind."""
        try:
            match self:
                case ParameterKind.BOOL:
                    return {"true": True, "false": False}.get(text)
                case ParameterKind.INT:
                    return int(text)
                case ParameterKind.FLOAT:
                    return float(text)
                case ParameterKind.TEXT | ParameterKind.PART:
                    return text
        except ValueError:
            return None


@dataclass(frozen=True, slots=True)
class Port:
    """One kind of message that a part sends or receives."""

    name: str
    direction: Direction
    type_name: str
    """Name of the message type, for example `Light`; of a service both: `Angle -> Picture`."""
    rate_hz: float = 0.0
    """How often it is normally sent; 0 = only when something happens."""
    safe: Mapping[str, Scalar] | None = None
    """Fields of the message that an actuator applies when its partner or the master is lost; None = keep going."""
    description: str = ""
    message: MessageType | None = None
    """The fields of the message, of a service those of the request; None only for types that were not read from a
    library."""
    stop: str = ""
    """A field of what it publishes: while it is true, the part says STOP to the robot; empty: none."""
    reply: MessageType | None = None
    """Of a service: the fields of the reply."""
    stops_by: str = ""
    """What STOP does instead of the safe value: `quick stop`; empty: nothing else."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Field -> the least and the greatest value that makes sense at this port."""

    def fault(self, name: str, value: Scalar) -> str | None:
        """Why a field cannot have this value at this port; None when it can."""
        if name not in self.ranges or isinstance(value, bool):
            return None
        if isinstance(value, str):  # a list
            return _first_fault(value, self.ranges[name], self._unit(name))
        return _range_fault(value, self.ranges[name], self._unit(name))

    def _unit(self, name: str) -> str:
        return "" if self.message is None else self.message.units.get(name, "")


def _range_fault(value: float, limits: tuple[float, float], unit: str) -> str | None:
    least, most = limits
    if least <= value <= most:
        return None
    words = f"must be from {least:g} to {most:g} {unit}".rstrip()
    return f"{words}; it is {value:g}"


def _first_fault(text: str, limits: tuple[float, float], unit: str) -> str | None:
    """Of a list, the first element that is out of range."""
    for place, value in enumerate(json.loads(text)):
        if words := _range_fault(value, limits, unit):
            return f"[{place}] {words}"
    return None


@dataclass(frozen=True, slots=True)
class Parameter:
    """Something about a part that can be configured."""

    name: str
    kind: ParameterKind
    default: Scalar
    unit: str = ""
    least: float | None = None
    most: float | None = None
    description: str = ""

    def fault(self, value: Scalar) -> str | None:
        """Why this value cannot be set, with what would be right; None when it can."""
        if not self.kind.takes(value):
            return said(
                "must be {wanted}, for example {example!r}; it is {kind}",
                wanted=self.kind.describe,
                example=scalar_text(self.default),
                kind=toml_value_in_words(value),
            )
        if isinstance(value, bool | str):
            return None
        unit = f" {self.unit}" if self.unit else ""
        # Written so that a NaN is out of range too.
        if (self.least is not None and not value >= self.least) or (self.most is not None and not value <= self.most):
            if self.most is None:
                return said(
                    "is {value}; it must be at least {low}{unit}", value=value, low=f"{self.least:g}", unit=unit
                )
            if self.least is None:
                return said(
                    "is {value}; it must be at most {high}{unit}", value=value, high=f"{self.most:g}", unit=unit
                )
            low, high = f"{self.least:g}", f"{self.most:g}"
            return said("is {value}; it must be {low} to {high}{unit}", value=value, low=low, high=high, unit=unit)
        return None


@dataclass(frozen=True, slots=True)
class Pin:
    """One pin of the connector."""

    name: str
    kind: PinKind = PinKind.SIGNAL
    description: str = ""


class BusKind(Enum):
    """The kind of connection between a computer and a part."""

    PINS = "pins"
    """GPIO pins of the computer."""
    I2C = "i2c"
    ADC = "adc"
    """Channels of an analog-to-digital converter that the kernel knows (a Raspberry Pi has none of its own)."""
    KERNEL = "kernel"
    """There is a kernel driver; what it measures is in a file below /sys."""
    SPI = "spi"
    SERIAL = "serial"
    """A serial port, including USB."""


@dataclass(frozen=True, slots=True)
class DriverPin:
    """One wire between a pin of the part and the computer."""

    name: str
    """Its name in `--pins NAME=GPIO` or `--adc NAME=CHANNEL`."""
    pin: str
    """The pin of the part that it goes to."""
    default: int | None = None
    """Default GPIO number (BCM) or channel; None: the wire may be left out."""
    analog: bool = False
    """The wire goes to a converter's channel, not to a GPIO pin."""
    description: str = ""


@dataclass(frozen=True, slots=True)
class BoardSpec:
    """How a board with MicroPython drives the part (`[driver.board]`)."""

    driver: str = ""
    """One of `msbot.config.library.board_drivers.BOARD_DRIVERS`; "" = there is none."""
    sources: tuple[str, ...] = ()
    """What it measures or drives: names of sources of the part's simulator, in the driver's order."""
    pins: Mapping[str, str] = field(default_factory=dict)
    """Its wires and the pins of the part that they go to."""


@dataclass(frozen=True, slots=True)
class DriverSpec:
    """How a part type's ports meet hardware."""

    entry_point: str = ""
    """`package.module:Name` of the Python class that drives the real device; "" = there is none, see `none`."""
    bus: BusKind = BusKind.PINS
    pins: tuple[DriverPin, ...] = ()
    addresses: tuple[int, ...] = ()
    """I2C addresses that the chip can have, the usual one first."""
    device: str = ""
    """Usual device: a path, or the name by which the kernel knows the chip."""
    options: tuple[Parameter, ...] = ()
    """Options that belong to one piece of hardware and its wiring, not to the robot: calibration, resistors."""
    none: str = ""
    """Why there is no driver."""
    board: BoardSpec = BoardSpec()


@dataclass(frozen=True, slots=True)
class Supply:
    """What the part needs from its supply."""

    min_v: float
    max_v: float
    current_ma: float = 0.0
    """Highest current that it draws; 0 = unknown."""

    def __str__(self) -> str:
        """For example `3.3 to 5 V, at most 20 mA`."""
        form = "{least:g} V" if self.min_v == self.max_v else "{least:g} to {most:g} V"
        volts = Sentence(form, {"least": float(self.min_v), "most": float(self.max_v)})
        if not self.current_ma:
            return volts
        return said("{volts}, at most {current:g} mA", volts=volts, current=float(self.current_ma))


@dataclass(frozen=True, slots=True)
class PartType:
    """Everything about a part number."""

    number: str
    name: str
    manufacturer: str = ""
    description: str = ""
    specification: str = ""
    """Electrical data in words, for example `5V`."""
    resolution: str = ""
    ports: tuple[Port, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    compatible_with: tuple[str, ...] = ()
    """Part numbers whose slots this type can fill as well."""
    lacks: tuple[str, ...] = ()
    """Ports of those slots that it fills without having them."""
    source: str = ""
    """The file it was read from."""
    category: Category = Category.OTHER
    keywords: tuple[str, ...] = ()
    """Additional search words."""
    supply: Supply | None = None
    connector: str = ""
    """What kind of connector, for example `3 pins, 2.54 mm`."""
    pins: tuple[Pin, ...] = ()
    driver: DriverSpec = DriverSpec()
    """How its ports meet hardware; without an entry point, it has a controller of its own."""
    picture: str = ""
    """An SVG text; "" = one is drawn from category and pins."""
    versions: VersionRange = ANY_VERSION
    """Versions of the part (behind the @ of its number) that this entry describes."""
    simulator: Simulator | None = None
    """How the part behaves without hardware; None only for types that were not read from a library."""
    origin: str = ""
    """How the entry came into the library, in words; empty: somebody wrote it."""

    def port(self, name: str) -> Port | None:
        """The port of that name."""
        return next((port for port in self.ports if port.name == name), None)

    @property
    def carries(self) -> tuple[str, ...]:
        """The parameters that say which parts are wired to it; a type that has some is a board."""
        return tuple(one.name for one in self.parameters if one.kind is ParameterKind.PART)

    def parameter(self, name: str) -> Parameter | None:
        """The parameter of that name."""
        return next((parameter for parameter in self.parameters if parameter.name == name), None)


def scalar_text(value: Scalar) -> str:
    """A value as text, as it is sent to a part: `true`, `false`, a number, or the text itself."""
    return str(value).lower() if isinstance(value, bool) else str(value)
