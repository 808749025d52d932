"""Guards the file of an SQLite database while it is used: somebody may delete or replace it.

SQLite silently goes on writing to a deleted file; everything would be lost when the process ends. So the file is
checked before each transaction: a deleted one is written again from what is still open; a replaced one is not touched,
and the robot's own data are saved beside it.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sqlite3
from contextlib import closing
from pathlib import Path

from sqlalchemy import Engine

from msbot.registry.database.engine import MAGIC, identity_of, in_use, make_private, sqlite_address
from msbot_agent.text.sentence import said
from msbot_xrce.errors import RegistryError

_log = logging.getLogger(__name__)


class DatabaseFile:
    """Guards one file; all methods but the first belong to the writer's thread.

    Args:
        engine: its connections are discarded when the file is written again.
        path: the file, which must exist.
    """

    def __init__(self, engine: Engine, path: Path) -> None:
        self._engine = engine
        self._path = path
        self._rescued: Path | None = None
        self._is_closed = False
        self._open()

    def check(self) -> None:
        """Check that the file is still there; write it again if it was deleted.

        Raises:
            RegistryError: it is not the same file any more; the text says what to do.
        """
        try:
            if identity_of(self._path) != self._known:
                raise RegistryError(self._replaced())
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            if os.read(self._descriptor, len(MAGIC)) != MAGIC:
                raise RegistryError(
                    said(
                        "was overwritten by something else while the robot ran: stop the master, and put "
                        "a backup in its place"
                    )
                )
        except FileNotFoundError:
            self._put_back()
        except OSError as error:
            raise RegistryError(
                said("cannot be reached ({strerror}): look at the disk and its folder", strerror=error.strerror)
            ) from None

    def close(self) -> None:
        """Release the file, after all other connections are closed. A second call does nothing."""
        self._anchor.close()
        if not self._is_closed:
            self._is_closed = True
            self._forget()

    def _forget(self) -> None:
        os.close(self._descriptor)
        in_use[self._known] -= 1

    def _open(self) -> None:
        """Keep one connection open: through it a deleted file can still be read."""
        self._anchor = sqlite3.connect(sqlite_address(self._path), uri=True, check_same_thread=False)
        self._anchor.execute("PRAGMA schema_version").fetchone()
        self._known = identity_of(self._path)
        in_use[self._known] += 1
        self._descriptor = os.open(self._path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        """Stays open as long as any connection does, see `engine.in_use`."""

    def _put_back(self) -> None:
        part = self._path.with_name(f"{self._path.name}.part{os.getpid()}")
        try:
            self._copy(part)
            for ending in ("-wal", "-shm"):  # they belong to the file that is gone
                self._path.with_name(self._path.name + ending).unlink(missing_ok=True)
            part.replace(self._path)
        except (OSError, sqlite3.Error) as error:
            part.unlink(missing_ok=True)
            raise RegistryError(
                said(
                    "was deleted while the robot ran, and cannot be restored ({error}): look at its folder",
                    error=str(error),
                )
            ) from None
        self._anchor.close()
        self._engine.dispose()
        self._forget()
        self._open()
        _log.warning("the database %s was deleted while the robot ran; it is restored with all it had", self._path)

    def _replaced(self) -> str:
        if self._rescued is None:
            number = 1
            while (kept := self._path.with_name(f"{self._path.name}.rescued.{number}")).exists():
                number += 1
            with contextlib.suppress(OSError, sqlite3.Error):
                self._copy(kept)
                self._rescued = kept
        kept_words = "" if self._rescued is None else f"; what the robot had is kept in {self._rescued}"
        return (
            "was replaced by another file while the robot ran: stop the master, and look which of the two is wanted"
            + kept_words
        )

    def _copy(self, target: Path) -> None:
        make_private(target)
        with closing(sqlite3.connect(target)) as copy:
            self._anchor.backup(copy)
