"""Facts about the database and its backups."""

from __future__ import annotations

import time
from pathlib import Path

from msbot.doctor.collectors.machine_facts import database_of
from msbot.doctor.facts import DatabaseFacts
from msbot.doctor.finding import Examined
from msbot_agent.text.untrusted_input import read_system_file
from msbot_xrce.errors import RegistryError

NETWORK_DRIVES = ("nfs", "nfs4", "cifs", "smb3", "smbfs", "fuse.sshfs", "9p", "afs", "davfs", "vboxsf")


def database(patient: Examined) -> DatabaseFacts:
    """The database."""
    from msbot.registry import without_password
    from msbot.registry.maintenance.health import look_at_health

    address = database_of(patient)
    try:
        health = look_at_health(address)
    except RegistryError as error:
        return DatabaseFacts(without_password(address), schema=0, newest_schema=0, unopened=str(error))
    now_s = time.time()
    folder = patient.backup_folder
    newest = newest_backup_s(folder, health.path) if folder is not None and health.path is not None else None
    return DatabaseFacts(
        name=health.words,
        schema=health.schema,
        newest_schema=health.newest_schema,
        size_mb=health.size_mb,
        log_mb=health.log_mb,
        is_locked=health.is_locked,
        others_may_read=health.others_may_read,
        network_drive="" if health.path is None else network_drive(health.path, mounts()),
        faults=health.faults,
        backups="" if folder is None else str(folder),
        backup_age_s=None if newest is None else now_s - newest,
        age_s=0.0 if health.oldest_ns is None else now_s - health.oldest_ns / 1e9,
    )


def newest_backup_s(folder: Path, database: Path) -> float | None:
    """When the newest copy of a database was written, by the folder; None: there is none."""
    if not folder.is_dir():
        return None
    times = [path.stat().st_mtime for path in folder.glob(f"{database.stem}*.db") if path != database.absolute()]
    return max(times, default=None)


def mounts() -> list[tuple[str, str]]:
    """`(folder, kind)` of every file system; empty where the system does not tell."""
    table = Path("/proc/mounts")
    if not table.exists():
        return []
    rows = [line.split() for line in read_system_file(table).splitlines()]
    return [(row[1].replace("\\040", " "), row[2]) for row in rows if len(row) > 2]


def network_drive(path: Path, table: list[tuple[str, str]]) -> str:
    """The kind of the file system that a file is on, when it is on another computer; else empty."""
    folders = {str(folder) for folder in path.absolute().parents}
    on = max((row for row in table if row[0] in folders), key=lambda row: len(row[0]), default=("", ""))
    return on[1] if on[1] in NETWORK_DRIVES else ""
