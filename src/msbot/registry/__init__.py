"""The registry: robots, slots, parts, library and journal in a SQL database; the only room that touches SQL."""

from msbot.errors import RegistryError

try:
    from msbot.registry.database.engine import without_password
    from msbot.registry.database.storage import StorageHealth
    from msbot.registry.edits.user_statements import ROLES
    from msbot.registry.records import (
        EditKind,
        EditRecord,
        JournalEntry,
        KeyRecord,
        PartRecord,
        RobotRecord,
        UserRecord,
        ValueRecord,
    )
    from msbot.registry.registry import Registry, open_registry
    from msbot.registry.running.node_ids import StoredNodeIds
    from msbot.registry.running.robot_store import RobotStore
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
    "PartRecord",
    "Registry",
    "RobotRecord",
    "RobotStore",
    "StorageHealth",
    "StoredNodeIds",
    "UserRecord",
    "ValueRecord",
    "open_registry",
    "without_password",
]
