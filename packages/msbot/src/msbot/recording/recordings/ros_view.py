"""A recording as ROS 2 has it: topics with the names and types that ROS 2 nodes know, if the robot shares them.

A topic with `ros = true` becomes what `ros2 bag record` would have recorded of it: `/ROVER/power` with messages of the
type std_msgs/msg/Float32. So `ros2 bag play` plays it to any node, and to the robot itself. All others keep their own
types.
"""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import count
from typing import TYPE_CHECKING

from mcap.records import Channel, Schema

from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recorder.ros_metadata import ROS_FIELDS, ROS_TOPIC, ROS_TYPE
from msbot.recording.recorder.schemas import ENCODING, ros_definition, ros_topic
from msbot.recording.recordings.reading import Decoder, RecordedMessage
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError, MsbotError

if TYPE_CHECKING:
    from msbot.part import Message
    from msbot.ros_forms import RosFields


@dataclass(frozen=True, slots=True)
class _Shared:
    """A topic that ROS 2 has."""

    name: str
    cls: type[Message]
    fields: RosFields
    schema: Schema


class RosView:
    """Shows messages of a recording as those of ROS 2."""

    def __init__(self) -> None:
        self._decoder = Decoder()
        self._names: dict[str, str] = {}
        """What a topic is -> its name in the file."""
        self._shared: dict[tuple[str, str, str], _Shared | None] = {}

    def shown(self, message: RecordedMessage) -> RecordedMessage | None:
        """The message in ROS 2; None: it is none, or a value of it does not fit there.

        What a channel says of slot and port is left out: a topic of a bag is one channel, whoever publishes in it.
        """
        if not message.is_ros:
            return None
        shared = self._shared_of(message.channel)
        if shared is None:
            channel = replace(message.channel, topic=self._name(message.topic, ros_topic(message.topic)), metadata={})
            return replace(message, channel=channel)
        values = self._decoder.fields(message)
        if values is None:
            return None
        try:
            data = _as_ros(shared, list(values.values()), message.at_ns)
        except MsbotError:
            return None
        name = self._name(f"{shared.name} of {shared.schema.name}", shared.name)
        channel = replace(message.channel, topic=name, metadata={})
        return RecordedMessage(message.logged_ns, message.at_ns, channel, shared.schema, data)

    def _shared_of(self, channel: Channel) -> _Shared | None:
        told = channel.metadata
        words = (told.get(ROS_TOPIC, ""), told.get(ROS_TYPE, ""), told.get(ROS_FIELDS, ""))
        if words not in self._shared:
            self._shared[words] = _read(*words)
        return self._shared[words]

    def _name(self, key: str, wanted: str) -> str:
        """A name that no other topic of the file has."""
        if key not in self._names:
            taken = set(self._names.values())
            others = (f"{wanted}_{number}" for number in count(2))
            self._names[key] = wanted if wanted not in taken else next(one for one in others if one not in taken)
        return self._names[key]


def _read(name: str, type_name: str, fields: str) -> _Shared | None:
    """What a channel says of its topic in ROS 2; None: it is not there, or what it says makes no sense."""
    if not (name and type_name and fields):
        return None
    from msbot.ros_forms import ros_class

    try:
        cls = ros_class(type_name)
        steps = tuple((int(position), str(path), float(factor)) for position, path, factor in json.loads(fields))
    except (ConfigError, ValueError, TypeError):
        return None
    return _Shared(
        ros_topic(name), cls, steps, Schema(id=0, name=type_name, encoding=ENCODING, data=ros_definition(cls).encode())
    )


def _as_ros(shared: _Shared, values: list[object], at_ns: int) -> bytes:
    """The payload of a sample.

    Raises:
        RemoteProtocolError: a value does not fit.
    """
    from msbot.ros_forms import recorded_as_ros

    return ENCAPSULATION + recorded_as_ros(shared.cls, shared.fields, values, at_ns)
