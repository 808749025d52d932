"""Frames of a bus as a candump log: writing them, and reading them whatever program has written them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from msbot.errors import ConfigError
from msbot.link import Frame
from msbot.link.can_notation import LogLine, format_log_line, parse_log_line

if TYPE_CHECKING:
    import can

FOREIGN_FORMATS = (".asc", ".blf", ".trc")
"""Endings of log files that python-can reads for us."""


class FrameLog:
    """Writes every frame it is told to a stream, one line each, as `candump -l` does."""

    def __init__(self, stream: TextIO, channel: str, *, epoch_s: float) -> None:
        """Write to `stream`; `epoch_s` is the time since 1970 at which the times of the frames begin."""
        self._stream = stream
        self._channel = channel
        self._epoch_s = epoch_s

    def tap(self, at: float, _sender: str, frame: Frame) -> None:
        """One frame; a `FrameTap`."""
        self._stream.write(format_log_line(LogLine(self._epoch_s + at, self._channel, frame)) + "\n")


class FrameReader:
    """The frames of a log, in their order; lines that are none are counted and told about, not obeyed."""

    def __init__(self) -> None:
        self.frames = 0
        """Frames read so far."""
        self.unreadable = 0
        """Lines that were none."""
        self.first_problem = ""
        """What was wrong with the first of them."""

    def read(self, name: str) -> Iterator[LogLine]:
        """Every frame in the file of that name, or, with `-`, on standard input.

        Raises:
            ConfigError: the file cannot be read, or there are lines, but no frame in them.
        """
        if Path(name).suffix.lower() in FOREIGN_FORMATS:
            yield from self._read_foreign(Path(name))
            return
        import click

        try:
            with click.open_file(name, encoding="utf-8", errors="replace") as stream:
                yield from self._read_lines(stream)
        except OSError as error:
            raise ConfigError(f"cannot read {name}: {error.strerror}") from None
        if self.unreadable and not self.frames:
            raise ConfigError(f"there is no frame in {name}: {self.first_problem}")

    def _read_lines(self, lines: Iterable[str]) -> Iterator[LogLine]:
        for number, text in enumerate(lines, 1):
            if not text.strip():
                continue
            try:
                line = parse_log_line(text)
            except ConfigError as error:
                self.unreadable += 1
                self.first_problem = self.first_problem or f"line {number}: {error}"
                continue
            self.frames += 1
            yield line

    def _read_foreign(self, path: Path) -> Iterator[LogLine]:
        try:
            from can.io.blf import BLFParseError

            import can
        except ImportError:
            raise ConfigError(
                f"reading {path.suffix} files needs python-can: install it with `pip install 'msbot[can]'`, "
                "or record with `candump -l`"
            ) from None
        readers: dict[str, tuple[str, Callable[..., Iterable[can.Message]]]] = {
            ".asc": ("r", can.ASCReader),
            ".blf": ("rb", can.BLFReader),
            ".trc": ("r", can.TRCReader),
        }
        mode, reader = readers[path.suffix.lower()]
        try:
            with path.open(mode) as stream:
                for message in reader(stream):
                    self.frames += 1
                    yield LogLine(message.timestamp, f"can{message.channel or 0}", frame_of(message))
        except OSError as error:
            raise ConfigError(f"cannot read {path}: {error.strerror or error}") from None
        except (ValueError, LookupError, struct.error, BLFParseError) as error:
            raise ConfigError(f"{path} is no {path.suffix} file that python-can understands: {error}") from None


def frame_of(message: can.Message) -> Frame:
    """A message of python-can as a frame."""
    return Frame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id and not message.is_error_frame,
        message.is_fd,
        message.bitrate_switch,
        message.is_remote_frame,
        message.is_error_frame,
        message.error_state_indicator,
        message.dlc if message.is_remote_frame else 0,
    )
