"""Stores STOP where it survives the master: in a small file and in the database.

Both always get the latest record, and at the start of a master the newer one counts. So STOP still holds after `kill
-9`, after a restore of an older backup (the file is newer) and after a change of computer (the database comes along).
Only when the file cannot be written, or other masters share the robot, does the database have to confirm.

Neither a slow disk nor a database that does not answer delays STOP itself: a thread of its own writes. What it needs it
has from the start of the master on: the thread, the open file with its room on the disk (`stop_on_disk`), and memory.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import secrets
import zlib
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from threading import Condition, Thread
from time import monotonic

from msbot.pnp import PartStore
from msbot.pnp.emergency_stop import StopRecord
from msbot_agent.process.user_folders import make_own_folder, state_folder
from msbot_agent.text.sentence import said, whole
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.errors import ConfigError

# The file with STOP: it has all its room on the disk, and is open, from the start of the master on.
#
# So a STOP can be written when the disk is full and when the process can open nothing more. The file has two places of
# the same length. A record goes to the place of the older one, in one write, and is then synchronised; what was cut off
# half way (the power failed) is no record, and as nobody knows what it would have said, it counts as STOP.
#
# A record is a line of JSON, filled up with spaces; a check sum tells whether it is whole. A file from before there
# were places (one record, as short as it is) is read, too.


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
        make_own_folder(self.path.parent)
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


DATABASE_S = 5.0
"""How long the database may take to confirm, when there is no file."""
LOOK_S = 0.25
"""Period in which it is looked, meanwhile, whether something newer is to be stored."""
NO_MEMORY: str = said("STOP is not stored: this computer has no memory left")
SPARE_OCTETS = 1024 * 1024
"""Memory that is set free when the process can get no more."""

_log = logging.getLogger(__name__)


def stop_file(name: str, serial_number: str, database: str, folder: Path | None = None) -> Path:
    """The file with the STOP of one robot of one database, in the folder where this user's programs keep their state.

    Args:
        name: the robot's name.
        serial_number: the robot's serial number.
        database: identifies the database; always the same word for the same one.
        folder: used instead of that folder.
    """
    which = hashlib.sha256("\0".join((name, serial_number, database)).encode()).hexdigest()[:12]
    readable = "".join(char if char.isascii() and char.isalnum() else "-" for char in name[:40])
    return (folder or state_folder()) / "stop" / f"{readable}-{which}.json"


class StopStore:
    """Stores one robot's STOP.

    Args:
        store: the robot's database, or memory.
        path: the file; None: there is no file, and the store treats STOP like everything else.
        is_shared: whether another master, perhaps on another computer, may take over the robot: then STOP counts as
            stored only when the database has it.

    Raises:
        ConfigError: the system gives this process no thread.
    """

    def __init__(self, store: PartStore, path: Path | None = None, *, is_shared: bool = False) -> None:
        self._is_shared = is_shared
        self._store = store
        self._file = None if path is None else StopFile(path)
        self._changed = Condition()
        self._waiting: StopRecord | None = None
        self._done: Callable[[StopRecord, str], None] = lambda _record, _trouble: None
        self._is_closing = False
        self._spare = b""
        self._thread: Thread | None = None
        if self._file is not None:
            self._thread = self._started()

    def load(self) -> StopRecord:
        """The stored record, the newer one of file and database; an empty one if nobody ever said STOP."""
        kept = self._store.kept_stop() or StopRecord()
        if self._file is None:
            return kept
        try:
            in_file = self._file.read()
        except (OSError, BrokenRecord) as error:
            # Nobody knows what it said, so the robot starts stopped.
            _log.warning("%s cannot be read (%s): the robot starts with STOP", self._file.path, error)
            number = max(kept.number, kept.latest, getattr(error, "number", 0)) + 1
            why = said("the file {path} with the last STOP cannot be read", path=str(self._file.path))
            return StopRecord(number, True, "msbot", why, 0)
        return in_file if in_file is not None and in_file.is_newer_than(kept) else kept

    def store(self, record: StopRecord, done: Callable[[StopRecord, str], None]) -> None:
        """Have the record stored soon; a later one replaces it.

        Args:
            record: what should hold after a restart.
            done: called with the record and with why it could not be stored ("": it is stored); if there is a file, in
                another thread.
        """
        self._store.keep_stop(record)
        if self._file is None:
            done(record, "")
            return
        with self._changed:
            self._waiting, self._done = record, done
            self._changed.notify()

    def close(self, timeout_s: float = 2.0) -> None:
        """Store what is waiting, then end the thread."""
        with self._changed:
            self._is_closing = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout_s)

    # The thread

    def _started(self) -> Thread:
        thread = Thread(target=self._serve, name="msbot STOP keeper", daemon=True)
        try:
            thread.start()
        except RuntimeError:
            raise ConfigError(
                said("no thread can be started, and without one STOP cannot be stored: end other programs")
            ) from None
        return thread

    def _serve(self) -> None:
        assert self._file is not None
        self._prepare(self._file)
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._is_closing)
                record, self._waiting = self._waiting, None
                done = self._done
            if record is None:
                break
            self._store_and_tell(self._file, record, done)
        self._file.close()

    def _prepare(self, file: StopFile) -> None:
        """Have everything that the next STOP will need."""
        try:
            self._spare = self._spare or bytes(SPARE_OCTETS)
            file.prepare()
        except (OSError, MemoryError) as error:
            _log.debug("what STOP will need cannot be had now: %s", error)

    def _store_and_tell(self, file: StopFile, record: StopRecord, done: Callable[[StopRecord, str], None]) -> None:
        """Store a record, and say what came of it, whatever happens: the thread is there for the next one, too."""
        trouble: str = NO_MEMORY
        for _ in range(2):
            try:
                trouble = self._store_it(file, record)
                if trouble:
                    _log.warning("%s", trouble)
                break
            except MemoryError:
                self._spare = b""
            except Exception as error:
                _log.exception("STOP could not be stored")
                trouble = said("STOP is not stored: {error}", error=str(error))
                break
        try:
            done(record, trouble)
        except Exception:
            _log.exception("nobody could be told about STOP")
        if not self._spare or trouble:
            self._prepare(file)

    def _store_it(self, file: StopFile, record: StopRecord) -> str:
        """Why the record is stored nowhere, in words; "" = it is."""
        try:
            file.write(record)
        except OSError as error:
            if self._is_in_database():
                return ""
            return said(
                "STOP is not stored: {path} cannot be written ({error}), nor can the database"
                if record.holds
                else "the end of STOP is not stored: {path} cannot be written ({error}), nor can the database",
                path=str(file.path),
                error=error.strerror or type(error).__name__,
            )
        if self._is_shared and not self._is_in_database():
            return said(
                "STOP is stored on this computer only: a master that takes over does not know of it"
                if record.holds
                else "the end of STOP is stored on this computer only: a master that takes over does not know of it"
            )
        return ""

    def _is_in_database(self) -> bool:
        """Whether the database confirms; not waited for when there is a newer record."""
        until = monotonic() + DATABASE_S
        while (now := monotonic()) < until and self._waiting is None:
            if self._store.is_kept(LOOK_S):
                return True
            if monotonic() - now < LOOK_S / 2:  # it has just failed
                return False
        return False
