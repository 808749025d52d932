"""A recording in the form of others: as a bag of ROS 2, and its values as a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Final

from mcap.records import Schema

from msbot.recording.recorder.bag import BagTopic, BagTopics
from msbot.recording.recorder.batch import OWN_TOPICS, RecordedChannel
from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recordings.mcap_reader import Decoder, RecordedMessage
from msbot.recording.recordings.summary import flat_fields
from msbot_xrce.errors import ConfigError

ChannelKey = tuple[str, str, bytes, tuple[tuple[str, str], ...]]


def channel_key(message: RecordedMessage) -> ChannelKey:
    """What tells a channel from others, whichever file it is in."""
    channel = message.channel
    data = b"" if message.schema is None else message.schema.data
    return (channel.topic, channel.message_encoding, data, tuple(sorted(channel.metadata.items())))


class RosView:
    """Shows messages of a recording as those of a bag."""

    def __init__(self) -> None:
        self._topics = BagTopics()
        self._found: dict[ChannelKey, tuple[BagTopic, Schema] | None] = {}

    def to_ros(self, message: RecordedMessage) -> RecordedMessage | None:
        """The message in ROS 2; None: it is none, or a value of it does not fit there."""
        key = channel_key(message)
        if key not in self._found:
            self._found[key] = self._find(message)
        found = self._found[key]
        if found is None:
            return None
        topic, schema = found
        data = message.data
        if topic.convert is not None:
            payload = topic.convert(data.removeprefix(ENCAPSULATION), message.at_ns)
            if payload is None:
                return None
            data = ENCAPSULATION + payload
        channel = replace(message.channel, topic=topic.channel.topic, metadata={})
        return RecordedMessage(message.logged_ns, message.at_ns, channel, schema, data)

    def _find(self, message: RecordedMessage) -> tuple[BagTopic, Schema] | None:
        if message.schema is None or not message.is_ros:
            return None
        schema, metadata = message.schema, message.channel.metadata
        definition = schema.data.decode("utf-8", "replace")
        topic = self._topics.of(
            RecordedChannel(message.topic, "cdr", schema.name, schema.encoding, definition, (*metadata.items(),))
        )
        if topic is None:
            return None
        if topic.convert is None:
            return topic, schema
        told = topic.channel
        return topic, Schema(id=0, name=told.schema_name, encoding=told.schema_encoding, data=told.schema.encode())


# The values of a recording as a Parquet file, which pandas, DuckDB and Polars read: the extra `msbot[parquet]`.


BATCH: Final = 50_000
"""Rows that are held in memory."""


def write_parquet(
    messages: Iterable[tuple[float, RecordedMessage]], target: Path, unread: Counter[str] | None = None
) -> int:
    """Write a row for each value of each sample; how many there were.

    Columns: `time_s` since the recording began, `at` (UTC, nanoseconds), `topic`, `slot`, `field`, and the value as
    `number` (true is 1) or as `text`. In `unread` the samples are counted whose meaning is not known, by topic.

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
                if message.topic.startswith(OWN_TOPICS):
                    continue
                fields = decoder.fields(message)
                if fields is None and unread is not None:
                    unread[message.topic] += 1
                for name, value in flat_fields(fields or {}):
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
