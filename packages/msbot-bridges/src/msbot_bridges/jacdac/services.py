"""The services of Jacdac that become ports: class, register and unit of each.

Numbers of Jacdac's service catalogue (microsoft.github.io/jacdac-docs/services). A sensor has one reading, which it
streams; an actuator has registers, which are written and read back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import cast

from msbot.part import Message
from msbot.part.messages.standard import (
    Angle,
    Colour,
    Count,
    Distance,
    Gas,
    Level,
    Light,
    Pressure,
    Switch,
    Temperature,
    Tone,
    Weight,
)
from msbot_agent.text.sentence import said
from msbot_bridges.bridge import Fit, fits_of
from msbot_xrce.lazy import dataclass

INTENSITY, VALUE, STREAMING_SAMPLES, STREAMING_INTERVAL, READING = 0x01, 0x02, 0x03, 0x04, 0x101
LEAST_VALUE, MOST_VALUE, LEAST_READING, MOST_READING = 0x110, 0x111, 0x104, 0x105
DESCRIPTION, PRODUCT, FIRMWARE = 0x180, 0x181, 0x185
"""Registers of the service control."""
IDENTIFY = 0x81
_PIXELS = 0x182
_OFFSET = 0x81
_PLAY_TONE = 0x80
MOST_PIXELS = 64


@dataclass(frozen=True, slots=True)
class FixedPoint:
    """A number with so many bits behind its point, as Jacdac writes `u0.16` or `i16.16`."""

    size: int
    """Bytes."""
    behind: int
    signed: bool = False

    def read(self, data: bytes) -> float:
        """The number; missing bytes are 0."""
        return int.from_bytes(data[: self.size], "little", signed=self.signed) / (1 << self.behind)

    def write(self, number: float) -> bytes:
        """Its bytes; what does not fit becomes the nearest that does."""
        bits = self.size * 8
        least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if self.signed else (0, (1 << bits) - 1)
        return max(least, min(most, round(number * (1 << self.behind)))).to_bytes(
            self.size, "little", signed=self.signed
        )


BOOL, U16, U32, I32 = FixedPoint(1, 0), FixedPoint(2, 0), FixedPoint(4, 0), FixedPoint(4, 0, signed=True)
U0_8, U0_16, I1_15 = FixedPoint(1, 8), FixedPoint(2, 16), FixedPoint(2, 15, signed=True)
U16_16, I16_16, U22_10, I22_10 = (
    FixedPoint(4, 16),
    FixedPoint(4, 16, signed=True),
    FixedPoint(4, 10),
    FixedPoint(4, 10, signed=True),
)

Registers = Mapping[int, bytes]
"""Registers of one service by number."""


@dataclass(frozen=True, slots=True)
class ServiceSetting:
    """A register that a slot sets."""

    name: str
    register: int
    form: FixedPoint
    kind: type[int] | type[float]
    default: float
    least: float
    most: float
    unit: str
    scale: float = 1.0
    """The setting is the register times this."""


INTERVAL = ServiceSetting("interval", STREAMING_INTERVAL, U32, int, 100, 20, 60_000, "ms")
"""How often a sensor sends its reading."""


@dataclass(frozen=True, slots=True)
class ServiceKind:
    """What a service of one class brings into a robot."""

    name: str
    """The port, numbered when a device has several."""
    words: str
    asked: tuple[int, ...] = ()
    """Registers that are read once, before the device is described."""
    settings: tuple[ServiceSetting, ...] = ()


@dataclass(frozen=True, slots=True)
class Sensor(ServiceKind):
    """A service with a reading."""

    message: type[Message] = field(kw_only=True)
    read: Callable[[bytes, Registers], Message] = field(kw_only=True)
    events: Mapping[int, Message] = field(default_factory=dict, kw_only=True)
    """What an event means, which comes sooner than the next reading."""


@dataclass(frozen=True, slots=True)
class Actuator(ServiceKind):
    """A service that is driven."""

    message: type[Message] = field(kw_only=True)
    write: Callable[[Message, Registers], Mapping[int, bytes]] = field(kw_only=True)
    """Registers for a message, which are kept."""
    tell: Callable[[Message], tuple[int, bytes] | None] = field(default=lambda _message: None, kw_only=True)
    """A command for a message, which is given once."""
    safe: Message | None = field(default=None, kw_only=True)
    stop: Callable[[Registers], Mapping[int, bytes]] = field(kw_only=True)
    """Registers of the safest state; it has stopped when all of them have been reported."""
    stopped: str = field(kw_only=True)
    """What it has to report, in words."""
    stops_by: str = field(default="", kw_only=True)
    """What STOP does whatever the safe value is; empty: nothing else."""
    stops_without_power: bool = field(default=False, kw_only=True)
    """It moves or sounds: nobody in command means off, whatever its safe value is."""
    ranges: Callable[[Registers], Mapping[str, tuple[float, float]]] = field(default=lambda _: {}, kw_only=True)
    """The least and the greatest value of the message's fields."""


def _level(form: FixedPoint) -> Callable[[bytes, Registers], Message]:
    return lambda data, _: Level(percent=round(form.read(data) * 100, 2))


def _level_sensor(name: str, words: str, form: FixedPoint = U0_16) -> Sensor:
    return Sensor(name, words, settings=(INTERVAL,), message=Level, read=_level(form))


def _distance(data: bytes, known: Registers) -> Message:
    metres = U16_16.read(data)
    least = U16_16.read(known.get(LEAST_READING, b""))
    most = U16_16.read(known[MOST_READING]) if known.get(MOST_READING) else float("inf")
    return Distance(metres=metres, in_range=least <= metres <= most)


def _angles(known: Registers) -> tuple[float, float]:
    least = I16_16.read(known[LEAST_VALUE]) if known.get(LEAST_VALUE) else 0.0
    return least, I16_16.read(known[MOST_VALUE]) if known.get(MOST_VALUE) else 180.0


def _angle_range(known: Registers) -> Mapping[str, tuple[float, float]]:
    least, most = _angles(known)
    return {"degrees": (least, most)} if least < most else {}


def _angle(message: Message, known: Registers) -> Mapping[int, bytes]:
    degrees = cast("Angle", message).degrees
    least, most = _angles(known)
    return {VALUE: I16_16.write(max(least, min(most, degrees))), INTENSITY: b"\1"}


def _power(message: Message, _known: Registers) -> Mapping[int, bytes]:
    power = max(-100.0, min(100.0, cast("Level", message).percent))
    return {VALUE: I1_15.write(power / 100), INTENSITY: b"\1"}


def _brightness(message: Message, _known: Registers) -> Mapping[int, bytes]:
    return {INTENSITY: U0_16.write(max(0.0, min(100.0, cast("Level", message).percent)) / 100)}


def _switched(message: Message, _known: Registers) -> Mapping[int, bytes]:
    return {INTENSITY: b"\1" if cast("Switch", message).on else b"\0"}


def _pixels(message: Message, known: Registers) -> Mapping[int, bytes]:
    colour = cast("Colour", message)
    return {VALUE: bytes((colour.red, colour.green, colour.blue)) * _pixel_count(known)}


def _pixel_count(known: Registers) -> int:
    return max(1, min(MOST_PIXELS, int(U16.read(known.get(_PIXELS, b"\1")))))


def _tone(message: Message) -> tuple[int, bytes] | None:
    """Play a tone: its period and the time its voltage is high in us, its length in ms."""
    tone = cast("Tone", message)
    if tone.hertz <= 0:
        return _PLAY_TONE, U16.write(1000) + U16.write(0) + U16.write(1)
    period = 1e6 / tone.hertz
    seconds = tone.seconds or 65.0
    return _PLAY_TONE, U16.write(period) + U16.write(period / 2) + U16.write(seconds * 1000)


def _switch_actuator(name: str, words: str) -> Actuator:
    return Actuator(
        name,
        words,
        message=Switch,
        write=_switched,
        safe=Switch(on=False),
        stop=lambda _: {INTENSITY: b"\0"},
        stopped="that it is off",
    )


SERVICES: Mapping[int, ServiceKind] = {
    0x1473A263: Sensor(
        "button",
        said("button"),
        settings=(INTERVAL,),
        message=Switch,
        read=lambda data, _: Switch(on=U0_16.read(data) > 0.5),
        events={1: Switch(on=True), 2: Switch(on=False)},
    ),
    0x1AD29402: Sensor(
        "switch",
        said("switch"),
        settings=(INTERVAL,),
        message=Switch,
        read=lambda data, _: Switch(on=bool(BOOL.read(data))),
        events={1: Switch(on=True), 2: Switch(on=False)},
    ),
    0x1179A749: Sensor(
        "motion",
        said("motion detector"),
        settings=(INTERVAL,),
        message=Switch,
        read=lambda data, _: Switch(on=bool(BOOL.read(data))),
    ),
    0x1F274746: _level_sensor("slider", said("slider")),
    0x10FA29C9: Sensor(
        "clicks",
        said("rotary encoder"),
        settings=(INTERVAL,),
        message=Count,
        read=lambda data, _: Count(value=int(I32.read(data))),
    ),
    0x1421BAC7: Sensor(
        "temperature",
        said("thermometer"),
        settings=(INTERVAL,),
        message=Temperature,
        read=lambda data, _: Temperature(celsius=I22_10.read(data)),
    ),
    0x16C810B8: Sensor(
        "humidity",
        said("humidity sensor"),
        settings=(INTERVAL,),
        message=Level,
        read=lambda data, _: Level(percent=U22_10.read(data)),
    ),
    0x1E117CEA: Sensor(
        "pressure",
        said("barometer"),
        settings=(INTERVAL,),
        message=Pressure,
        read=lambda data, _: Pressure(hectopascal=U22_10.read(data)),
    ),
    0x169C9DC6: Sensor(
        "co2",
        said("CO2 sensor"),
        settings=(INTERVAL,),
        message=Gas,
        read=lambda data, _: Gas(ppm=U22_10.read(data)),
    ),
    0x1E6ECAF2: Sensor(
        "illuminance",
        said("light meter"),
        settings=(INTERVAL,),
        message=Light,
        read=lambda data, _: Light(lux=U22_10.read(data)),
    ),
    0x17DC9A1C: _level_sensor("light", said("light sensor")),
    0x126C4CB2: _level_sensor("reflected", said("line sensor")),
    0x1D4AA3B3: _level_sensor("moisture", said("soil moisture sensor")),
    0x147B62ED: _level_sensor("water", said("water level sensor")),
    0x14AD1A5D: _level_sensor("sound", said("sound level sensor")),
    0x1F47C6C6: _level_sensor("bending", said("flex sensor"), I1_15),
    0x12FE180F: _level_sensor("magnet", said("magnetic field sensor"), I1_15),
    0x141A6B8A: Sensor(
        "distance",
        said("range finder"),
        asked=(LEAST_READING, MOST_READING),
        settings=(INTERVAL,),
        message=Distance,
        read=_distance,
    ),
    0x15B7B9BF: Sensor(
        "heading",
        said("compass"),
        settings=(INTERVAL,),
        message=Angle,
        read=lambda data, _: Angle(degrees=U16_16.read(data)),
    ),
    0x1F4D5040: Sensor(
        "weight",
        said("scale"),
        settings=(INTERVAL,),
        message=Weight,
        read=lambda data, _: Weight(grams=U16_16.read(data) * 1000),
    ),
    0x12FC9103: Actuator(
        "angle",
        said("servo"),
        asked=(LEAST_VALUE, MOST_VALUE),
        settings=(ServiceSetting("offset", _OFFSET, I16_16, float, 0.0, -90.0, 90.0, "°"),),
        message=Angle,
        write=_angle,
        ranges=_angle_range,
        stop=lambda _: {INTENSITY: b"\0"},
        stopped="that its power is off",
        stops_without_power=True,
    ),
    0x17004CD8: Actuator(
        "power",
        said("motor"),
        message=Level,
        write=_power,
        ranges=lambda _: {"percent": (-100.0, 100.0)},
        safe=Level(percent=0),
        stop=lambda _: {VALUE: b"\0\0", INTENSITY: b"\0"},
        stopped="that its power is off",
        stops_without_power=True,
    ),
    0x1CAB054C: Actuator(
        "brightness",
        said("lamp"),
        message=Level,
        write=_brightness,
        ranges=lambda _: {"percent": (0.0, 100.0)},
        safe=Level(percent=0),
        stop=lambda _: {INTENSITY: b"\0\0"},
        stopped="that it is dark",
    ),
    0x183FE656: _switch_actuator("relay", said("relay")),
    0x171723CA: _switch_actuator("solenoid", said("solenoid")),
    0x1609D4F0: Actuator(
        "colour",
        said("LEDs"),
        asked=(_PIXELS,),
        settings=(ServiceSetting("brightness", INTENSITY, U0_8, float, 5.0, 0.0, 100.0, "%", scale=100.0),),
        message=Colour,
        write=_pixels,
        safe=Colour(red=0, green=0, blue=0),
        stop=lambda known: {VALUE: bytes(3) * _pixel_count(known)},
        stopped="that its LEDs are dark",
    ),
    0x1B57B1D7: Actuator(
        "tone",
        said("buzzer"),
        message=Tone,
        write=lambda _message, _known: {INTENSITY: b"\xff"},
        tell=_tone,
        safe=Tone(hertz=0, seconds=0),
        stop=lambda _: {INTENSITY: b"\0"},
        stopped="that its volume is 0",
        stops_by="volume 0",
        stops_without_power=True,
    ),
}
"""By class. Other services are left out; the bridge names a device that has none of these."""


def service_fits() -> tuple[Fit, ...]:
    """Which messages modules send, and are driven by."""
    sensors = [(one.message, one.words) for one in SERVICES.values() if isinstance(one, Sensor)]
    actuators = [(one.message, one.words) for one in SERVICES.values() if isinstance(one, Actuator)]
    return fits_of(sensors, actuators)
