"""Frames of a bus as a candump log: writing it, and reading logs of many programs."""

from __future__ import annotations

import contextlib
import io
import logging
import sqlite3
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, TextIO

from msbot_agent.link.can.adapters import frame_of, message_of
from msbot_agent.link.can.protocol import Frame, LogLine, check_frame, format_log_line, parse_log_line
from msbot_agent.text.sentence import printable
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError, LocalProtocolError

if TYPE_CHECKING:
    import can.io.generic

LONGEST_LINE = 4096
"""Most characters of a line that are read; a line with a CAN FD frame has some two hundred."""
LONGEST_SKIPPED = 1_000_000
"""Characters of a line after which a file is no log: it may be a device without an end."""
MOST_WITHOUT = 10_000
"""Lines without one frame after which a file is no log."""
OWN_FORMAT = ".log"
"""Ending of log files as `candump -l` writes them."""
FOREIGN_FORMATS = (".asc", ".blf", ".trc", ".csv", ".db", ".mf4")
"""Endings of log files that python-can reads and writes for us."""
TEXT_FORMAT = ".txt"
"""Ending of files with the output of python-can's printer; they can only be written."""
FRAME_FORMATS = (OWN_FORMAT, *FOREIGN_FORMATS, TEXT_FORMAT)
"""All endings that a log of frames can be written with."""


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
    """The frames of a log, in order; lines that are not frames are counted and reported."""

    def __init__(self) -> None:
        self.frames = 0
        """Frames read so far."""
        self.unreadable = 0
        """Lines that were not frames."""
        self.first_problem = ""
        """What was wrong with the first unreadable line."""
        self.doubts = 0
        """Lines that python-can warned of."""
        self.first_doubt = ""
        """What it said of the first one."""

    def read(self, name: str) -> Iterator[LogLine]:
        """Every frame in the file of that name, or, with `-`, on standard input.

        Raises:
            ConfigError: the file cannot be read, may have no end, or there are lines, but no frame in them.
        """
        if _is_gvret(Path(name)):
            yield from self._read_gvret(Path(name))
            return
        if Path(name).suffix.lower() in FOREIGN_FORMATS:
            yield from self._read_foreign(Path(name))
            return
        import click

        try:
            with click.open_file(name, encoding="utf-8", errors="replace") as stream:
                yield from self._read_lines(stream, name)
        except OSError as error:
            raise ConfigError(f"cannot read {name}: {error.strerror}") from None
        if self.unreadable and not self.frames:
            raise self._no_frame(name)

    def _no_frame(self, name: str) -> ConfigError:
        return ConfigError(f"there is no frame in {name}: {self.first_problem}")

    def tell(self, name: str, complain: Callable[[str], None]) -> None:
        """Say what was no frame, once all is read; also that nothing was in it."""
        if self.doubts:
            complain(f"python-can warns of {amount(self.doubts, 'line')} of {name}; {self.first_doubt}")
        if self.unreadable:
            complain(f"{self.unreadable} of {self.frames + self.unreadable} lines were no frames; {self.first_problem}")
        elif not self.frames:
            complain(f"there is no frame in {name}: it is empty")

    def _read_lines(self, stream: IO[str], name: str) -> Iterator[LogLine]:
        for number, text in enumerate(_lines(stream, name), 1):
            if not text.strip():
                continue
            try:
                line = parse_log_line(text)
            except ConfigError as error:
                self.unreadable += 1
                self.first_problem = self.first_problem or f"line {number}: {error}"
                if not self.frames and number >= MOST_WITHOUT:
                    raise self._no_frame(name) from None
                continue
            self.frames += 1
            yield line

    def _read_gvret(self, path: Path) -> Iterator[LogLine]:
        try:
            with _Text(path) as stream:
                stream.readline()
                for number, text in enumerate(_lines(stream, str(path)), 2):
                    if not text:
                        continue
                    try:
                        line = _gvret_line(text)
                    except (ValueError, ConfigError, LocalProtocolError) as error:
                        self.unreadable += 1
                        self.first_problem = self.first_problem or f"line {number}: {error}"
                        continue
                    self.frames += 1
                    yield line
        except OSError as error:
            raise ConfigError(f"cannot read {path}: {error.strerror or error}") from None
        if self.unreadable and not self.frames:
            raise self._no_frame(str(path))

    @contextlib.contextmanager
    def _doubts_told(self) -> Iterator[None]:
        """Keep what python-can warns of meanwhile; without this it has lines of its own on stderr."""
        library, handler = logging.getLogger("can"), _Warnings(self._doubt)
        before = library.propagate
        library.addHandler(handler)
        library.propagate = False
        try:
            yield
        finally:
            library.removeHandler(handler)
            library.propagate = before

    def _doubt(self, words: str) -> None:
        self.doubts += 1
        self.first_doubt = self.first_doubt or words

    def _read_foreign(self, path: Path) -> Iterator[LogLine]:
        try:
            from can.io.blf import BLFParseError
            from can.io.generic import MessageReader

            import can
        except ImportError:
            raise _needs_python_can("reading", path) from None
        # Opened here, because python-can leaves files open when it finds errors in them; SQLite needs the name.
        readers: dict[str, tuple[str, Callable[..., MessageReader]]] = {
            ".asc": ("r", partial(can.ASCReader, relative_timestamp=False)),
            ".blf": ("rb", can.BLFReader),
            ".trc": ("r", can.TRCReader),
            ".csv": ("r", can.CSVReader),
            ".db": ("rb", lambda _: can.SqliteReader(path)),
            ".mf4": ("rb", lambda _: can.MF4Reader(path)),
        }
        mode, reader = readers[path.suffix.lower()]
        try:
            with (
                _Text(path) if mode == "r" else open_input_file(path) as stream,
                reader(stream) as messages,
                self._doubts_told(),
            ):
                for message in messages:
                    self.frames += 1
                    yield LogLine(message.timestamp, f"can{message.channel or 0}", frame_of(message))
        except OSError as error:
            raise ConfigError(f"cannot read {path}: {error.strerror or error}") from None
        except NotImplementedError:
            raise _needs_asammdf("reading", path) from None
        except (
            ValueError,
            LookupError,
            ArithmeticError,
            TypeError,
            struct.error,
            zlib.error,
            sqlite3.Error,
            BLFParseError,
        ) as error:
            why = printable(str(error))
            raise ConfigError(f"{path} is no {path.suffix} file that python-can understands: {why}") from None


class _Warnings(logging.Handler):
    """What a library warns of, in place of its own line on stderr."""

    def __init__(self, take: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._take = take

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        self._take(printable(record.getMessage()))


GVRET = "Time Stamp,ID,Extended,"
"""How a CSV file of GVRET begins, which SavvyCAN writes; python-can's own has `timestamp,arbitration_id,...`."""


def _is_gvret(path: Path) -> bool:
    if path.suffix.lower() != ".csv":
        return False
    try:
        with open_input_file(path) as stream:
            return stream.read(len(GVRET)).decode("latin-1").casefold() == GVRET.casefold()
    except (OSError, ConfigError):
        return False  # who reads it says why


def _gvret_line(text: str) -> LogLine:
    """A line of GVRET: microseconds, identifier, extended, [direction,] bus, length, and as many bytes.

    Raises:
        ValueError: it is none.
        LocalProtocolError: no bus carries such a frame.
    """
    cells = [cell.strip() for cell in text.rstrip(",").split(",")]
    if len(cells) > 3 and cells[3].casefold() in ("rx", "tx"):
        del cells[3]
    if len(cells) < 5 or cells[2].casefold() not in ("true", "false"):
        raise ValueError(f"{text[:80]!r} is no line of GVRET: time, identifier, true or false, bus, length, bytes")
    at, length = int(cells[0]) / 1e6, int(cells[4])
    data = bytes(int(cell, 16) for cell in cells[5 : 5 + length])
    if len(data) != length:
        raise ValueError(f"{text[:80]!r} says it has {length} data bytes and shows {len(data)}")
    frame = Frame(int(cells[1], 16), data, cells[2].casefold() == "true", length > 8)
    check_frame(frame)
    return LogLine(at, f"can{int(cells[3])}", frame)


def _lines(stream: IO[str], name: str) -> Iterator[str]:
    """Every line, cut where it is longer than any frame's, and without characters that would control a terminal.

    Raises:
        ConfigError: a line may have no end.
    """
    number = 0
    while text := stream.readline(LONGEST_LINE):
        number += 1
        rest, length = text, len(text)
        while rest and not rest.endswith("\n"):
            rest = stream.readline(LONGEST_LINE)
            length += len(rest)
            if length > LONGEST_SKIPPED:
                raise _endless(name, number)
        yield printable(text.strip())


def _endless(name: str, number: int) -> ConfigError:
    return ConfigError(
        f"{name} is no log of frames: line {number} is longer than {LONGEST_SKIPPED:,} characters; "
        "that of a frame has some 200"
    )


class _Text(io.TextIOWrapper):
    """A file that python-can reads line by line; it would take a line without an end into memory."""

    def __init__(self, path: Path) -> None:
        super().__init__(open_input_file(path), encoding="utf-8", errors="replace", newline=None)
        self._path = path
        self._number = 0

    def readline(self, size: int | None = -1) -> str:  # type: ignore[override]
        """See `io.TextIOBase`; the base class iterates by it."""
        self._number += 1
        line = super().readline(LONGEST_SKIPPED + 1 if size is None or size < 0 else size)
        if len(line) > LONGEST_SKIPPED:
            raise _endless(str(self._path), self._number)
        return line


class FrameWriter:
    """Writes frames to a file in the format that its ending names."""

    def __init__(self, path: Path) -> None:
        """Open the file; what is in it is overwritten.

        Raises:
            ConfigError: no such format, no python-can for it, or the file cannot be written.
        """
        self._stream: TextIO | None = None
        self._logger: can.io.generic.MessageWriter | None = None
        try:
            if path.suffix.lower() == OWN_FORMAT:
                self._stream = path.open("w", encoding="utf-8")
                return
            if path.suffix.lower() not in FRAME_FORMATS:
                known = ", ".join(FRAME_FORMATS)
                raise ConfigError(f"cannot write {path}: its ending names no format; there are {known}")
            try:
                import can
            except ImportError:
                raise _needs_python_can("writing", path) from None
            path.open("wb").close()
            self._logger = can.Logger(path)
        except OSError as error:
            raise ConfigError(f"cannot write {path}: {error.strerror}") from None
        except NotImplementedError:
            path.unlink()
            raise _needs_asammdf("writing", path) from None

    def write(self, line: LogLine) -> None:
        """One frame."""
        if self._stream is not None:
            self._stream.write(format_log_line(line) + "\n")
        elif self._logger is not None:
            message = message_of(line.frame)
            message.timestamp = line.at or 0.0
            message.channel = 0
            message.is_error_frame = line.frame.error
            self._logger(message)

    def close(self) -> None:
        """Write what is left, and close the file."""
        if self._stream is not None:
            self._stream.close()
        if self._logger is not None:
            self._logger.stop()


def _needs_python_can(what: str, path: Path) -> ConfigError:
    return ConfigError(
        f"{what} {path.suffix} files needs python-can: install it with `pip install 'msbot[can]'`, "
        f"or use candump's format, {OWN_FORMAT}"
    )


def _needs_asammdf(what: str, path: Path) -> ConfigError:
    return ConfigError(f"{what} {path.suffix} files needs asammdf: install it with `pip install 'python-can[mf4]'`")
