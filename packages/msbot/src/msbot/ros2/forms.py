"""Messages of MsBOT as messages of ROS 2 and back: a level in percent is a `std_msgs/msg/Float32` for a ROS node.

A form joins two message classes by a map of fields, ours to theirs: `{"celsius": "temperature"}`. Theirs may lie deeper
(`pose.position.x`), and a factor may follow (`fluid_pressure * 100`: theirs is ours times 100). What is in no map is
zero, but for `header.stamp` of a message to ROS, which is the present time.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any

from msbot import ros2
from msbot.part import Message
from msbot.part.messages.leaves import from_plain
from msbot.part.messages.message import Field, fields_of
from msbot.part.messages.ros_names import ros_name
from msbot.ros2.known_types import KNOWN_PACKAGES, ROS_TYPES, check_type, types_like
from msbot.ros2.package_types import package_class, package_hash
from msbot_agent.ros.node_names import is_topic, topic_of
from msbot_xrce.errors import ConfigError, LocalProtocolError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

USUAL: dict[str, tuple[type[Message], dict[str, str]]] = {
    "HelloWorld": (ros2.String, {"message": "data"}),
    "Switch": (ros2.Bool, {"on": "data"}),
    "Number": (ros2.Float32, {"value": "data"}),
    "Count": (ros2.Int32, {"value": "data"}),
    "Level": (ros2.Float32, {"percent": "data"}),
    "Text": (ros2.String, {"text": "data"}),
    "Light": (ros2.Illuminance, {"lux": "illuminance"}),
    "Colour": (ros2.ColorRGBA, {"red": "r * 0.00392156862745098", "green": "g * 0.00392156862745098",
                                "blue": "b * 0.00392156862745098"}),
    "Temperature": (ros2.Temperature, {"celsius": "temperature"}),
    "Pressure": (ros2.FluidPressure, {"hectopascal": "fluid_pressure * 100"}),
    "Gas": (ros2.Float32, {"ppm": "data"}),
    "Distance": (ros2.Range, {"metres": "range"}),
    "Angle": (ros2.Float32, {"degrees": "data"}),
    "Speed": (ros2.Float32, {"rpm": "data"}),
    "Vector": (ros2.Vector3, {"x": "x", "y": "y", "z": "z"}),
    "Key": (ros2.String, {"key": "data"}),
    "Line": (ros2.Float32, {"position": "data"}),
    "Tone": (ros2.Float32, {"hertz": "data"}),
    "Battery": (ros2.BatteryState, {"volts": "voltage", "amperes": "current", "percent": "percentage * 0.01"}),
    "Weight": (ros2.Float32, {"grams": "data"}),
    "Place": (ros2.NavSatFix, {"latitude": "latitude", "longitude": "longitude", "altitude": "altitude"}),
    "Trigger": (ros2.UInt32, {"index": "data"}),
    "Pose": (ros2.Pose2D, {"x": "x", "y": "y", "degrees": "theta * 0.017453292519943295"}),
    "Scan": (ros2.LaserScan, {"angle_min": "angle_min * 0.017453292519943295", "reach": "range_max", "metres": "ranges",
                              "angle_step": "angle_increment * 0.017453292519943295"}),
    "Strip": (ros2.Image, {"colours": "data"}),
    "Picture": (ros2.Image, {"width": "width", "height": "height", "format": "encoding", "pixels": "data"}),
}  # fmt: skip
"""What a standard message is in ROS 2 unless a binding says otherwise."""

MOST_BEHIND = 1024
"""Octets behind a message that are let be: Fast DDS leaves some for each empty list, with anything in them."""

_NAME = re.compile(r"(?P<package>[a-z][a-z0-9_]*)/(msg/)?(?P<type>[A-Z][A-Za-z0-9]*)")
_PATH = re.compile(r"(?P<path>[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*)(\s*\*\s*(?P<factor>\d+(\.\d+)?([eE]-?\d+)?))?")


def topic_name(robot: str, topic: str) -> str:
    """A topic of a robot as ROS 2 has it in DDS.

    Raises:
        ConfigError: ROS 2 does not take the name.
    """
    if not is_topic(topic):
        raise ConfigError(
            f"topic {topic!r} cannot be in ROS 2: names consist of letters, digits, _ and /; "
            'ros_topic = "..." gives it another name there'
        )
    return topic_of(robot, topic)


def ros_class(name: str) -> type[Message]:
    """The message class of `std_msgs/msg/Float32` or `std_msgs/Float32`.

    Raises:
        ConfigError: it is not a name of a type, or not a known one.
    """
    match = _NAME.fullmatch(name)
    if match is None:
        raise ConfigError(f"{name!r} is not a message type of ROS 2: write it like std_msgs/msg/Float32")
    found = ROS_TYPES.get(f"{match['package']}::msg::dds_::{match['type']}_")
    if found is None:
        right = types_like(match["package"], "msg", match["type"])
        raise ConfigError(f"{name!r} is not among the message types of ROS 2 that MsBOT knows (msbot.ros2); {right}")
    return found


def _package_form(ours: type[Message], name: str, fields: Mapping[str, str] | None) -> RosForm | None:
    """The form of a type of the user's own package; None: it is a package that MsBOT knows, or no name of a type.

    Raises:
        ConfigError: there is a typo in the name, fields are given, or our own package has the type under another name.
    """
    match = _NAME.fullmatch(name)
    if match is None or match["package"] in KNOWN_PACKAGES:
        return None
    check_type(match["package"], "msg", match["type"])
    if fields:
        raise ConfigError(
            f"{name} is not among the message types that MsBOT knows: its fields must be those of {ours.type_name}; "
            "remove ros_fields"
        )
    return PackageForm(ours, package_class(ours, match["package"], match["type"]))


@dataclass(frozen=True, slots=True)
class _Step:
    """One field on both sides."""

    ours: str
    theirs: tuple[str, ...]
    factor: float
    names: tuple[str, ...] = ()
    """Of an enum: the words that theirs has."""


RosFields = tuple[tuple[int, str, float] | tuple[int, str, float, tuple[str, ...]], ...]
"""Which field of ours (by its position) is which of theirs (`linear.x`), and times how much; of an enum its names."""


class RosForm:
    """How one message class looks in ROS 2."""

    type_hash = ""
    """Of their type; empty: it is one that everybody knows."""

    def __init__(
        self,
        ours: type[Message],
        theirs: type[Message],
        fields: Mapping[str, str],
        epoch_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Join two classes.

        Raises:
            ConfigError: a field does not exist, or a number meets a text.
        """
        self.ours = ours
        self.theirs = theirs
        self._steps = tuple(_step(ours, theirs, name, text) for name, text in fields.items())
        self._stamped = any(field.name == "header" for field in fields_of(theirs))
        self._epoch_ns = epoch_ns

    def outward(self, payload: bytes) -> bytes:
        """A payload of ours as one of theirs.

        Raises:
            RemoteProtocolError: it is not a message of our class, or a value does not fit into theirs.
        """
        source, target = self.ours.decode(payload), self.theirs()
        for step in self._steps:
            value = getattr(source, step.ours)
            place = _inside(target, step.theirs[:-1])
            _set(place, step.theirs[-1], _named(value, step.names), step.factor)
        _complete(target)
        if self._stamped:
            _stamp(target, self._epoch_ns())
        return target.encode()

    @property
    def fields(self) -> RosFields:
        """The form without our class, for a recording."""
        positions = {field.name: position for position, field in enumerate(fields_of(self.ours))}
        plain = ((step, (positions[step.ours], ".".join(step.theirs), step.factor)) for step in self._steps)
        return tuple((*told, step.names) if step.names else told for step, told in plain)

    def inward(self, payload: bytes) -> bytes:
        """A payload of theirs as one of ours.

        Raises:
            RemoteProtocolError: it is not a message of their class, or a value does not fit into ours.
        """
        source, target = self.theirs.decode(payload, most_behind=MOST_BEHIND), self.ours()
        if isinstance(source, ros2.Image):
            _check_image(source)
        for step in self._steps:
            value = getattr(_inside(source, step.theirs[:-1]), step.theirs[-1])
            _set(target, step.ours, value, 1.0 / step.factor)
        return target.encode()


class PackageForm(RosForm):
    """A type of a package of the user's own: the octets are the same on both sides."""

    def __init__(self, ours: type[Message], theirs: type[Message]) -> None:
        super().__init__(ours, theirs, {})
        self.type_hash = package_hash(theirs)

    def outward(self, payload: bytes) -> bytes:
        """See `RosForm.outward`."""
        self.ours.decode(payload)
        return payload

    def inward(self, payload: bytes) -> bytes:
        """See `RosForm.inward`."""
        return self.ours.decode(payload, most_behind=MOST_BEHIND).encode()


def recorded_as_ros(theirs: type[Message], fields: RosFields, values: Sequence[object], epoch_ns: int) -> bytes:
    """A recorded message of ours, of which only the values are known, as one of theirs.

    Raises:
        RemoteProtocolError: the form does not fit, or a value does not.
    """
    target = theirs()
    try:
        for position, path, factor, *names in fields:
            *outer, last = path.split(".")
            value = _named(values[position], names[0] if names else ())
            _set(_inside(target, tuple(outer)), last, value, factor)
    except (AttributeError, IndexError) as error:
        raise RemoteProtocolError(f"the recorded form for {theirs.type_name} does not fit: {error}") from error
    _complete(target)
    if any(field.name == "header" for field in fields_of(theirs)):
        _stamp(target, epoch_ns)
    return target.encode()


def form_of(ours: type[Message], type_name: str = "", fields: Mapping[str, str] | None = None) -> RosForm:
    """The form of a message class: the usual one, or as somebody says.

    Args:
        ours: the class.
        type_name: `std_msgs/msg/Float32`, or one of another package, with the fields of ours; empty: the usual one.
        fields: ours to theirs; absent: the usual ones, or those of the same name, or the only one of each.

    Raises:
        ConfigError: there is no usual one, or what is said does not fit.
    """
    usual = USUAL.get(ours.type_name)
    if not type_name and usual is None:
        own = ros_name(ours.type_name)
        raise ConfigError(
            f"{ours.type_name} has no usual type in ROS 2: say ros_type and ros_fields, or "
            f'ros_type = "{own}" of the package that msbot library ros-package writes'
        )
    if form := _package_form(ours, type_name, fields):
        return form
    theirs = ros_class(type_name) if type_name else usual[0]  # type: ignore[index]
    if not fields:
        fields = usual[1] if usual is not None and usual[0] is theirs else fields_by_themselves(ours, theirs)
    return RosForm(ours, theirs, fields)


def fields_by_themselves(ours: type[Message], theirs: type[Message]) -> dict[str, str]:
    """Which of our fields is which of theirs, if nothing says it: those of one name, or the only one of each.

    Raises:
        ConfigError: there are none.
    """
    mine, others = [field.name for field in fields_of(ours)], [field.name for field in fields_of(theirs)]
    if len(mine) == len(others) == 1:
        return {mine[0]: others[0]}
    same = {name: name for name in mine if name in others}
    if not same:
        raise ConfigError(
            f"{ours.type_name} and {theirs.type_name} have no field of the same name: say ros_fields, "
            f'for example {{ {mine[0]} = "{others[0]}" }}'
        )
    return same


def _step(ours: type[Message], theirs: type[Message], name: str, text: str) -> _Step:
    match = _PATH.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{text!r} is not a field of ROS 2: write it like data, header.stamp.sec, or range * 0.01")
    path = tuple(match["path"].split("."))
    mine, other = _field(ours, (name,)), _field(theirs, path)
    factor = float(match["factor"] or 1)
    if factor == 0:
        raise ConfigError(f"{text!r}: a factor of 0 leaves nothing")
    kinds = [_kind(mine), _kind(other)]
    if kinds[0] != kinds[1] or kinds[0] == "other":
        raise ConfigError(
            f"{ours.type_name}.{name} is {mine.codec.word}, {theirs.type_name} has {other.codec.word} at "
            f"{match['path']}: a number goes with a number and a text with a text"
        )
    enum = mine.codec.inside if isinstance(mine.default, IntEnum) else None
    names = [member.name.lower() for member in enum] if enum is not None and issubclass(enum, IntEnum) else []
    return _Step(name, path, factor, tuple(names))


def _field(cls: type[Message], path: tuple[str, ...]) -> Field:
    for position, name in enumerate(path):
        field = next((one for one in fields_of(cls) if one.name == name), None)
        if field is None:
            known = ", ".join(one.name for one in fields_of(cls))
            raise ConfigError(f"{cls.type_name} has no field {name!r}; it has {known}")
        if position == len(path) - 1:
            return field
        inner = type(field.default)
        if not issubclass(inner, Message):
            raise ConfigError(f"{cls.type_name}.{name} has no fields inside")
        cls = inner
    raise ConfigError(f"{cls.type_name}: a field must be named")


def _kind(field: Field) -> str:
    if isinstance(field.default, str | IntEnum):
        return "text"
    if isinstance(field.default, bool | int | float):
        return "number"
    element = field.codec.element
    if element is None:
        return "other"
    if element.inside is not None and issubclass(element.inside, Message):
        is_octets = all(one.codec.word == "uint8" for one in fields_of(element.inside))
        return "numbers" if is_octets else "other"
    return "numbers" if element.code is not None else "other"


def _named(value: object, names: Sequence[str]) -> object:
    """The name of an enum's number."""
    return names[value] if names and isinstance(value, int) and 0 <= value < len(names) else value


def _inside(message: Message, path: tuple[str, ...]) -> Message:
    for name in path:
        message = getattr(message, name)
    return message


def _stamp(message: Message, epoch_ns: int) -> None:
    stamp = _inside(message, ("header", "stamp"))
    seconds, nanoseconds = divmod(epoch_ns, 1_000_000_000)
    _set(stamp, "sec", seconds, 1.0)
    _set(stamp, "nanosec", nanoseconds, 1.0)


def _complete(message: Message) -> None:
    """What follows from the rest of a message of ROS 2."""
    if isinstance(message, ros2.LaserScan):
        message.angle_max = message.angle_min + message.angle_increment * max(len(message.ranges) - 1, 0)
    elif isinstance(message, ros2.Image):
        if not message.encoding:  # lamps in a row
            message.encoding, message.height = "rgb8", 1
            message.width = len(message.data) // 3
        message.step = message.width * _PIXEL_OCTETS[message.encoding]


_PIXEL_OCTETS = {"mono8": 1, "rgb8": 3}


def _check_image(image: ros2.Image) -> None:
    octets = _PIXEL_OCTETS.get(image.encoding)
    if octets is None:
        raise RemoteProtocolError(f"an image of {image.encoding[:20]!r}, where {' or '.join(_PIXEL_OCTETS)} is known")
    if image.step != image.width * octets or len(image.data) != image.step * image.height:
        raise RemoteProtocolError(f"an image whose rows are not {image.width} pixels of {octets} octets each")


def _set_numbers(message: Message, name: str, value: Iterable[object], factor: float) -> None:
    """Set a list of numbers, or of messages of octets such as colours, from either."""
    codec = next(one.codec for one in fields_of(type(message)) if one.name == name)
    numbers = [octet for one in value for octet in _octets_of(one)]
    if factor != 1.0:
        numbers = [one * factor for one in numbers]
    element = codec.element
    made: object = numbers
    if isinstance(codec.zero(), bytes):
        made = bytes(numbers) if all(isinstance(one, int) and 0 <= one < 256 for one in numbers) else numbers
    elif element is not None and element.inside is not None and issubclass(element.inside, Message):
        size = len(fields_of(element.inside))
        if len(numbers) % size:
            raise RemoteProtocolError(f"{len(numbers)} octets make no whole number of {element.inside.__name__}")
        made = from_plain(codec, [numbers[at : at + size] for at in range(0, len(numbers), size)])
    setattr(message, name, made)


def _octets_of(value: object) -> list[Any]:
    """A number as it is, and the fields of a message, or of one that was recorded."""
    if isinstance(value, Message):
        return [getattr(value, field.name) for field in fields_of(type(value))]
    names = () if isinstance(value, bool | int | float) else getattr(value, "__slots__", ())
    return [getattr(value, one) for one in names] if names else [value]


def _set(message: Message, name: str, value: object, factor: float) -> None:
    held = getattr(message, name)
    kind = type(held)
    if isinstance(held, IntEnum) and isinstance(value, str):
        value = next((member for member in type(held) if member.name.lower() == value), value)
    elif isinstance(held, list | bytes):
        try:
            _set_numbers(message, name, value if isinstance(value, Iterable) else (), factor)
        except (LocalProtocolError, TypeError) as error:
            raise RemoteProtocolError(str(error)) from error
        return
    elif isinstance(value, bool | int | float):
        number = value if factor == 1.0 else value * factor
        try:
            value = kind(number) if kind is not int else round(number)
        except (ValueError, OverflowError) as error:  # not a number, or infinite
            raise RemoteProtocolError(f"{number} cannot be {type(message).__name__}.{name}") from error
    try:
        setattr(message, name, value)
    except LocalProtocolError as error:
        raise RemoteProtocolError(str(error)) from error
