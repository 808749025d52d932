"""Applies a changed blueprint while the robot is running."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from msbot.config import Blueprint, Library, Slot, blueprint_toml, open_blueprint, parse_blueprint
from msbot.config.blueprint.blueprint_model import NOBODY
from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot, slot_of
from msbot.process.worker_pool import WorkerPool
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class BlueprintChange:
    """Changes the running robot to match another blueprint."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._workshop = WorkerPool()

    async def apply(self, path: str, folders: Sequence[str], who: str) -> Outcome:
        """Apply a blueprint file, checked against MsBOT's own library and the folders."""
        blueprint, library = await self._workshop.run(open_blueprint, Path(path), *(Path(folder) for folder in folders))
        return await self.put_in_force(blueprint, library, who=who)

    async def add_slot(self, slot: str, part: str, description: str, who: str) -> Outcome:
        """Give the robot another slot, for parts of that number."""
        if slot in self._running.slot_names():
            raise ConfigError(said("there is a slot {slot} already: choose another name", slot=slot))
        present = await self.present()
        made = Slot(slot, part, description=description)
        return await self._checked(replace(present, slots=(*present.slots, made)), who, slot)

    async def remove_slot(self, slot: str, who: str) -> Outcome:
        """Remove a slot and its ends of topics from the robot; the part in it is delisted."""
        target = slot_of(self._running, slot)
        return await self._checked(without_slot(await self.present(), target), who, target)

    async def present(self) -> Blueprint:
        """The blueprint as it was last applied; what was changed by hand stays anyway."""
        registry, robot = self._running.database()
        return await registry.storage.in_time(partial(registry.robots.blueprint, robot, by_hand=False))

    async def _checked(self, wanted: Blueprint, who: str, slot: str) -> Outcome:
        """Apply a blueprint in which a person has made a slot, or taken it out; checked like a file."""
        library = self._running.library
        if library is None:
            raise ConfigError(said("this robot was started without its library: it cannot take another blueprint"))
        checked = await self._workshop.run(parse_blueprint, blueprint_toml(wanted), library)
        return await self.put_in_force(checked, who=who, slot_by_hand=slot)

    async def put_in_force(
        self, blueprint: Blueprint, library: Library | None = None, *, who: str, slot_by_hand: str = ""
    ) -> Outcome:
        """Apply a blueprint; parts whose slot is gone are delisted.

        Args:
            blueprint: what the robot is from now on.
            library: the part types that it was checked against, if they are not those that the robot was started with.
            who: the person who decides.
            slot_by_hand: the slot that this person makes or takes out thereby.

        Raises:
            ConfigError: it is the blueprint of another robot, or there is no library or no database.
            RegistryError: it cannot be stored; nothing has changed.
        """
        running, inventory = self._running, self._running.inventory
        registry, robot = running.database()
        types = library or running.library
        if types is None:
            raise ConfigError(said("this robot was started without its library: it cannot take another blueprint"))
        profile = blueprint.robot
        if (profile.name, profile.serial_number) != (robot.name, robot.serial_number):
            raise ConfigError(
                said(
                    "this is the blueprint of {profile} {serial_number}, and the robot that runs is {robot} "
                    "{other_number}: start another master for the other one",
                    profile=profile.name,
                    serial_number=profile.serial_number,
                    robot=robot.name,
                    other_number=robot.serial_number,
                )
            )
        change = partial(registry.robots.change_blueprint, blueprint, types, who, slot_by_hand=slot_by_hand)
        _, edit = await registry.storage.in_time(change)
        read_again = _other_types(running.library, types)
        running.use_library(types)
        before, running.master.blueprint = running.master.blueprint, blueprint
        inventory.reload(running.now())
        running.configure(running.slot_names())
        if edit is None and read_again:
            return Outcome(said("part types that hold from now on: {types}", types=", ".join(read_again)))
        if edit is None:
            return Outcome(said("the blueprint changes nothing"))
        words = edit.words
        here = replace(before.robot, stop_group=blueprint.robot.stop_group)  # which holds at once
        if (before.timing, here, before.options) != (blueprint.timing, blueprint.robot, blueprint.options):
            later = said("profile, timing and options hold from the master's next start on")
            words = said("{words}; {later}", words=words, later=later)
        return Outcome(words, edit.id)


def _other_types(old: Library | None, new: Library) -> list[str]:
    """The numbers of part types that are new, gone or different, wherever their files are."""
    before = {} if old is None else {one.number: replace(one, source="") for one in old}
    after = {one.number: replace(one, source="") for one in new}
    return sorted(number for number in before.keys() | after.keys() if before.get(number) != after.get(number))


def without_slot(blueprint: Blueprint, name: str) -> Blueprint:
    """A blueprint without a slot and its ends of topics; a topic that no longer connects anything is removed, too."""
    bindings = []
    for binding in blueprint.bindings:
        source = NOBODY if binding.source.slot == name else binding.source
        targets = tuple(target for target in binding.targets if target.slot != name)
        if source.slot or targets:
            bindings.append(replace(binding, source=source, targets=targets))
    slots = tuple(slot for slot in blueprint.slots if slot.name != name)
    return replace(blueprint, slots=slots, bindings=tuple(bindings))
