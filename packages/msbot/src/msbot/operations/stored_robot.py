"""A robot that is not running: operations change its database for its next start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from msbot.config import Library
from msbot.operations.operation import Outcome, outcome_of
from msbot.operations.part_names import known_part
from msbot.operations.running_robot import slot_of
from msbot.pnp import Matcher
from msbot.registry import EditRecord, PartRecord, Registry, RobotRecord
from msbot.registry.edits import known_parts, part_places
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
        """The one part that a person means, out of all with a UID that were ever seen.

        Raises:
            ConfigError: none, or several.
        """
        return known_part(word, [one for one in self.parts() if one.uid])


# Which part belongs where in a robot that is not running: it takes effect at the next start.


class StoredPlacement:
    """Stores in the database which part belongs in which slot."""

    def __init__(self, stored: StoredRobot) -> None:
        self._stored = stored

    async def adopt(self, part: str, slot: str | None, who: str) -> Outcome:
        """Make a part belong in a slot; it gets the slot when it joins."""
        if slot is None:
            raise ConfigError(said("no master runs, so it is not known which slots are empty: name one with --slot"))
        record, target = self._stored.part(part), slot_of(self._stored, slot)
        self._check_fits(record, target)
        return outcome_of(await self._stored.change(who, partial(part_places.put, uid=record.uid, slot=target)))

    async def swap(self, slot: str, part: str, who: str) -> Outcome:
        """Make a part belong in a slot, and the part that was there in the slot the first came from."""
        record, target = self._stored.part(part), slot_of(self._stored, slot)
        self._check_fits(record, target)
        there = self._parts_of(target)
        if any(one.uid == record.uid for one in there):
            raise ConfigError(said("{name} belongs in slot {target} already", name=record.name, target=target))
        other = max(there, key=lambda one: one.changed_ns).uid if there else b""
        return outcome_of(
            await self._stored.change(who, partial(part_places.swap, uid=record.uid, slot=target, other=other))
        )

    async def release(self, slot: str, who: str) -> Outcome:
        """Take the part out of a slot: from now on it belongs nowhere."""
        target = slot_of(self._stored, slot)
        there = self._parts_of(target)
        if not there:
            raise ConfigError(said("no part belongs in slot {target}: there is nothing to release", target=target))
        newest = max(there, key=lambda one: one.changed_ns)
        words = said("{part} is released from slot {target}", part=newest.name, target=target)
        return outcome_of(
            await self._stored.change(who, partial(part_places.put, uid=newest.uid, slot=None, words=words))
        )

    async def forget_part(self, part: str, who: str) -> Outcome:
        """Forget a part: when it comes again, it is a new one."""
        known = known_part(part, self._stored.parts())
        return outcome_of(await self._stored.change(who, partial(known_parts.forget, part=known)))

    def _parts_of(self, slot: str) -> list[PartRecord]:
        return [one for one in self._stored.parts() if one.slot == slot and one.uid]

    def _check_fits(self, record: PartRecord, slot: str) -> None:
        matcher = self._stored.matcher
        if not matcher.fits(record.part_number, slot):
            raise ConfigError(
                said(
                    "{name} is a part {part_number}, and slot {slot} takes {expected}: strangers can be adopted while "
                    "the master runs only",
                    name=record.name,
                    part_number=record.part_number,
                    slot=slot,
                    expected=matcher.number_of(slot),
                )
            )
