"""One MCAP file that grows."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Final

from mcap.writer import CompressionType, Writer

from msbot.recording.recorder.batch import Kind, RecordedChannel, split_state
from msbot.recording.recordings.new_file import new_file

PROGRAM: Final = "msbot"
ENCAPSULATION: Final = b"\x00\x01\x00\x00"
"""Says that little-endian CDR follows (DDSI-RTPS 2.3 §10.2); samples travel without it in DDS-XRCE."""
CHUNK_OCTETS: Final = 256 << 10


class RecordingFile:
    """Writes records to one file; channels are declared in it when they are first used.

    Raises:
        OSError: from each method, when the file cannot be written.
    """

    def __init__(self, path: Path, began_ns: int) -> None:
        """Create the file.

        Raises:
            FileExistsError: there is one; nothing recorded is overwritten.
        """
        self.path = path
        self.began_ns = began_ns
        self._stream = new_file(path)
        self._writer = Writer(self._stream, chunk_size=CHUNK_OCTETS, compression=CompressionType.LZ4)
        self._channels: dict[int, int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._counts: dict[int, int] = {}
        self._has_news = True
        self._writer.start("", PROGRAM)

    @property
    def octets(self) -> int:
        """Octets written so far; the chunk in progress is not counted."""
        return self._stream.tell()

    def has(self, number: int) -> bool:
        """Whether a channel is declared in it."""
        return number in self._channels

    def declare(self, number: int, channel: RecordedChannel) -> None:
        """Declare a channel; `number` is the robot's name for it."""
        schema = 0
        if channel.schema_name:
            key = (channel.schema_name, channel.schema)
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(
                    channel.schema_name, channel.schema_encoding, channel.schema.encode()
                )
            schema = self._schemas[key]
        self._channels[number] = self._writer.register_channel(
            channel.topic, channel.encoding, schema, dict(channel.metadata)
        )

    def write(self, kind: int, number: int, at_ns: int, content: bytes, logged_ns: int | None = None) -> None:
        """One record in a declared channel.

        Args:
            kind: SAMPLE, OBJECT or STATE.
            number: the channel.
            at_ns: when it happened.
            content: its octets.
            logged_ns: the time of the file's beginning for what was known before it.
        """
        if kind == Kind.SAMPLE:
            content = ENCAPSULATION + content
        elif kind == Kind.STATE:
            content = split_state(content)[1]
        count = self._counts[number] = self._counts.get(number, 0) + 1
        self._writer.add_message(
            self._channels[number], at_ns if logged_ns is None else logged_ns, content, at_ns, count & 0xFFFFFFFF
        )
        self._has_news = True

    def flush(self) -> None:
        """Hand over to the system what has come; a crash of this process loses nothing of it."""
        if self._has_news:
            self._has_news = False
            self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Write the index, and close the file."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._stream.close()

    def drop(self) -> None:
        """Give the file up as it is, without its end: it cannot be written any more."""
        with contextlib.suppress(OSError):  # what is still buffered cannot be written, which has been told
            self._stream.close()
