"""A robot that is not running: operations change its database for its next start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from msbot.config import Library
from msbot.operations.part_names import uid_of
from msbot.pnp import Matcher
from msbot.registry import EditRecord, PartRecord, Registry, RobotRecord
from msbot.registry.edits.editing import Making
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

_T = TypeVar("_T")


class StoredRobot:
    """The database of one robot; no master can start in the meantime.

    Raises:
        RegistryError: a master is running the robot, or the database cannot be used.
    """

    def __init__(self, registry: Registry, robot: RobotRecord) -> None:
        self._registry = registry
        self._robot = robot
        self.store = registry.runs.begin(robot)  # this keeps masters away
        self.matcher = Matcher(self.store)

    @property
    def library(self) -> Library | None:
        """See `ChangeableRobot.library`: the master checks against it when it starts."""
        return None

    def slot_names(self) -> Sequence[str]:
        """See `ChangeableRobot.slot_names`."""
        return self.matcher.names()

    async def read(self, read: Callable[[Registry, RobotRecord], _T]) -> _T:
        """See `ChangeableRobot.read`."""
        return read(self._registry, self._robot)

    async def change(self, who: str, making: Making) -> EditRecord:
        """See `ChangeableRobot.change`."""
        return self._registry.edits.make(self._robot, who, making)

    def parts(self) -> Sequence[PartRecord]:
        """All parts that were ever seen."""
        return self._registry.robots.parts(self._robot)

    def part(self, word: str) -> PartRecord:
        """The one part that a person means, out of all that were ever seen.

        Raises:
            ConfigError: none, or several.
        """
        records = self.parts()
        uid = uid_of(word)
        wanted = word.casefold()
        found = [
            one
            for one in records
            if one.uid and (one.uid == uid or wanted in (one.name.casefold(), one.part_number.casefold()))
        ]
        if len(found) == 1:
            return found[0]
        if found:
            names = "; ".join(
                said("{name} ({part_number}, UID {one})", name=one.name, part_number=one.part_number, one=one.uid.hex())
                for one in found
            )
            raise ConfigError(
                said(
                    "{count} parts are known as {word!r}: name one by its UID: {names}",
                    count=len(found),
                    word=word,
                    names=names,
                )
            )
        raise ConfigError(
            said(
                "no part is known as {word!r}; seen so far: {records}",
                word=word,
                records=", ".join(one.name for one in records) or said("none"),
            )
        )
