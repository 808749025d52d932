"""How commands look into a robot's database: quickly if possible, else through the registry."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from msbot.registry.quick_look import look_into
from msbot_xrce.errors import RegistryError

if TYPE_CHECKING:
    from msbot.registry import JournalEntry, PartRecord, Registry, RobotRecord


class Look(Protocol):
    """What these commands read."""

    @property
    def database(self) -> str:
        """The database, for messages."""

    def robots(self) -> list[RobotRecord]:
        """All robots, the one with the most recently applied blueprint first."""

    def is_run(self, robot: RobotRecord) -> bool:
        """Whether a master is running this robot now."""

    def slot_names(self, robot: RobotRecord) -> list[str]:
        """The slots of a robot."""

    def parts(self, robot: RobotRecord | None = None) -> list[PartRecord]:
        """All parts that were ever seen, of one robot or of all."""

    def journal(self, limit: int, part: str, robot: RobotRecord | None = None) -> list[JournalEntry]:
        """The newest lines of the journal about a part, of one robot or of all."""


@contextmanager
def looking_at(database: str) -> Iterator[Look]:
    """A database, open for reading.

    Raises:
        RegistryError: it cannot be read; the text says why and what to do.
    """
    quick = look_into(database)
    if quick is not None:
        try:
            with quick:
                yield quick
        except sqlite3.Error as error:
            raise RegistryError(f"the database {database} cannot be read ({error}): look at `msbot db check`") from None
        return
    from msbot.registry import open_registry

    with open_registry(database, read_only=True) as registry:
        yield _ThroughRegistry(registry)


class _ThroughRegistry:
    """A `Look` at whatever the registry can open."""

    def __init__(self, registry: Registry) -> None:
        self.database = registry.database
        self.robots = registry.robots.all
        self.is_run = registry.runs.is_run
        self.slot_names = registry.robots.slot_names
        self.parts = registry.robots.parts
        self._robots = registry.robots

    def journal(self, limit: int, part: str, robot: RobotRecord | None = None) -> list[JournalEntry]:
        """See `Look.journal`."""
        return self._robots.journal(limit, part, robot=robot)
