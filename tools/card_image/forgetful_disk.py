"""A disk for a virtual machine that forgets, when its power is cut, what it was not told to keep.

It speaks NBD (the fixed newstyle handshake, as qemu does), on a Unix socket. What is written stays in memory until the
machine flushes; at the cut each write since then is kept or lost by chance, sector by sector, as in a card with a
write cache that keeps no order. What was flushed is in the file. A virtual machine alone does not show this: the host's
memory keeps what a killed one has written.

A machine flushes milliseconds after it has written, so a cut at any time hardly ever finds something to lose.
`stop_at` makes the disk say when: in the middle of a write or before a flush, which it then never answers. `leave_at`
makes a file of what would be left then, and the machine goes on.
"""

from __future__ import annotations

import errno
import io
import os
import random
import socket
import struct
import threading
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

SECTOR = 512
_MAGIC, _OPTION = 0x4E42444D41474943, 0x49484156454F5054
_REPLY, _REQUEST, _SIMPLE = 0x3E889045565A9, 0x25609513, 0x67446698
_FIXED, _NO_ZEROES = 1, 2
_EXPORT_NAME, _ABORT, _INFO, _GO = 1, 2, 6, 7
_ACK, _INFO_EXPORT, _UNSUPPORTED = 1, 3, 0x80000001
_HAS_FLAGS, _FLUSHES, _KNOWS_FUA, _ZEROES = 1, 4, 8, 64
_FLAGS = _HAS_FLAGS | _FLUSHES | _KNOWS_FUA | _ZEROES
_READ, _WRITE, _LEAVE, _FLUSH, _WRITE_ZEROES = 0, 1, 2, 3, 6
_FUA = 1
_EINVAL = 22
LARGEST_PIECE = 8 << 20
"""Octets."""
LONGEST = 64 << 20
"""Octets of a request."""


class Moment(Enum):
    """Where a machine is when its power goes."""

    ANY = "any"
    WRITE = "in a write"
    FLUSH = "before a flush"


class ForgetfulDisk:
    """The disk, and its server; one machine at a time.

    Args:
        file: what is kept.
        place: the socket.
        seed: of the chance by which writes are lost.
    """

    def __init__(self, file: Path, place: Path, seed: int) -> None:
        self._file = file.open("r+b", buffering=0)
        self._size = file.stat().st_size
        self._chance = random.Random(seed)
        self._waiting: dict[int, bytes] = {}
        """Sectors that were written and not flushed."""
        self.flushes = self.lost = self.kept = 0
        place.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.bind(str(place))
        self._socket.listen(1)
        self._gone = threading.Event()
        self._stop_at, self._holding = Moment.ANY, 0
        self._stopped, self._may_go_on = threading.Event(), threading.Event()
        self._left: tuple[Path, int] | None = None
        self._thread = threading.Thread(target=self._serve, name="disk", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End; the file has what was flushed."""
        self._socket.close()
        self._file.close()

    def wait_until_cut(self, within_s: float) -> None:
        """Wait until the machine that was killed is gone and its unflushed writes are decided.

        Raises:
            TimeoutError: it still has the disk.
        """
        if not self._gone.wait(within_s):
            raise TimeoutError("the machine still has its disk")
        self._gone.clear()

    def stop_at(self, moment: Moment, holding: int) -> None:
        """Stop answering at such a moment, once this many sectors are written and not flushed; until the next cut."""
        self._left, self._holding, self._stop_at = None, holding, moment

    def leave_at(self, moment: Moment, holding: int, left: Path, start: int) -> None:
        """At such a moment make a file of what would be left, and wait for `go_on`; each sector not flushed by chance.

        Args:
            moment: as for `stop_at`.
            holding: the same.
            left: the file.
            start: where it begins on the disk, in octets.
        """
        self._may_go_on.clear()
        self._stopped.clear()
        self._left, self._holding, self._stop_at = (left, start), holding, moment

    def go_on(self) -> None:
        """Answer again."""
        self._may_go_on.set()

    def wait_until_stopped(self, within_s: float) -> bool:
        """Wait for the moment of `stop_at`; returns whether it came."""
        return self._stopped.wait(within_s)

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            with connection:
                try:
                    if self._shake_hands(connection):
                        self._answer_all(connection)
                except (ConnectionError, EOFError):
                    pass
            self._cut()
            self._gone.set()

    def _cut(self) -> None:
        """The power is gone: chance says for each sector whether it was written."""
        for number in sorted(self._waiting):
            if self._chance.random() < 0.5:
                self._put(number)
                self.kept += 1
            else:
                self.lost += 1
        self._waiting.clear()
        self._stop_at = Moment.ANY
        self._stopped.clear()

    def _put(self, number: int) -> None:
        self._file.seek(number * SECTOR)
        self._file.write(self._waiting[number])

    # The handshake

    def _shake_hands(self, connection: socket.socket) -> bool:
        connection.sendall(struct.pack(">QQH", _MAGIC, _OPTION, _FIXED | _NO_ZEROES))
        (flags,) = struct.unpack(">I", _read(connection, 4))
        while True:
            magic, option, length = struct.unpack(">QII", _read(connection, 16))
            if magic != _OPTION or length > 65_536:
                return False
            _read(connection, length)
            if option == _EXPORT_NAME:
                connection.sendall(struct.pack(">QH", self._size, _FLAGS))
                if not flags & _NO_ZEROES:
                    connection.sendall(bytes(124))
                return True
            if option in (_INFO, _GO):
                info = struct.pack(">HQH", 0, self._size, _FLAGS)
                self._reply(connection, option, _INFO_EXPORT, info)
                self._reply(connection, option, _ACK, b"")
                if option == _GO:
                    return True
            elif option == _ABORT:
                self._reply(connection, option, _ACK, b"")
                return False
            else:
                self._reply(connection, option, _UNSUPPORTED, b"")

    @staticmethod
    def _reply(connection: socket.socket, option: int, kind: int, content: bytes) -> None:
        connection.sendall(struct.pack(">QIII", _REPLY, option, kind, len(content)) + content)

    # Requests

    def _answer_all(self, connection: socket.socket) -> None:
        while True:
            magic, flags, kind, handle, start, length = struct.unpack(">IHHQQI", _read(connection, 28))
            if magic != _REQUEST or kind == _LEAVE:
                return
            whole = start % SECTOR == 0 and length % SECTOR == 0 and length <= LONGEST and start + length <= self._size
            content = b""
            if kind == _WRITE:
                written = _read(connection, length)
                if whole:
                    last = self._ends(Moment.WRITE, length // SECTOR)
                    if last and self._left:
                        self._leave({**self._waiting, **_sectors(start, written)})
                    elif last:  # a part of it may be there, also of one that was to be kept at once
                        self._note(start, written, at_once=False)
                        return self._stop(connection)
                    self._note(start, written, at_once=bool(flags & _FUA))
            elif kind == _WRITE_ZEROES and whole:
                self._note(start, bytes(length), at_once=bool(flags & _FUA))
            elif kind == _FLUSH:
                if self._ends(Moment.FLUSH, 0):
                    if not self._left:
                        return self._stop(connection)
                    self._leave(self._waiting)
                self._flush()
            elif kind == _READ and whole:
                content = self._look(start, length)
            else:
                whole = False
            error = 0 if whole or kind == _FLUSH else _EINVAL
            connection.sendall(struct.pack(">IIQ", _SIMPLE, error, handle) + (b"" if error else content))

    def _ends(self, moment: Moment, more: int) -> bool:
        """Whether the power is to go now, with so many sectors more."""
        return moment is self._stop_at and len(self._waiting) + more >= self._holding

    def _leave(self, waiting: dict[int, bytes]) -> None:
        """Make the file of what would be left, and wait until the machine may go on."""
        assert self._left is not None
        (left, start), self._left, self._stop_at = self._left, None, Moment.ANY
        with left.open("wb") as file:
            file.truncate(self._size - start)
            for place, piece in pieces(self._file, start):
                file.seek(place - start)
                file.write(piece)
            for number, sector in sorted(waiting.items()):
                kept = self._chance.random() < 0.5
                self.kept, self.lost = self.kept + kept, self.lost + (not kept)
                if kept and number * SECTOR >= start:
                    file.seek(number * SECTOR - start)
                    file.write(sector)
        self._stopped.set()
        self._may_go_on.wait()
        self._stopped.clear()

    def _stop(self, connection: socket.socket) -> None:
        """Answer nothing any more, until the machine is gone."""
        self._stopped.set()
        while connection.recv(1 << 16):
            pass

    def _note(self, start: int, content: bytes, *, at_once: bool) -> None:
        """Take a write; `at_once` (FUA): this one is kept, whatever becomes of those before."""
        first, count = start // SECTOR, len(content) // SECTOR
        if at_once:
            self._file.seek(start)
            self._file.write(content)
        if not at_once:
            self._waiting.update(_sectors(start, content))
            return
        for index in range(count):
            self._waiting.pop(first + index, None)

    def _flush(self) -> None:
        for number in sorted(self._waiting):
            self._put(number)
        self._waiting.clear()
        self.flushes += 1

    def _look(self, start: int, length: int) -> bytes:
        self._file.seek(start)
        content = bytearray(self._file.read(length))
        first = start // SECTOR
        if self._waiting:
            for index in range(length // SECTOR):
                if (newer := self._waiting.get(first + index)) is not None:
                    content[index * SECTOR : (index + 1) * SECTOR] = newer
        return bytes(content)


def _sectors(start: int, content: bytes) -> dict[int, bytes]:
    first = start // SECTOR
    return {first + index: content[index * SECTOR : (index + 1) * SECTOR] for index in range(len(content) // SECTOR)}


def pieces(file: io.FileIO, place: int = 0) -> Iterator[tuple[int, bytes]]:
    """What is in a file that may have holes, and where."""
    while True:
        try:
            place = os.lseek(file.fileno(), place, os.SEEK_DATA)
        except OSError as error:
            if error.errno == errno.ENXIO:  # there is no more
                return
            raise
        end = os.lseek(file.fileno(), place, os.SEEK_HOLE)
        while place < end:
            piece = os.pread(file.fileno(), min(LARGEST_PIECE, end - place), place)
            yield place, piece
            place += len(piece)


def _read(connection: socket.socket, length: int) -> bytes:
    got = bytearray()
    while len(got) < length:
        piece = connection.recv(length - len(got))
        if not piece:
            raise EOFError("the machine is gone")
        got += piece
    return bytes(got)
