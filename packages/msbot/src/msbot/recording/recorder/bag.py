"""A recording as a bag of ROS 2: topics with the names and types that ROS 2 nodes know, in a file that they read.

A topic with `ros = true` becomes what `ros2 bag record` would have recorded of it: `/ROVER/power` with messages of the
type std_msgs/msg/Float32. So `ros2 bag play` plays it to any node, and to the robot itself. All others keep their own
types, under names that ROS 2 allows. What has no definition, and JSON, cannot be in a bag: its reader refuses a file
with a topic that has no schema, or another encoding than CDR.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mcap.exceptions import McapError
from mcap.records import Schema

from msbot.part.messages.ros_names import PACKAGE
from msbot.recording.recorder.batch import Kind, RecordedChannel
from msbot.recording.recorder.recording_file import ENCAPSULATION, RecordingFile
from msbot.recording.recorder.schemas import (
    ENCODING,
    NO_FIELDS,
    ROS_FIELDS,
    ROS_TOPIC,
    ROS_TYPE,
    ros_definition,
    ros_topic,
)
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.part import Message
    from msbot.ros2.forms import RosFields

PROFILE: Final = "ros2"
"""The profile of a file in which everything is a ROS 2 message: ros2 bag and rosbags ask for it."""
BROKEN_SAMPLE: Final = (McapError, struct.error, ValueError, EOFError, KeyError, IndexError, RuntimeError)
"""What the library raises for a sample that does not fit its own definition."""

Convert = Callable[[bytes, int], bytes | None]
"""A sample without its encapsulation, and when it was published (ns since 1970), as one of ROS 2; None: it does not
fit."""


@dataclass(frozen=True, slots=True)
class BagTopic:
    """What a channel of ours is in a bag."""

    channel: RecordedChannel
    """Without metadata: a topic of a bag is one channel, whoever publishes in it."""
    convert: Convert | None
    """None: the samples are the same."""


class BagTopics:
    """Finds the topic of a bag for each channel of a recording."""

    def __init__(self) -> None:
        self._found: dict[RecordedChannel, BagTopic | None] = {}
        self._names: dict[str, str] = {}
        """What a topic is -> its name in the file."""

    def of(self, channel: RecordedChannel) -> BagTopic | None:
        """The topic; None: the channel has no ROS 2 messages."""
        if channel not in self._found:
            self._found[channel] = self._find(channel)
        return self._found[channel]

    def _find(self, channel: RecordedChannel) -> BagTopic | None:
        if not channel.schema_name or (channel.encoding, channel.schema_encoding) != ("cdr", ENCODING):
            return None
        shared = _shared(channel)
        if shared is None:
            name = self._name(channel.topic, ros_topic(channel.topic))
            return BagTopic(RecordedChannel(name, "cdr", channel.schema_name, ENCODING, channel.schema), None)
        wanted, type_name, cls, fields = shared
        name = self._name(f"{wanted} of {type_name}", wanted)
        if cls is None:  # a type of a package with the fields of ours: only names differ
            schema = channel.schema.replace(f"{PACKAGE}/", f"{type_name.partition('/')[0]}/")
            return BagTopic(RecordedChannel(name, "cdr", type_name, ENCODING, schema), None)
        return BagTopic(
            RecordedChannel(name, "cdr", type_name, ENCODING, ros_definition(cls)), _converter(channel, cls, fields)
        )

    def _name(self, key: str, wanted: str) -> str:
        """A name that no other topic of the file has."""
        if key not in self._names:
            taken = set(self._names.values())
            others = (f"{wanted}_{number}" for number in count(2))
            self._names[key] = wanted if wanted not in taken else next(one for one in others if one not in taken)
        return self._names[key]


def _shared(channel: RecordedChannel) -> tuple[str, str, type[Message] | None, RosFields] | None:
    """Name, type and fields of a topic in ROS 2, as its channel says; None: it is not there, or that makes no sense.

    Without a class it has the fields of ours.
    """
    metadata = dict(channel.metadata)
    name, type_name, fields = (metadata.get(key, "") for key in (ROS_TOPIC, ROS_TYPE, ROS_FIELDS))
    if not (name and type_name and fields):
        return None
    if fields == NO_FIELDS:
        return ros_topic(name), type_name, None, ()
    from msbot.ros2.forms import ros_class  # with all messages of ROS 2, which few recordings need

    try:
        cls = ros_class(type_name)
        steps = tuple(map(_step, json.loads(fields)))
    except (ConfigError, ValueError, TypeError):
        return None
    return ros_topic(name), type_name, cls, steps


def _step(told: list[object]) -> tuple[int, str, float] | tuple[int, str, float, tuple[str, ...]]:
    """One field of a form; the names of an enum may stand at its end."""
    position, path, factor, *names = told
    plain = int(str(position)), str(path), float(str(factor))
    return (*plain, tuple(map(str, names[0]))) if names and isinstance(names[0], list) else plain


def _converter(channel: RecordedChannel, cls: type[Message], fields: RosFields) -> Convert:
    from mcap_ros2.decoder import DecoderFactory  # takes a tenth of a second

    from msbot.ros2.forms import recorded_as_ros

    schema = Schema(id=0, name=channel.schema_name, encoding=ENCODING, data=channel.schema.encode())
    try:
        decode = DecoderFactory().decoder_for("cdr", schema)
    except Exception:  # a foreign definition: its parser raises whatever it stumbles on
        return lambda _payload, _at_ns: None
    if decode is None:
        return lambda _payload, _at_ns: None

    def convert(payload: bytes, at_ns: int) -> bytes | None:
        try:
            ours = decode(ENCAPSULATION + payload)
            return recorded_as_ros(cls, fields, [getattr(ours, name) for name in ours.__slots__], at_ns)
        except (MsbotError, *BROKEN_SAMPLE):
            return None

    return convert


class Bag:
    """Writes a bag while the robot runs; used like a `RecordingFile`.

    Raises:
        OSError: from each method, when the file cannot be written.
    """

    def __init__(self, path: Path, began_ns: int) -> None:
        """Create the file.

        Raises:
            FileExistsError: there is one; nothing recorded is overwritten.
        """
        self.path = path
        self._file = RecordingFile(path, began_ns, PROFILE)
        self._topics = BagTopics()
        self._numbers: dict[RecordedChannel, int] = {}
        """Channel of the bag -> its number in the file: several of ours may be one there."""
        self._channels: dict[int, tuple[str, BagTopic | None, int]] = {}
        """The robot's name for a channel -> its topic, what it is in the bag, and its number there."""
        self._left_out: set[str] = set()
        self._untold: list[str] = []

    def has(self, number: int) -> bool:
        """Whether a channel is known."""
        return number in self._channels

    def declare(self, number: int, channel: RecordedChannel) -> None:
        """Say what a channel is; `number` is the robot's name for it."""
        found, own = self._topics.of(channel), 0
        if found is not None:
            own = self._numbers.setdefault(found.channel, len(self._numbers) + 1)
            if not self._file.has(own):
                self._file.declare(own, found.channel)
        self._channels[number] = (channel.topic, found, own)

    def write(self, kind: int, number: int, at_ns: int, content: bytes, logged_ns: int | None = None) -> None:
        """One record in a known channel; see `RecordingFile.write`."""
        topic, found, own = self._channels[number]
        payload = None if kind != Kind.SAMPLE or found is None else content
        if payload is not None and found is not None and found.convert is not None:
            payload = found.convert(payload, at_ns)
        if payload is not None:
            self._file.write(kind, own, at_ns, payload, logged_ns)
        elif topic not in self._left_out:
            self._left_out.add(topic)
            self._untold.append(topic)

    def take_left_out(self) -> list[str]:
        """Topics of which something was left out, each once: those that are new since the last call."""
        untold, self._untold = self._untold, []
        return untold

    def flush(self) -> None:
        """See `RecordingFile.flush`."""
        self._file.flush()

    def close(self) -> None:
        """See `RecordingFile.close`."""
        self._file.close()

    def drop(self) -> None:
        """See `RecordingFile.drop`."""
        self._file.drop()
