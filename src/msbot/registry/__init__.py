"""The registry: robots, slots, parts, library and journal in a SQL database; the only room that touches SQL."""

from importlib.util import find_spec

from msbot.errors import RegistryError

for _needed in ("sqlalchemy", "alembic"):
    if find_spec(_needed) is None:
        raise RegistryError(f"the database needs {_needed}: pip install 'msbot[master]'")

from msbot.registry.node_ids import StoredNodeIds
from msbot.registry.records import JournalEntry, PartRecord, RobotRecord
from msbot.registry.registry import Registry, open_registry
from msbot.registry.robot_store import RobotStore

__all__ = [
    "JournalEntry",
    "PartRecord",
    "Registry",
    "RobotRecord",
    "RobotStore",
    "StoredNodeIds",
    "open_registry",
]
