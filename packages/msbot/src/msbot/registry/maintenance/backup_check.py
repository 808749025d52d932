"""Is an uploaded file a harmless backup of MsBOT? A process with limits finds out.

A file may be damaged, contain a view that never ends, or change who is administrator. So another process opens it, with
little time and memory, and reads every row as the robot would.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from msbot.process.worker import WorkLimits, run_limited
from msbot.registry.database import statements as store
from msbot.registry.database.engine import MAGIC
from msbot.registry.edits.edit_log import read_edits
from msbot.registry.maintenance import consistency
from msbot.registry.records import RobotRecord
from msbot.registry.registry import Registry, open_registry
from msbot.registry.running.robot_memory import read_memory
from msbot_agent.text.given_file import open_given
from msbot_agent.text.sentence import said, without
from msbot_xrce.errors import ConfigError, MsbotError, RegistryError

LIMITS = WorkLimits(cpu_s=30, memory_mb=1024, wall_s=120.0)
"""The largest backup that may be uploaded, of 256 MB, takes some 10 s and 200 MB of memory."""


class UnusableBackup(RegistryError):
    """The file is no backup that could be restored; the text says why."""


def check_backup(path: Path, *, needs_administrator: bool) -> None:
    """Check a file in a process of its own; brings the schema of an older backup up to date.

    Args:
        path: a copy of the file that nobody else uses.
        needs_administrator: refuse a backup with which nobody could log in as administrator.

    Raises:
        UnusableBackup: it cannot be used; the text says why.
    """
    try:
        fault = run_limited(fault_of, LIMITS, str(path), needs_administrator)
    except ConfigError as error:
        raise UnusableBackup(said("this backup is not used: {error}", error=str(error))) from None
    if fault:
        raise UnusableBackup(said("this backup is not used: {fault}", fault=fault))


def fault_of(path: str, needs_administrator: bool) -> str:
    """The worst thing that is wrong with it; empty: nothing."""
    with open_given(Path(path)) as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return said("it is not a database")
    try:
        if strange := _strange(path):
            return strange
        with open_registry(path, create=False) as registry:
            for robot in registry.robots.all():
                _read(registry, robot)
            registry.edits.latest(None, 10_000)
            findings = registry.storage.read(consistency.find)
            if findings:
                return findings[0]
            administrators = [user for user in registry.users.all() if user.role == "administrator"]
            if needs_administrator and not administrators:
                return said("it has no administrator, so nobody could sign in: restore it with `msbot db restore`")
    except MsbotError as error:
        return without(str(error), ("words", "path", "database"), Path(path).name)
    except Exception as error:  # whatever the file contains, nothing of it may reach the robot
        return said("it cannot be read ({kind}: {error})", kind=type(error).__name__, error=str(error))
    return ""


def _strange(path: str) -> str:
    """Anything but tables and indexes: reading such an object could run for ever."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
        query = "SELECT type, name, coalesce(sql, '') FROM sqlite_master"
        for kind, name, sql in connection.execute(query):
            if kind not in ("table", "index") or str(sql).upper().startswith("CREATE VIRTUAL"):
                return said("it has a {kind} {name!r}, and MsBOT makes none of that sort", kind=kind, name=name)
    return ""


def _read(registry: Registry, robot: RobotRecord) -> None:
    """Read all that a master and its pages would read."""
    registry.storage.read(lambda connection: read_memory(connection, robot.id))
    registry.storage.read(lambda connection: store.list_parts(connection, robot.id))
    registry.storage.read(lambda connection: store.read_journal(connection, robot.id, None, 100_000))
    registry.storage.read(lambda connection: read_edits(connection, robot.id, 10_000))
    registry.robots.made_by_hand(robot)
