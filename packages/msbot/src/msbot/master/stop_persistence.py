"""Stores STOP where it survives the master: in a small file and in the database.

Both always get the latest record, and at the start of a master the newer one counts. So STOP still holds after `kill
-9`, after a restore of an older backup (the file is newer) and after a change of computer (the database comes along).
Only when the file cannot be written, or other masters share the robot, does the database have to confirm.

Neither a slow disk nor a database that does not answer delays STOP itself: a thread of its own writes. What it needs it
has from the start of the master on: the thread, the open file with its room on the disk (`stop_on_disk`), and memory.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path
from threading import Condition, Thread
from time import monotonic

from msbot.master.stop_on_disk import BrokenRecord, StopFile
from msbot.pnp import PartStore
from msbot.pnp.emergency_stop import StopRecord
from msbot_agent.process.user_folders import state_folder
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

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


class StopKeeper:
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

    def keep(self, record: StopRecord, done: Callable[[StopRecord, str], None]) -> None:
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
