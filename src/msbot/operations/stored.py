"""The operations of a robot that does not run: what can be changed in its database, for its next start."""

from __future__ import annotations

from collections.abc import Sequence

from msbot.errors import ConfigError
from msbot.operations.naming import one_slot, uid_of
from msbot.operations.outcome import Outcome, outcome_of
from msbot.operations.running import one_parameter, read_endpoint
from msbot.pnp import Matcher
from msbot.registry import EditRecord, PartRecord, Registry, RobotRecord, ValueRecord


class StoredOperations:
    """Like `Operations`, on the database alone; nobody else runs the robot meanwhile.

    Args:
        registry: the database.
        robot: which robot of it.

    Raises:
        RegistryError: a master runs the robot, or the database cannot be used.
    """

    def __init__(self, registry: Registry, robot: RobotRecord) -> None:
        self._registry = registry
        self._robot = robot
        self._store = registry.store_for(robot)  # which is what keeps masters away
        self._matcher = Matcher(self._store)

    def adopt(self, part: str, slot: str | None = None, *, who: str) -> Outcome:
        """See `Operations.adopt`; the part gets the slot when it comes."""
        if slot is None:
            raise ConfigError("no master runs, so it is not known which slots are empty: name one with --slot")
        record, target = self._part(part), self._slot(slot)
        self._check_fits(record, target)
        edit = self._registry.place(self._robot, record.uid, target, who)
        return outcome_of(edit)

    def swap(self, slot: str, to_part: str, *, who: str) -> Outcome:
        """See `Operations.swap`."""
        record, target = self._part(to_part), self._slot(slot)
        self._check_fits(record, target)
        there = [one for one in self._registry.parts(self._robot) if one.slot == target and one.uid]
        if any(one.uid == record.uid for one in there):
            raise ConfigError(f"{record.name} belongs in slot {target} already")
        other = max(there, key=lambda one: one.changed_ns).uid if there else b""
        return outcome_of(self._registry.place_swap(self._robot, record.uid, target, who, other=other))

    def release(self, slot: str, *, who: str) -> Outcome:
        """See `Operations.release`; the part that belonged there belongs nowhere from now on."""
        target = self._slot(slot)
        there = [one for one in self._registry.parts(self._robot) if one.slot == target and one.uid]
        if not there:
            raise ConfigError(f"no part belongs in slot {target}: there is nothing to release")
        newest = max(there, key=lambda one: one.changed_ns)
        words = f"{newest.name} is released from slot {target}"
        return outcome_of(self._registry.place(self._robot, newest.uid, None, who, words=words))

    def block(self, part_or_number: str, reason: str, *, who: str) -> Outcome:
        """See `Operations.block`."""
        kind, key = self._block_key(part_or_number)
        return outcome_of(self._registry.block(self._robot, kind, key, reason, who))

    def unblock(self, part_or_number: str, *, who: str) -> Outcome:
        """See `Operations.unblock`."""
        kind, key = self._block_key(part_or_number)
        uid, number = (bytes.fromhex(key), "") if kind == "uid" else (b"", key)
        if self._store.blocked(uid, number) is None:
            raise ConfigError(f"{part_or_number} is not blocked")
        return outcome_of(self._registry.unblock(self._robot, kind, key, who))

    def values(self, slot: str) -> Sequence[ValueRecord]:
        """See `Operations.values`."""
        return self._registry.values(self._robot, self._slot(slot))

    def set_value(self, slot: str, parameter: str, value_text: str, *, who: str) -> Outcome:
        """See `Operations.set_value`."""
        target = self._slot(slot)
        found = one_parameter(self.values(target), target, parameter)
        value = found.read(value_text)
        return outcome_of(self._registry.set_value(self._robot, target, found.name, value, who))

    def reset_value(self, slot: str, parameter: str, *, who: str) -> Outcome:
        """See `Operations.reset_value`."""
        target = self._slot(slot)
        found = one_parameter(self.values(target), target, parameter)
        if found.origin != "hand":
            raise ConfigError(f"{found.name} of {target} is not set by hand: its value is the {found.origin}'s")
        return outcome_of(self._registry.set_value(self._robot, target, found.name, None, who))

    def bind(
        self, topic: str, type_name: str, source: str | None, targets: Sequence[str] = (), *,
        reliable: bool = True, who: str,
    ) -> Outcome:  # fmt: skip
        """See `Operations.bind`."""
        slots = self._matcher.names()
        edit = self._registry.bind(
            self._robot,
            topic,
            who,
            type_name=type_name,
            source=None if source is None else read_endpoint(source, slots),
            targets=[read_endpoint(target, slots) for target in targets],
            reliable=reliable,
        )
        return outcome_of(edit)

    def unbind(self, topic: str, endpoint: str | None = None, *, who: str) -> Outcome:
        """See `Operations.unbind`."""
        port = None if endpoint is None else read_endpoint(endpoint, self._matcher.names())
        return outcome_of(self._registry.unbind(self._robot, topic, port, who))

    def undo(self, edit_id: int | None = None, *, who: str) -> Outcome:
        """See `Operations.undo`."""
        return outcome_of(self._registry.undo(self._robot, edit_id, who))

    def edits(self, limit: int = 50) -> Sequence[EditRecord]:
        """See `Operations.edits`."""
        return self._registry.edits(self._robot, limit)

    def _slot(self, name: str) -> str:
        return one_slot(name, self._matcher.names())

    def _part(self, word: str) -> PartRecord:
        """The one part that a person means, of all that were ever seen."""
        records = self._registry.parts(self._robot)
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
            names = "; ".join(f"{one.name} ({one.part_number}, UID {one.uid.hex()})" for one in found)
            raise ConfigError(f"{len(found)} parts are known as {word!r}: name one by its UID: {names}")
        raise ConfigError(
            f"no part is known as {word!r}; seen so far: {', '.join(one.name for one in records) or 'none'}"
        )

    def _check_fits(self, record: PartRecord, slot: str) -> None:
        if not self._matcher.fits(record.part_number, slot):
            raise ConfigError(
                f"{record.name} is a part {record.part_number}, and slot {slot} takes "
                f"{self._matcher.number_of(slot)}: strangers can be adopted while the master runs only"
            )

    def _block_key(self, word: str) -> tuple[str, str]:
        numbers = {one.part_number for one in self._registry.parts(self._robot)}
        if word in numbers or self._store.part_type(word) is not None:
            return "number", word
        uid = uid_of(word) or self._part(word).uid
        return "uid", uid.hex()
