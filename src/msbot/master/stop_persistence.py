"""Stores STOP where it survives the master: in a small file and in the database.

Both always get the latest record, and at the start of a master the newer one counts. So STOP still holds after `kill
-9`, after a restore of an older backup (the file is newer) and after a change of computer (the database comes along).
The file is written, synchronised and renamed in a thread of its own: neither a slow disk nor a database that does not
answer delays the STOP itself. Only when the file cannot be written, or other masters share the robot, does the database
have to confirm.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import os
import secrets
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from threading import Condition, Thread

from msbot.pnp import PartStore
from msbot.pnp.emergency_stop import StopRecord
from msbot.runtime.json_reading import read_json
from msbot.runtime.user_folders import state_folder

RESERVED = 3
"""Most file descriptors that writing the file needs at the same time."""
DATABASE_S = 5.0
"""How long the database may take to confirm, when there is no file."""

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


class StopKeeper:
    """Stores one robot's STOP.

    Args:
        store: the robot's database, or memory.
        path: the file; None: there is no file, and the store treats STOP like everything else.
        is_shared: whether another master, perhaps on another computer, may take over the robot: then STOP counts as
            stored only when the database has it.
    """

    def __init__(self, store: PartStore, path: Path | None = None, *, is_shared: bool = False) -> None:
        self._is_shared = is_shared
        self._store = store
        self._path = path
        self._changed = Condition()
        self._waiting: StopRecord | None = None
        self._done: Callable[[StopRecord, str], None] = lambda _record, _trouble: None
        self._thread: Thread | None = None
        self._is_closing = False
        self._reserve = _Reserve()

    def load(self) -> StopRecord:
        """The stored record, the newer one of file and database; an empty one if nobody ever said STOP."""
        kept = self._store.kept_stop() or StopRecord()
        in_file = None if self._path is None else _read(self._path)
        return in_file if in_file is not None and in_file.is_newer_than(kept) else kept

    def keep(self, record: StopRecord, done: Callable[[StopRecord, str], None]) -> None:
        """Have the record stored soon; a later one replaces it.

        Args:
            record: what should hold after a restart.
            done: called with the record and with why it could not be stored ("": it is stored); if there is a file, in
                another thread.
        """
        self._store.keep_stop(record)
        if self._path is None:
            done(record, "")
            return
        with self._changed:
            self._waiting, self._done = record, done
            if self._thread is None:
                self._thread = Thread(target=self._serve, name="msbot STOP keeper", daemon=True)
                self._thread.start()
            self._changed.notify()

    def close(self, timeout_s: float = 2.0) -> None:
        """Store what is waiting, then end the thread."""
        with self._changed:
            self._is_closing = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout_s)
        self._reserve.free()

    def _serve(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._is_closing)
                record, self._waiting = self._waiting, None
                done = self._done
            if record is None:
                return
            trouble = self._store_it(record)
            if trouble:
                _log.warning("%s", trouble)
            done(record, trouble)

    def _write_at_any_price(self, path: Path, record: StopRecord) -> None:
        try:
            _write(path, record)
        except OSError as error:
            if error.errno not in (errno.EMFILE, errno.ENFILE):
                raise
            self._reserve.free()
            try:
                _write(path, record)
            finally:
                self._reserve.fill()

    def _store_it(self, record: StopRecord) -> str:
        """Why the record is stored nowhere, in words; "" = it is."""
        words = "STOP" if record.holds else "the end of STOP"
        assert self._path is not None
        try:
            self._write_at_any_price(self._path, record)
        except OSError as error:
            if self._store.is_kept(DATABASE_S):
                return ""
            return f"{words} is not stored: {self._path} cannot be written ({error.strerror}), nor can the database"
        if self._is_shared and not self._store.is_kept(DATABASE_S):
            return f"{words} is stored on this computer only: a master that takes over does not know of it"
        return ""


class _Reserve:
    """File descriptors reserved for the file of STOP, so that it can be written when the process has no others left."""

    def __init__(self) -> None:
        self._held: list[int] = []
        self.fill()

    def fill(self) -> None:
        """Reserve them again, as far as there are any."""
        try:
            while len(self._held) < RESERVED:
                self._held.append(os.open(os.devnull, os.O_RDONLY))
        except OSError as error:
            _log.debug("no descriptor can be held for STOP: %s", error)

    def free(self) -> None:
        """Release them for the moment."""
        while self._held:
            os.close(self._held.pop())


def _write(path: Path, record: StopRecord) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "w") as stream:
            json.dump(asdict(record), stream)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    if os.name == "posix":
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # so that the new name survives a loss of power, too
        finally:
            os.close(folder)


def _read(path: Path) -> StopRecord | None:
    try:
        content = read_json(path.read_text())
        return StopRecord(
            int(content["number"]), bool(content["holds"]), str(content["by"]), str(content["reason"]),
            int(content["at_ns"]),
        )  # fmt: skip
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        # Nobody knows what it said, so the robot starts stopped.
        _log.warning("%s cannot be read (%s): the robot starts with STOP", path, error)
        return StopRecord(1, True, "msbot", f"the file {path} with the last STOP cannot be read", 0)
