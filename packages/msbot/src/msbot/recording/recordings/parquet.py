"""The values of a recording as a Parquet file, which pandas, DuckDB and Polars read: the extra `msbot[parquet]`."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Final

from msbot.recording.recordings.reading import OWN, Decoder, RecordedMessage
from msbot.recording.recordings.telling import flat_fields
from msbot_xrce.errors import ConfigError

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
    schema = arrow.schema([
        ("time_s", arrow.float64()), ("at", arrow.timestamp("ns", tz="UTC")), ("topic", word), ("slot", word),
        ("field", word), ("number", arrow.float64()), ("text", arrow.string()),
    ])  # fmt: skip
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
        "time_s": at_s, "at": message.at_ns, "topic": message.topic, "slot": message.slot, "field": name,
        "number": float(value) if isinstance(value, bool | int | float) else None, "text": None if is_number else text,
    }  # fmt: skip
