"""The registry: robots, slots, parts, library and journal in a SQL database; the only room that uses SQL."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot.process.daemon_threads import load_lazily
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot.registry.database.engine import without_password
    from msbot.registry.database.storage import StorageHealth
    from msbot.registry.edits.users import ROLES
    from msbot.registry.records import (
        EditKind,
        EditRecord,
        JournalEntry,
        KeyRecord,
        PartRecord,
        ProgramRecord,
        ProgramSource,
        ProgramVersion,
        RobotRecord,
        UserRecord,
        ValueRecord,
    )
    from msbot.registry.registry import Registry, open_registry
    from msbot.registry.running.master_lease import LeaseLost, MasterLease, check_shareable
    from msbot.registry.running.robot_store import RobotStore, StoredNodeIds

load_lazily("sqlalchemy.dialects.sqlite.aiosqlite")  # comes with the dialect of SQLite, and nobody here uses it

_NAMES = {
    "msbot.registry.database.engine": ("without_password",),
    "msbot.registry.database.storage": ("StorageHealth",),
    "msbot.registry.edits.users": ("ROLES",),
    "msbot.registry.records": (
        "EditKind",
        "EditRecord",
        "JournalEntry",
        "KeyRecord",
        "PartRecord",
        "ProgramRecord",
        "ProgramSource",
        "ProgramVersion",
        "RobotRecord",
        "UserRecord",
        "ValueRecord",
    ),
    "msbot.registry.registry": (
        "Registry",
        "open_registry",
    ),
    "msbot.registry.running.master_lease": (
        "LeaseLost",
        "MasterLease",
        "check_shareable",
    ),
    "msbot.registry.running.robot_store": (
        "RobotStore",
        "StoredNodeIds",
    ),
}

_find = lazy_face(__name__, _NAMES)


def __getattr__(name: str) -> object:
    try:
        return _find(name)
    except ModuleNotFoundError as error:
        if error.name != "sqlalchemy":
            raise
        raise RegistryError("the database needs SQLAlchemy and Alembic: pip install 'msbot[master]'") from None


__all__ = [
    "ROLES",
    "EditKind",
    "EditRecord",
    "JournalEntry",
    "KeyRecord",
    "LeaseLost",
    "MasterLease",
    "PartRecord",
    "ProgramRecord",
    "ProgramSource",
    "ProgramVersion",
    "Registry",
    "RobotRecord",
    "RobotStore",
    "StorageHealth",
    "StoredNodeIds",
    "UserRecord",
    "ValueRecord",
    "check_shareable",
    "open_registry",
    "without_password",
]
