"""Undoing changes, and showing what was changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from msbot.operations.operation import Outcome, outcome_of
from msbot.operations.placement import Placement
from msbot.operations.rights import Principal, Right
from msbot.operations.running_robot import ChangeableRobot, RunningRobot
from msbot.registry import EditRecord
from msbot.registry.edits.undo import undo
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

NEAR_EDITS = 50
"""Among this many edits there is nearly always one that can be undone."""
ALL_EDITS = 10_000
"""More edits than are kept."""


class StoredUndoing:
    """Undoes changes in the database of any robot."""

    def __init__(self, robot: ChangeableRobot) -> None:
        self._robot = robot

    async def read(self, limit: int) -> Sequence[EditRecord]:
        """What people changed recently, the newest first.

        Raises:
            ConfigError: there is no database.
            RegistryError: it cannot be read.
        """
        return await self._robot.read(lambda registry, robot: registry.edits.latest(robot, limit))

    async def edits(self, limit: int) -> Outcome:
        """The same, as JSON."""
        return Outcome(answer={"edits": [_as_json(edit) for edit in await self.read(limit)]})

    async def undo(self, edit: int | None, who: str) -> Outcome:
        """Undo a change: the newest that is not undone, if none is given."""
        return outcome_of(await self._robot.change(who, partial(undo, number=edit)))

    async def check_own(self, asker: Principal, right: Right, arguments: Mapping[str, object]) -> EditRecord:
        """Let a person without that right undo only their own settings; returns what would be undone.

        Raises:
            ConfigError: there is no such change; or what `asker.require` raises.
        """
        number = arguments["edit"]
        found = next((one for one in await self.read(200) if one.can_be_undone and number in (None, one.id)), None)
        if found is None:
            raise ConfigError(said("there is no such change that could be undone"))
        if found.who != asker.name or found.kind != "value" or found.at_ns < asker.since_ns:
            asker.require(right)
        return found


class Undoing(StoredUndoing):
    """The same in a running robot, whose parts follow the change."""

    def __init__(self, running: RunningRobot, placement: Placement) -> None:
        super().__init__(running)
        self._running = running
        self._placement = placement

    async def undo(self, edit: int | None, who: str) -> Outcome:
        """Undo a change: the newest that is not undone, if none is given.

        Raises:
            ConfigError: there is none, it was changed again since, or a part that should come back is not plugged in.
            RegistryError: it cannot be stored; nothing has changed.
        """
        if (meant := await self._meant(edit)) is not None:
            self._placement.check_undo(meant)
        inventory = self._running.inventory
        registry, robot = self._running.database()
        made = await registry.edits.make_soon(robot, who, partial(undo, number=edit))
        inventory.reload(self._running.now())
        inventory.blocks_changed(self._running.now())
        slots = inventory.slots.names()
        self._running.configure(slot for slot in made.slots if slot in slots)
        self._placement.follow(made, who)
        return outcome_of(made)

    async def _meant(self, number: int | None) -> EditRecord | None:
        """The edit that an undo is about."""
        newest = next(iter(await self.read(1)), None)
        if newest is None:
            return None
        if number is not None:  # numbers count up, so it cannot be further back than that
            near = await self.read(max(1, newest.id - number + 1))
            return next((edit for edit in near if edit.id == number), None)
        for limit in (NEAR_EDITS, ALL_EDITS):
            found = next((edit for edit in await self.read(limit) if edit.can_be_undone), None)
            if found is not None:
                return found
        return None


def _as_json(edit: EditRecord) -> dict[str, object]:
    return {
        "id": edit.id,
        "at_ns": edit.at_ns,
        "who": edit.who,
        "kind": edit.kind,
        "slot": edit.slot,
        "words": edit.words,
        "undone": edit.undone,
        "can_be_undone": edit.is_kept and not edit.undone,
    }
