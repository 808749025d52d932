"""A backup uploaded to a running robot: it waits beside the database until the master restarts.

A database cannot be replaced under a running robot. The waiting backup is one file, `robot.db.restore`; restoring it
removes the file and keeps a copy of the old content, as `msbot db restore` does.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from msbot.registry.database.engine import make_private, parse_address
from msbot.registry.maintenance import database_maintenance
from msbot.registry.maintenance.database_maintenance import UnusableBackup, check_backup
from msbot_agent.text.sentence import said
from msbot_xrce.errors import RegistryError

ENDING = ".restore"


def hold(address: str, backup: Path, *, needs_administrator: bool = True) -> Path:
    """Keep a backup for the next start.

    Args:
        address: the database.
        backup: the file; it is not changed.
        needs_administrator: refuse a backup without one: if log-in is required, nobody could log in any more.

    Raises:
        RegistryError: it is not a usable backup, the database is not a file, or the folder cannot be written.
    """
    place = _place_of(address)
    if place is None:
        raise RegistryError(
            said(
                "a backup goes into a database on a server only while no master runs: `msbot db restore FILE --db ...`"
            )
        )
    with tempfile.TemporaryDirectory(prefix="msbot-held-") as folder:
        copy = Path(folder) / "backup.db"
        try:
            _copy(backup, copy)
            check_backup(copy, needs_administrator=needs_administrator)
            _put(copy, place)
        except OSError as error:
            raise RegistryError(
                said("cannot keep the backup at {place}: {strerror}", place=place, strerror=error.strerror)
            ) from None
    return place


def bring_back_held(address: str) -> Path | None:
    """Restore a waiting backup; returns where the old content is kept, None when nothing was waiting.

    Raises:
        RegistryError: it cannot be restored; it keeps waiting.
    """
    place = _place_of(address)
    if place is None or not place.exists():
        return None
    try:
        kept = database_maintenance.restore(place, address)
    except UnusableBackup as error:
        raise RegistryError(
            said(
                "{place} waits to be restored: {error}; move it away to start without it", place=place, error=str(error)
            )
        ) from None
    place.unlink()
    return kept or place


def _put(source: Path, place: Path) -> None:
    """Put a file in its place, whole or not at all: the next start would stumble over half of one.

    What is kept is the copy that was checked: a master that ends meanwhile clears the one that was handed in away.
    """
    beside = place.with_name(f"{place.name}.new")
    try:
        _copy(source, beside)
        os.replace(beside, place)
    finally:
        beside.unlink(missing_ok=True)


def _copy(source: Path, target: Path) -> None:
    """Copy a file; the operating system does it, so that even a large file takes none of our memory."""
    make_private(target)
    shutil.copyfile(source, target)


def _place_of(address: str) -> Path | None:
    where = parse_address(address)
    return None if where.path is None else where.path.with_name(where.path.name + ENDING)
