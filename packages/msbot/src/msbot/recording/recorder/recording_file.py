"""One MCAP file that grows."""

from __future__ import annotations

import contextlib
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from mcap.writer import CompressionType, Writer

from msbot.recording.recorder.batch import Kind, RecordedChannel, split_state
from msbot.recording.recorder.new_file import new_file
from msbot_xrce.lazy import dataclass

PROGRAM: Final = "msbot"
ENCAPSULATION: Final = b"\x00\x01\x00\x00"
"""Says that little-endian CDR follows (DDSI-RTPS 2.3 §10.2); samples travel without it in DDS-XRCE."""
CHUNK_OCTETS: Final = 256 << 10


class RecordingFile:
    """Writes records to one file; channels are declared in it when they are first used.

    Raises:
        OSError: from each method, when the file cannot be written.
    """

    def __init__(self, path: Path, began_ns: int, profile: str = "") -> None:
        """Create the file.

        Args:
            path: where.
            began_ns: when it begins, nanoseconds since 1970.
            profile: what kind of messages is in it, as MCAP's header says it; empty: several kinds.

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
        self._writer.start(profile, PROGRAM)

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


# The flight recorder's files: short ones one after the other, of which the oldest is deleted.


NAME: Final = re.compile(r"ring-(\d{8}T\d{6})-(\d{6})\.mcap")
SEGMENTS: Final = 10
"""The ring consists of about so many files: so much is deleted at once."""
MOST_FILES: Final = 64
LONGEST_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class RingLimits:
    """How much a ring keeps."""

    seconds: float
    octets: int

    @property
    def segment_s(self) -> float:
        """Seconds after which a new file begins."""
        return min(self.seconds / SEGMENTS, LONGEST_S)

    @property
    def segment_octets(self) -> int:
        """Octets after which a new file begins."""
        return self.octets // SEGMENTS


@dataclass(frozen=True, slots=True)
class Segment:
    """A file of a ring."""

    path: Path
    octets: int
    changed_s: float
    """When it was last written by the system's clock, seconds since 1970."""

    @property
    def began_s(self) -> float:
        """When it begins by the robot's clock, whole seconds since 1970."""
        return file_began_s(self.path.name)


def segment_name(at_ns: int, number: int) -> str:
    """The name of a file that begins at that time; in the order of their names they are in the order of time."""
    at = datetime.fromtimestamp(at_ns // 1_000_000_000, UTC)
    return f"ring-{at:%Y%m%dT%H%M%S}-{number % 1_000_000:06}.mcap"


def file_began_s(name: str) -> float:
    """When a file of a ring begins, by its name: whole seconds since 1970."""
    return datetime.strptime(name.split("-")[1], "%Y%m%dT%H%M%S").replace(tzinfo=UTC).timestamp()


def segments(folder: Path) -> list[Segment]:
    """The files of a ring, oldest first.

    Raises:
        OSError: the folder cannot be read.
    """
    found = []
    for path in sorted(folder.iterdir()):
        if NAME.fullmatch(path.name):
            try:
                status = path.stat()
            except FileNotFoundError:
                continue  # the recorder has just deleted it
            found.append(Segment(path, status.st_size, status.st_mtime))
    return found


def begun_segments(folder: Path) -> list[Segment]:
    """Those that something is in: a file is empty for a moment, and for good if the recorder was killed in it.

    Raises:
        OSError: the folder cannot be read.
    """
    return [segment for segment in segments(folder) if segment.octets]


def too_old(files: list[Segment], limits: RingLimits, now_s: float) -> list[Path]:
    """The files that must go so that the ring, without the file in progress, keeps its limits.

    Their age is told by the robot's clock, which their names have: the system's may be set meanwhile, by a time server
    after the start, and then all of them would look an hour old.
    """
    gone = []
    rest = sum(segment.octets for segment in files)
    for index, segment in enumerate(files):
        next_s = files[index + 1].began_s if index + 1 < len(files) else now_s
        is_old = min(next_s, segment.began_s + LONGEST_S) < now_s - limits.seconds
        if not is_old and rest <= limits.octets - limits.segment_octets and len(files) - index < MOST_FILES:
            break
        gone.append(segment.path)
        rest -= segment.octets
    return gone
