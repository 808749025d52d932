"""A recording as ROS 2 has it: topics with the names and types that ROS 2 nodes know, if the robot shares them.

A topic with `ros = true` becomes what `ros2 bag record` would have recorded of it: `/ROVER/power` with messages of the
type std_msgs/msg/Float32. So `ros2 bag play` plays it to any node, and to the robot itself. All others keep their own
types.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mcap.records import Channel, Schema

from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recorder.schemas import ENCODING, ROS_FIELDS, ROS_TOPIC, ROS_TYPE, ros_definition, ros_topic
from msbot.recording.recordings.reading import OWN, Decoder, RecordedMessage
from msbot.recording.recordings.summary import flat_fields
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.part import Message
    from msbot.ros2.forms import RosFields


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
    from msbot.ros2.forms import ros_class

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
    from msbot.ros2.forms import recorded_as_ros

    return ENCAPSULATION + recorded_as_ros(shared.cls, shared.fields, values, at_ns)


# The values of a recording as a Parquet file, which pandas, DuckDB and Polars read: the extra `msbot[parquet]`.


BATCH: Final = 50_000
"""Rows that are held in memory."""


def write_parquet(messages: Iterable[tuple[float, RecordedMessage]], target: Path) -> int:
    """Write a row for each value of each sample; how many there were.

    Columns: `time_s` since the recording began, `at` (UTC, nanoseconds), `topic`, `slot`, `field`, and the value as
    `number` (true is 1) or as `text`.

    Raises:
        ConfigError: the file cannot be written, or what writes it is not installed.
    """
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise ConfigError("Parquet needs pyarrow: install it with `pip install 'msbot[parquet]'`") from None
    word = arrow.dictionary(arrow.int32(), arrow.string())
    schema = arrow.schema(
        [
            ("time_s", arrow.float64()),
            ("at", arrow.timestamp("ns", tz="UTC")),
            ("topic", word),
            ("slot", word),
            ("field", word),
            ("number", arrow.float64()),
            ("text", arrow.string()),
        ]
    )
    decoder, rows, count = Decoder(), [], 0
    try:
        with target.open("xb") as stream, parquet.ParquetWriter(stream, schema) as writer:
            for at_s, message in messages:
                if message.topic.startswith(OWN):
                    continue
                for name, value in flat_fields(decoder.fields(message) or {}):
                    rows.append(_row(at_s, message, name, value))
                    count += 1
                if len(rows) >= BATCH:
                    writer.write_table(arrow.Table.from_pylist(rows, schema))
                    rows = []
            writer.write_table(arrow.Table.from_pylist(rows, schema))
    except OSError as error:
        raise ConfigError(f"cannot write {target}: {error.strerror or error}") from None
    return count


def _row(at_s: float, message: RecordedMessage, name: str, value: object) -> dict[str, object]:
    is_number = isinstance(value, bool | int | float)
    text = value.hex() if isinstance(value, bytes) else str(value)
    return {
        "time_s": at_s,
        "at": message.at_ns,
        "topic": message.topic,
        "slot": message.slot,
        "field": name,
        "number": float(value) if isinstance(value, bool | int | float) else None,
        "text": None if is_number else text,
    }
