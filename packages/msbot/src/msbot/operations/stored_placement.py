"""Which part belongs where in a robot that is not running: it takes effect at the next start."""

from __future__ import annotations

from functools import partial

from msbot.operations.changeable_robot import slot_of
from msbot.operations.outcome import Outcome, outcome_of
from msbot.operations.stored_robot import StoredRobot
from msbot.registry import PartRecord
from msbot.registry.edits import part_places as places
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


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
        return outcome_of(await self._stored.change(who, partial(places.put, uid=record.uid, slot=target)))

    async def swap(self, slot: str, part: str, who: str) -> Outcome:
        """Make a part belong in a slot, and the part that was there in the slot the first came from."""
        record, target = self._stored.part(part), slot_of(self._stored, slot)
        self._check_fits(record, target)
        there = self._parts_of(target)
        if any(one.uid == record.uid for one in there):
            raise ConfigError(said("{name} belongs in slot {target} already", name=record.name, target=target))
        other = max(there, key=lambda one: one.changed_ns).uid if there else b""
        return outcome_of(
            await self._stored.change(who, partial(places.swap, uid=record.uid, slot=target, other=other))
        )

    async def release(self, slot: str, who: str) -> Outcome:
        """Take the part out of a slot: from now on it belongs nowhere."""
        target = slot_of(self._stored, slot)
        there = self._parts_of(target)
        if not there:
            raise ConfigError(said("no part belongs in slot {target}: there is nothing to release", target=target))
        newest = max(there, key=lambda one: one.changed_ns)
        words = said("{newest} is released from slot {target}", newest=newest.name, target=target)
        return outcome_of(await self._stored.change(who, partial(places.put, uid=newest.uid, slot=None, words=words)))

    def _parts_of(self, slot: str) -> list[PartRecord]:
        return [one for one in self._stored.parts() if one.slot == slot and one.uid]

    def _check_fits(self, record: PartRecord, slot: str) -> None:
        matcher = self._stored.matcher
        if not matcher.fits(record.part_number, slot):
            raise ConfigError(
                said(
                    "{name} is a part {part_number}, and slot {slot} takes {slot2}: strangers can be adopted while the "
                    "master runs only",
                    name=record.name,
                    part_number=record.part_number,
                    slot=slot,
                    slot2=matcher.number_of(slot),
                )
            )
