"""Files that a person names, or that others have made: under a name there may be anything.

A pipe nobody writes to never ends being opened, a terminal never ends being read, a device such as `/dev/zero` has no
end, and a name may hold octets that no file has. All such files are opened here, which never waits, and says in an
`OSError` what the thing is.
"""

from __future__ import annotations

import errno
import io
import json
import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from msbot_agent.text.sentence import printable, whole
from msbot_xrce.errors import ConfigError

LARGEST_PEM = 1_000_000
"""Octets of a file with certificates or keys."""
LARGEST_SYSTEM_FILE = 16 * 1024 * 1024
"""Octets of a table of the system, such as /proc/net/unix."""
_OWN_STREAMS = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")
"""What the person connects to this program: a pipe there is meant, and is read until its writer ends it."""
_NULL_AND_THE_LIKE = {(1, minor) for minor in (3, 5, 7, 8, 9)}
"""Devices of Linux that answer at once: null, zero, full, random, urandom."""
_NO_FILES = {
    stat.S_IFDIR: (errno.EISDIR, "it is a folder"),
    stat.S_IFCHR: (errno.EINVAL, "it is a device, not a file"),
    stat.S_IFIFO: (errno.EINVAL, "it is a pipe, not a file"),
    stat.S_IFSOCK: (errno.ENXIO, "it is a socket, not a file"),
    stat.S_IFBLK: (errno.EINVAL, "it is a disk, not a file"),
}


def open_input_file(path: Path) -> io.BufferedReader:
    """Open a file for reading its octets.

    Raises:
        OSError: there is none, it may not be read, it is something else than a file, or the name can be none.
    """
    is_own = str(path).startswith(_OWN_STREAMS)
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOCTTY", 0)
    try:
        if not is_own:
            flags |= getattr(os, "O_NONBLOCK", 0)
        descriptor = os.open(path, flags)
    except ValueError:  # NUL, or half a character that is no octet of a name
        raise OSError(errno.EINVAL, "no file can have that name", str(path)) from None
    except OSError as error:
        if error.errno == errno.ENXIO:  # a socket, or a device without hardware
            raise OSError(errno.ENXIO, "it is a socket or a missing device, not a file", str(path)) from None
        raise
    found = os.fstat(descriptor)
    kind = stat.S_IFMT(found.st_mode)
    answers = kind == stat.S_IFCHR and _device_of(found) in _NULL_AND_THE_LIKE
    if kind in _NO_FILES and not answers and (kind == stat.S_IFDIR or not is_own):
        os.close(descriptor)
        number, words = _NO_FILES[kind]
        raise OSError(number, words, str(path))
    return open(descriptor, "rb")


def open_input_text(path: Path, *, encoding: str = "utf-8") -> TextIO:
    """The same for reading its text."""
    return io.TextIOWrapper(open_input_file(path), encoding=encoding)


def read_input_file(path: Path, most: int, what: str) -> bytes:
    """All octets of a file.

    Args:
        path: the name that was given.
        most: octets that such a file has at most.
        what: what it should be, for the sentence: `a program`.

    Raises:
        ConfigError: it has more, which a device without an end has, too.
        OSError: it cannot be read.
    """
    with open_input_file(path) as stream:
        octets = stream.read(most + 1) or b""  # None: a device that has nothing to say now
    if len(octets) > most:
        raise ConfigError(f"{path} is larger than {most:,} bytes, or has no end: {what} is not; name another file")
    return octets


def read_system_file(path: Path | str) -> str:
    """The text of a file of /proc or /sys, `\\ufffd` for what is no UTF-8 in it: names of programs, of networks, of
    file systems are octets that anybody chooses. As much as `LARGEST_SYSTEM_FILE`.

    Raises:
        OSError: it cannot be read, or is gone.
    """
    with open_input_file(Path(path)) as stream:
        return (stream.read(LARGEST_SYSTEM_FILE) or b"").decode("utf-8", "replace")


def _device_of(found: os.stat_result) -> tuple[int, int]:
    return (os.major(found.st_rdev), os.minor(found.st_rdev)) if sys.platform == "linux" else (0, 0)


# Reads JSON that somebody else has written.


MOST_DIGITS = 9
"""Of a count that somebody tells: nothing here is counted further."""


def read_json(text: str | bytes) -> Any:  # noqa: ANN401 - whatever is in it
    """What a JSON text says.

    Raises:
        ValueError: it is none, or deeper than the parser can follow, for which `json.loads` raises RecursionError.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_program_json(text: str | bytes) -> Any:  # noqa: ANN401 - whatever is in it
    """The same, of another program: what it says is shown and passed on, so texts can all be written (`whole`).

    Raises:
        ValueError: as above.
    """
    try:
        return _each_text(read_json(text), whole)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_remote_json(text: str | bytes) -> Any:  # noqa: ANN401 - whatever is in it
    """The same, of a program on another computer: nothing in it controls a terminal or begins a line (`printable`).

    Raises:
        ValueError: as above.
    """
    try:
        return _each_text(read_json(text), printable)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def parse_count(value: object) -> int:
    """How many of something another program says that there are, as a number or in digits; 0: it makes no sense."""
    digits = str(value) if isinstance(value, str) or (isinstance(value, int) and 0 <= value < 10**MOST_DIGITS) else ""
    return int(digits) if digits.isdecimal() and len(digits) <= MOST_DIGITS else 0


def _each_text(value: Any, change: Callable[[str], str]) -> Any:  # noqa: ANN401 - as above
    if isinstance(value, str):
        return change(value)
    if isinstance(value, list):
        return [_each_text(one, change) for one in value]
    if isinstance(value, dict):
        return {change(name): _each_text(one, change) for name, one in value.items()}
    return value
