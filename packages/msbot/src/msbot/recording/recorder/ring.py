"""The flight recorder's files: short ones one after the other, of which the oldest is deleted."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from msbot_xrce.common.lazy_dataclass import dataclass

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
