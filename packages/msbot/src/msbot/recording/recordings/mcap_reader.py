"""Reads MCAP files: ours, other programs', and damaged ones as far as they go."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, Final, cast

import lz4.frame
import zstandard
from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from msbot_agent.text.sentence import printable
from msbot_agent.text.untrusted_input import open_input_file, read_json
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

LARGEST_RECORD: Final = 64 << 20
"""Octets of the largest record that is read; a chunk of ours has a quarter of a megabyte."""
OWN: Final = "/msbot/"
FRAMES: Final = f"{OWN}frames/"
NS: Final = 1_000_000_000
_BROKEN: Final = (McapError, struct.error, ValueError, EOFError, KeyError, RuntimeError, zstandard.ZstdError)
"""What the library raises for octets that are no MCAP file, or no longer one."""


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """One message of a recording."""

    logged_ns: int
    """Nanoseconds since 1970; the order in the file."""
    at_ns: int
    """When it happened; earlier than `logged_ns` for what was only repeated at the beginning of a file."""
    channel: Channel
    schema: Schema | None
    data: bytes

    @property
    def topic(self) -> str:
        """Its topic."""
        return self.channel.topic

    @property
    def slot(self) -> str:
        """The slot that published it; empty: none, or the recording does not say."""
        return self.channel.metadata.get("slot", "")

    @property
    def is_ros(self) -> bool:
        """Whether it is a ROS 2 message whose definition the recording holds, and not JSON, or of an unknown type."""
        return self.schema is not None and (self.channel.message_encoding, self.schema.encoding) == ("cdr", "ros2msg")

    @property
    def is_repeated(self) -> bool:
        """Whether it happened before the file began."""
        return self.at_ns < self.logged_ns


class RecordingReader:
    """The messages of one file, in its order."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage = ""
        """After reading: what could not be read, in words; empty: all could."""
        self._lost_chunks = 0
        self._first_lost = ""
        self._unknown = 0
        """Messages of channels that no record describes: that record was in a chunk which was lost."""

    def messages(self) -> Iterator[RecordedMessage]:
        """Every message.

        Raises:
            ConfigError: the file cannot be opened, or is no MCAP file.
        """
        self.damage, self._lost_chunks, self._first_lost, self._unknown = "", 0, "", 0
        try:
            with open_input_file(self.path) as stream:
                end = yield from self._messages(stream)
        except OSError as error:
            raise ConfigError(f"cannot read {self.path}: {error.strerror or error}") from None
        self.damage = "; ".join(words for words in (self._losses(), end) if words)

    def _messages(self, stream: BinaryIO) -> Generator[RecordedMessage, None, str]:
        """Every message; returns why there are no more, empty: it is the end."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}

        def lost(chunk_end: int, error: Exception) -> None:
            if not self._lost_chunks:
                self._first_lost = f"the first ends at byte {chunk_end} ({error or type(error).__name__})"
                _take_summary(self.path, schemas, channels)
            self._lost_chunks += 1

        records = _records(_Bounded(stream, self.path.stat().st_size), lost)
        while True:
            try:
                record = next(records, None)
            except _BROKEN as error:
                at = stream.tell()
                if at <= len(_MAGIC) and (begin := _no_recording(stream)):
                    raise ConfigError(f"{self.path} {begin}") from error
                if isinstance(error, InvalidMagic):
                    return "it has no proper end; what came before was read"
                why = error or type(error).__name__
                return f"it cannot be read beyond byte {at} ({why}); what came before was read"
            match record:
                case None:
                    return ""
                case Schema():
                    schemas[record.id] = record
                case Channel():
                    channels[record.id] = record
                case Message() if (channel := channels.get(record.channel_id)) is not None:
                    schema = schemas.get(channel.schema_id)
                    yield RecordedMessage(record.log_time, record.publish_time, channel, schema, record.data)
                case Message():
                    self._unknown += 1

    def _losses(self) -> str:
        words = []
        if self._lost_chunks:
            words.append(f"{self._lost_chunks} of its chunks cannot be read, {self._first_lost}; the others were read")
        if self._unknown:
            words.append(
                f"{amount(self._unknown, 'message belongs', 'messages belong')} to channels that nothing describes"
            )
        return "; ".join(words)


def began_ns(path: Path) -> int:
    """When a recording begins, nanoseconds since 1970; 0: there is nothing in it.

    Raises:
        ConfigError: it is no recording.
    """
    return next((message.logged_ns for message in RecordingReader(path).messages()), 0)


def ended_ns(paths: Sequence[Path]) -> int:
    """When the last thing in some recordings was said, by the robot's clock, nanoseconds since 1970; 0: never.

    The recordings come one after the other in time. The system's clock may have been set since they began.

    Raises:
        ConfigError: one is no recording.
    """
    for path in reversed(paths):
        if newest := max((message.logged_ns for message in RecordingReader(path).messages()), default=0):
            return newest
    return 0


_MAGIC: Final = b"\x89MCAP0\r\n"
_FOOTER_OCTETS: Final = 1 + 8 + 20 + len(_MAGIC)
"""Opcode, length, content of the footer, and what ends the file (MCAP 1.0, "Footer")."""


class _Bounded:
    """A stream of which no more is read than there is: lengths in a damaged file may be anything."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream = stream
        self._rest = size

    def read(self, length: int) -> bytes:
        """So many octets.

        Raises:
            EOFError: there are not so many.
        """
        if length > self._rest:
            raise EOFError("the file ends there")
        self._rest -= length
        return self._stream.read(length)

    def tell(self) -> int:
        """How many octets of the file were read."""
        return self._stream.tell()


def _take_summary(path: Path, schemas: dict[int, Schema], channels: dict[int, Channel]) -> None:
    """What the end of the file repeats of its schemas and channels; a file that was cut short has no such end."""
    try:
        with open_input_file(path) as stream:
            stream.seek(-_FOOTER_OCTETS, os.SEEK_END)
            footer = next(StreamReader(stream, skip_magic=True, record_size_limit=LARGEST_RECORD).records, None)
            if not isinstance(footer, Footer) or not footer.summary_start:
                return
            stream.seek(footer.summary_start)
            rest = _Bounded(stream, path.stat().st_size - footer.summary_start)
            records = StreamReader(cast("BinaryIO", rest), skip_magic=True, record_size_limit=LARGEST_RECORD).records
            for record in records:
                if isinstance(record, Schema):
                    schemas.setdefault(record.id, record)
                elif isinstance(record, Channel):
                    channels.setdefault(record.id, record)
    except (OSError, *_BROKEN):
        return  # damaged, too; the messages that nothing describes are counted


def _records(stream: _Bounded, lost: Callable[[int, Exception], None]) -> Iterator[McapRecord]:
    reader = StreamReader(cast("BinaryIO", stream), emit_chunks=True, record_size_limit=LARGEST_RECORD)
    for record in reader.records:
        if isinstance(record, Chunk):
            try:
                whole = breakup_chunk(replace(record, compression="", data=_unpacked(record)), validate_crc=True)
            except _BROKEN as error:
                lost(stream.tell(), error)  # its length is right, or the next record would make no sense
                continue
            yield from whole
        else:
            yield record


def _unpacked(chunk: Chunk) -> bytes:
    """A chunk's content; a few octets cannot become gigabytes.

    Raises:
        ValueError: it is larger than it says, or than any honest chunk.
    """
    size = chunk.uncompressed_size
    if size > LARGEST_RECORD:
        raise ValueError(f"a chunk of {size} bytes")
    match chunk.compression:
        case "":
            return chunk.data
        case "lz4":
            content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        case "zstd":
            content = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
        case other:
            raise ValueError(f"a chunk compressed by {other!r}, which this program does not know")
    if len(content) != size:
        raise ValueError("a chunk with another content than it says")
    return content


def _no_recording(stream: BinaryIO) -> str:
    """Why a file is no recording by its first octets; empty: they are those of one."""
    stream.seek(0)
    begin = stream.read(len(_MAGIC))
    if len(begin) == len(_MAGIC) and begin[:5] == _MAGIC[:5] and begin != _MAGIC:
        return (
            f"is an MCAP file of version {printable(begin[5:6].decode(errors='replace'))}; this program reads version 0"
        )
    if not begin:
        return "is empty"
    if begin == _MAGIC:
        return ""
    if _MAGIC.startswith(begin):
        return f"ends after {amount(len(begin), 'byte')}: nothing is in it"
    return "is no recording: it does not begin like an MCAP file"


class Decoder:
    """Turns the octets of messages into values, by the schemas that the recording itself carries."""

    def __init__(self) -> None:
        self._decoders: dict[tuple[str, bytes], Callable[[bytes], object] | None] = {}

    def fields(self, message: RecordedMessage) -> Mapping[str, object] | None:
        """The fields of a message; None: what its octets mean is not known."""
        if message.channel.message_encoding == "json":
            try:
                found = read_json(message.data)
            except ValueError:
                return None
            return found if isinstance(found, dict) else {"value": found}
        schema = message.schema
        if schema is None or not message.is_ros:
            return None
        key = (schema.name, schema.data)
        if key not in self._decoders:
            self._decoders[key] = _decoder(message)
        decode = self._decoders[key]
        if decode is None:
            return None
        try:
            return _plain_fields(decode(message.data))
        except _BROKEN:
            return None


def _decoder(message: RecordedMessage) -> Callable[[bytes], object] | None:
    from mcap_ros2.decoder import DecoderFactory  # takes a tenth of a second

    try:
        return DecoderFactory().decoder_for("cdr", message.schema)
    except Exception:  # a foreign schema: its parser raises whatever it stumbles on; the octets are shown then
        return None


def _plain_fields(value: object) -> Mapping[str, object]:
    return {name: _plain(getattr(value, name)) for name in getattr(value, "__slots__", ())}


def _plain(value: object) -> object:
    if hasattr(value, "__slots__") and not isinstance(value, str | bytes | int | float):
        return _plain_fields(value)
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value
