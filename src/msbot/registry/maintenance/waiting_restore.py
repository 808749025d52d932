"""A backup that a person has handed to a running robot: it waits beside the database until the master restarts.

A database cannot be exchanged under a running robot. What waits is one file, `robot.db.restore`; bringing it back
removes it, and keeps what the database had, as `msbot db restore` does.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from msbot.errors import RegistryError
from msbot.registry.database.engine import make_private, parse_address
from msbot.registry.maintenance import upkeep
from msbot.registry.maintenance.backup_check import check_backup

ENDING = ".restore"


def hold(address: str, backup: Path, *, needs_administrator: bool = True) -> Path:
    """Keep a backup for the next start.

    Args:
        address: the database.
        backup: the file; it stays as it is.
        needs_administrator: refuse one without: where people sign in, nobody could any more.

    Raises:
        RegistryError: it is not a usable backup, the database is not a file, or the folder cannot be written.
    """
    place = _place_of(address)
    if place is None:
        raise RegistryError(
            "a backup goes into a database on a server only while no master runs: `msbot db restore FILE --db ...`"
        )
    with tempfile.TemporaryDirectory(prefix="msbot-held-") as folder:
        copy = Path(folder) / "backup.db"
        try:
            _copy(backup, copy)
            check_backup(copy, needs_administrator=needs_administrator)
            _copy(backup, place)
        except OSError as error:
            raise RegistryError(f"cannot keep the backup at {place}: {error.strerror}") from None
    return place


def bring_back_held(address: str) -> Path | None:
    """Put a waiting backup in force; gives where the old content is kept, None when nothing waited.

    Raises:
        RegistryError: it cannot be brought back; it still waits.
    """
    place = _place_of(address)
    if place is None or not place.exists():
        return None
    kept = upkeep.restore(place, address)
    place.unlink()
    return kept or place


def _copy(source: Path, target: Path) -> None:
    """However large it is, the system copies it: nothing of it is in our memory."""
    make_private(target)
    shutil.copyfile(source, target)


def _place_of(address: str) -> Path | None:
    where = parse_address(address)
    return None if where.path is None else where.path.with_name(where.path.name + ENDING)
