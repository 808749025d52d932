"""The file with STOP: it has all its room on the disk, and is open, from the start of the master on.

So a STOP can be written when the disk is full and when the process can open nothing more. The file has two places of
the same length. A record goes to the place of the older one, in one write, and is then synchronised; what was cut off
half way (the power failed) is no record, and as nobody knows what it would have said, it counts as STOP.

A record is a line of JSON, filled up with spaces; a check sum tells whether it is whole. A file from before there were
places (one record, as short as it is) is read, too.
"""

from __future__ import annotations

import json
import os
import secrets
import zlib
from dataclasses import asdict, replace
from pathlib import Path

from msbot.pnp.emergency_stop import StopRecord
from msbot_agent.text.json_reading import read_json
from msbot_agent.text.printable import whole

PLACE_OCTETS = 8192
"""Length of a place; the longest reason and name fit, whatever letters they are of."""
LONGEST_NAME = 256
"""Characters of whoever has said it; a reason is cut until it fits."""
PLACES = 2
_BLANK = b" " * (PLACE_OCTETS - 1) + b"\n"
_BROKEN = b"?" + _BLANK[1:]
_BINARY = getattr(os, "O_BINARY", 0)


class BrokenRecord(ValueError):
    """One record of the file cannot be read; `number` is the highest of those that can be."""

    def __init__(self, number: int = 0) -> None:
        super().__init__("one of its records is broken")
        self.number = number


class StopFile:
    """One robot's file. All but `read` belongs to one thread.

    Args:
        path: where it is.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._open: int | None = None

    def read(self) -> StopRecord | None:
        """The latest record; None: there is none.

        Raises:
            OSError: the file is there, and cannot be read.
            BrokenRecord: it can be, and nobody knows what it says.
        """
        try:
            octets = self.path.read_bytes()
        except FileNotFoundError:
            return None
        return newest(octets)

    def prepare(self) -> None:
        """Open the file, and reserve its room on the disk, unless both is so already.

        Raises:
            OSError: that is not possible.
        """
        if self._open is not None:
            if self._is_in_its_place(self._open):
                return
            self.close()
        try:
            opened = os.open(self.path, os.O_RDWR | _BINARY)
        except FileNotFoundError:
            self._open = self._made(_BLANK)
            return
        if os.fstat(opened).st_size == PLACES * PLACE_OCTETS:
            self._open = opened
            return
        os.close(opened)
        try:
            found = self.read()
        except BrokenRecord:  # it stays so until a record takes its place
            self._open = self._made(_BROKEN)
        else:
            self._open = self._made(_BLANK if found is None else encoded(found))

    def write(self, record: StopRecord) -> None:
        """Write a record so that it survives whatever becomes of this process, and a loss of power.

        Raises:
            OSError: it cannot be written.
        """
        self.prepare()
        assert self._open is not None
        os.lseek(self._open, 0, os.SEEK_SET)
        place = older_place(os.read(self._open, PLACES * PLACE_OCTETS))
        os.lseek(self._open, place * PLACE_OCTETS, os.SEEK_SET)
        _write_all(self._open, encoded(record))
        os.fsync(self._open)

    def close(self) -> None:
        """Give the descriptor back."""
        if self._open is not None:
            os.close(self._open)
            self._open = None

    def _is_in_its_place(self, opened: int) -> bool:
        """Whether whoever opens the path finds the file that is open here."""
        try:
            there = os.stat(self.path)
        except OSError:
            return False
        return os.path.samestat(there, os.fstat(opened))

    def _made(self, first: bytes) -> int:
        """Put a file with that first place there, as one step; returns it, open."""
        self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        draft = self.path.with_name(f".{self.path.name}.{secrets.token_hex(4)}")
        opened = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL | _BINARY, 0o600)
        try:
            _write_all(opened, first + _BLANK * (PLACES - 1))
            os.fsync(opened)
            if os.name == "posix":
                os.replace(draft, self.path)
            else:  # what is open has no other name there
                os.close(opened)
                os.replace(draft, self.path)
                return os.open(self.path, os.O_RDWR | _BINARY)
        except BaseException:
            os.close(opened)
            draft.unlink(missing_ok=True)
            raise
        _synchronise(self.path.parent)
        return opened


def encoded(record: StopRecord) -> bytes:
    """A record, as long as a place."""
    record = replace(record, by=record.by[:LONGEST_NAME])
    while True:
        said = {name: whole(value) if isinstance(value, str) else value for name, value in asdict(record).items()}
        text = json.dumps(said, ensure_ascii=False)
        line = f'{{"check": {zlib.crc32(text.encode())}, "stop": {text}}}'.encode()
        if len(line) < PLACE_OCTETS:
            return line + b" " * (PLACE_OCTETS - 1 - len(line)) + b"\n"
        record = replace(record, reason=record.reason[: len(record.reason) // 2])


def newest(octets: bytes) -> StopRecord | None:
    """The latest record among the places of a file; None: there is none.

    Raises:
        BrokenRecord: one of them cannot be read.
    """
    is_old = len(octets) != PLACES * PLACE_OCTETS
    records, broken = [], 0
    for place in [octets] if is_old else _places(octets):
        try:
            records.append(_decoded(place))
        except ValueError:
            broken += 1
    latest: StopRecord | None = None
    for record in records:
        if record is not None and (latest is None or record.is_newer_than(latest)):
            latest = record
    if broken:
        raise BrokenRecord(0 if latest is None else latest.number)
    return latest


def older_place(octets: bytes) -> int:
    """The place that the next record goes to: an empty or broken one, else that of the older record."""
    found = []
    for place, content in enumerate(_places(octets)):
        try:
            record = _decoded(content)
        except ValueError:
            return place
        if record is None:
            return place
        found.append(record)
    first, second = found
    return 1 if first.is_newer_than(second) else 0


def _places(octets: bytes) -> list[bytes]:
    return [octets[place * PLACE_OCTETS : (place + 1) * PLACE_OCTETS] for place in range(PLACES)]


def _decoded(octets: bytes) -> StopRecord | None:
    """The record of a place; None: it is empty.

    Raises:
        ValueError: it cannot be read.
    """
    if len(octets) == PLACE_OCTETS and not octets.strip():
        return None
    try:
        content = read_json(octets)
        if "check" in content:
            check, content = int(content["check"]), content["stop"]
            if zlib.crc32(json.dumps(content, ensure_ascii=False).encode()) != check:
                raise ValueError("it is not whole")
        number = int(content["number"])
        return StopRecord(
            number,
            bool(content["holds"]),
            str(content["by"]),
            str(content["reason"]),
            int(content["at_ns"]),
            int(content.get("latest", number)),
        )
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"it is no record: {error}") from None


def _write_all(opened: int, octets: bytes) -> None:
    left = memoryview(octets)
    while left:
        left = left[os.write(opened, left) :]


def _synchronise(folder: Path) -> None:
    """Have the name of a new file survive a loss of power, too."""
    if os.name != "posix":
        return
    opened = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
