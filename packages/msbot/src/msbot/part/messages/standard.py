"""The standard messages: few and general, so that parts of different makers understand each other.

::

    from msbot.part.messages import Distance

    part.publish("distance", Distance(metres=0.42, in_range=True))

The library knows the same types by name (`msbot/config/message_types.toml`); a part that needs another message declares
a class of its own like these, and a table `[[type]]` in its library file.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from msbot.part.messages.message import Message
from msbot.part.messages.wire_types import AtMost, float32, float64, int32, uint8, uint16, uint32

# The message of the sample robot's ring.


class HelloWorld(Message):
    """Text with a count, as AA, BB and CC exchange it (thesis 3.12.3; the type of eProsima's examples)."""

    index: uint32
    message: str


class Switch(Message):
    """On or off: a button, a toggle switch, a relay, a lamp."""

    on: bool


class Number(Message):
    """Any number that has no message of its own."""

    value: float32


class Count(Message):
    """A whole number: pulses, steps, pieces."""

    value: int32


class Level(Message):
    """A share of the maximum in percent: a knob, loudness, power; -100 to 100 where it has a direction."""

    percent: float32


class Text(Message):
    """Words for a person to read."""

    text: str


class Light(Message):
    """How bright it is."""

    lux: float32


class Colour(Message):
    """Red, green and blue, each 0 to 255."""

    red: uint8
    green: uint8
    blue: uint8


class Temperature(Message):
    """How warm it is."""

    celsius: float32


class Pressure(Message):
    """Air pressure."""

    hectopascal: float32


class Gas(Message):
    """How much of a gas is in the air, in parts per million."""

    ppm: float32


class Distance(Message):
    """How far away something is."""

    metres: float32
    in_range: bool
    """False when nothing is seen."""


class Angle(Message):
    """A direction or a joint."""

    degrees: float32


class Speed(Message):
    """How quickly something turns, in turns per minute."""

    rpm: float32


class Vector(Message):
    """Three numbers along the axes of a part: acceleration, rate of turn, magnetic field."""

    x: float32
    y: float32
    z: float32


class Stick(Message):
    """A joystick: -100 to 100 along two axes, and its button."""

    x: float32
    y: float32
    pressed: bool


class Key(Message):
    """A key of a keypad."""

    key: str
    pressed: bool


class Line(Message):
    """Where a line is under a line follower."""

    position: float32
    """-1 far left, 0 in the middle, 1 far right."""
    seen: bool


class Tone(Message):
    """A tone for a loudspeaker."""

    hertz: float32
    """0 is silence."""
    seconds: float32
    """0 is until the next message."""


class Battery(Message):
    """A battery and what is drawn from it."""

    volts: float32
    amperes: float32
    percent: float32


class Weight(Message):
    """How heavy something is."""

    grams: float32


class Place(Message):
    """A place on Earth and how many satellites see it."""

    latitude: float64
    """Degrees, north is positive."""
    longitude: float64
    """Degrees, east is positive."""
    altitude: float32
    """Metres above the sea."""
    satellites: uint8


class Trigger(Message):
    """Do it now, once."""

    index: uint32


class Pose(Message):
    """Where something is in a plane, and where it looks."""

    x: float32
    """In m."""
    y: float32
    degrees: float32
    """0 along x, counted from x to y."""


class Scan(Message):
    """Distances in one direction after another, as a scanner turns."""

    angle_min: float32
    """Direction of the first distance, in degrees; 0 is straight ahead, to the left is positive."""
    angle_step: float32
    """From one direction to the next, in degrees."""
    reach: float32
    """In m; a distance beyond has met nothing."""
    metres: Annotated[list[float32], AtMost(360)]


class Strip(Message):
    """The colours of lamps in a row."""

    colours: Annotated[list[Colour], AtMost(64)]


class PixelFormat(IntEnum):
    """What a pixel of a picture is."""

    MONO8 = 0
    """One byte of grey."""
    RGB8 = 1
    """Three bytes: red, green, blue."""


class Picture(Message):
    """A small picture, row by row from the top left."""

    width: uint16
    height: uint16
    format: PixelFormat
    pixels: Annotated[bytes, AtMost(3072)]
    """64 x 48 of grey, or 32 x 32 in colour."""


STANDARD_MESSAGES: dict[str, type[Message]] = {
    message.type_name: message
    for message in (
        HelloWorld,
        Switch,
        Number,
        Count,
        Level,
        Text,
        Light,
        Colour,
        Temperature,
        Pressure,
        Gas,
        Distance,
        Angle,
        Speed,
        Vector,
        Stick,
        Key,
        Line,
        Tone,
        Battery,
        Weight,
        Place,
        Trigger,
        Pose,
        Scan,
        Strip,
        Picture,
    )
}
"""All standard messages by their names in the data space."""
