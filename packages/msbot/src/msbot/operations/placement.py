"""Which part is in which slot, as people decide: adopt, swap, release, the adoption window, and undoing all that."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from msbot.operations.described_parts import DescribedPartAdoption
from msbot.operations.operation import Outcome, outcome_of
from msbot.operations.part_names import describe, known_part
from msbot.operations.running_robot import RunningRobot, slot_of
from msbot.pnp import Claim, Match, PartEvent, PartInfo, PartState, Refusal, TakeOver
from msbot.registry import EditKind, EditRecord, PartRecord, Registry, RobotRecord
from msbot.registry.edits import known_parts, part_places
from msbot.registry.edits.editing import Making
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, RegistryError

# The adoption window: for a while, a person lets in parts that the library would turn away. Pure.


LONGEST_WINDOW_S = 3600.0


class AdoptionWindow:
    """One adoption window, closed at first."""

    def __init__(self) -> None:
        self.slot: str | None = None
        """The slot that the next newcomer gets automatically; None: none, a person names part and slot."""
        self.who = ""
        """Who opened it."""
        self._until: float | None = None

    def open(self, seconds: float, slot: str | None, who: str, now: float) -> None:
        """Open it, or open it again.

        Raises:
            ConfigError: the time is out of range.
        """
        if not 1.0 <= seconds <= LONGEST_WINDOW_S:
            raise ConfigError(
                said(
                    "an adoption window of {seconds:g} s: it must be 1 to {longest_window_s:g} s",
                    seconds=seconds,
                    longest_window_s=LONGEST_WINDOW_S,
                )
            )
        self._until, self.slot, self.who = now + seconds, slot, who

    def close(self) -> None:
        """Close it; does nothing when it is closed."""
        self._until, self.slot = None, None

    def remaining_s(self, now: float) -> float:
        """How long it stays open; 0 = closed."""
        return 0.0 if self._until is None else max(0.0, self._until - now)


ITSELF = "msbot"
"""The author of what nobody asked for: a spare that takes over."""

_log = logging.getLogger(__name__)

_NOT_YET = {
    PartState.NEW: "has not said yet what it is",
    PartState.CHECKING: "is being checked: try again in a moment",
}
_ADOPTABLE = (None, Refusal.NO_SLOT, Refusal.UNKNOWN_PART, Refusal.WRONG_ROBOT)


def _stored_parts(registry: Registry, robot: RobotRecord) -> Sequence[PartRecord]:
    registry.storage.catch_up()
    return registry.robots.parts(robot)


def _is_same(info: PartInfo, known: PartRecord) -> bool:
    if info.uid or known.uid:
        return info.uid == known.uid
    return (info.part_number, info.local_name) == (known.part_number, known.local_name)


class Placement:
    """Moves the parts of one running robot.

    Every method raises ConfigError when the move is impossible and RegistryError when it cannot be stored; then nothing
    has changed.
    """

    def __init__(self, running: RunningRobot, described: DescribedPartAdoption) -> None:
        self._running = running
        self._described = described
        self._inventory = running.inventory
        self._window = AdoptionWindow()
        self._newcomers: dict[bytes, tuple[str, str]] = {}
        """UIDs that the window lets in -> their slot and who opened it; stored as soon as they are in."""
        self._inventory.set_adopter(self._adopt_newcomer)
        self._inventory.on_event(self._part_changed)
        self._inventory.on_take_over(self._taken_over)

    async def adopt(self, part: str, slot: str | None, who: str) -> Outcome:
        """Put a standby part, or one that the library does not know, into an empty slot.

        A part that says what it is gets a part type and a slot of its own, unless a slot that there is was named. If it
        was adopted so and is in its slot, it is asked what it is now.
        """
        info = self._running.part(part, prefer=lambda one: not one.state.is_registered)
        self._check_movable(info)
        if info.says is not None and slot not in self._running.slot_names():
            if info.says.fault:
                raise ConfigError(
                    said("what {part} says of itself is refused: {fault}", part=info.part, fault=info.says.fault)
                )
            return await self._described.make_type(info, slot, who)
        if slot in (None, info.slot) and info.slot is not None and info.state.is_registered:
            if self._described.has_described(info):
                return await self._described.adopt_anew(info, info.slot, who)
            raise ConfigError(said("{part} is in slot {target} already", part=info.part, target=info.slot))
        target = self._empty_slot_for(info) if slot is None else slot_of(self._running, slot)
        holder = self._running.holder(target)
        if holder is not None and holder.client_key == info.client_key:
            raise ConfigError(said("{part} is in slot {target} already", part=info.part, target=target))
        if holder is not None:
            raise ConfigError(
                said(
                    "slot {target} is held by {holder}: to change the two, `msbot swap {target} --to {part}`",
                    target=target,
                    holder=describe(holder),
                    part=part,
                )
            )
        self._check_fits(info, target)
        words = said(
            "{part} ({part_number}) is adopted into slot {target}",
            part=info.part,
            part_number=info.part_number,
            target=target,
        )
        edit = await self._store(who, partial(part_places.put, uid=info.uid, slot=target, words=words))
        self._move({info.client_key: target}, said("{who} adopted it into slot {target}", who=who, target=target))
        return outcome_of(edit, words)

    async def swap(self, slot: str, part: str, who: str) -> Outcome:
        """Put a part into a slot in place of the one that holds it, which gets the other's slot, or stands by."""
        target = slot_of(self._running, slot)
        holder = self._running.holder(target)
        if holder is None:
            return await self.adopt(part, target, who)
        info = self._running.part(part, prefer=lambda one: one.client_key != holder.client_key)
        if info.client_key == holder.client_key:
            raise ConfigError(
                said(
                    "{part} is in slot {target} already: name the part that is to take its place",
                    part=info.part,
                    target=target,
                )
            )
        self._check_movable(info)
        self._check_fits(info, target)
        old_slot = info.slot if info.state.is_registered else None
        moves: dict[int, str | None] = {info.client_key: target}
        names: dict[str, object] = {"part": info.part, "slot": target, "holder": holder.part}
        if old_slot is None:
            words = said("{part} takes slot {slot} in place of {holder}, which stands by", **names)
        else:
            self._check_fits(holder, old_slot)
            moves[holder.client_key] = old_slot
            words = said(
                "{part} takes slot {slot} in place of {holder}, which goes to slot {old}", old=old_slot, **names
            )
        edit = await self._store(who, partial(part_places.swap, uid=info.uid, slot=target, other=holder.uid))
        self._move(moves, said("{who} swapped slot {target} to {part}", who=who, target=target, part=info.part))
        return outcome_of(edit, words)

    async def release(self, slot: str, who: str) -> Outcome:
        """Take the part out of a slot; it stands by, and a spare gets the slot."""
        target = slot_of(self._running, slot)
        holder = self._running.holder(target)
        if holder is None:
            raise ConfigError(said("slot {target} is empty: there is nothing to release", target=target))
        words = said("{holder} is released from slot {target}", holder=holder.part, target=target)
        edit = None
        if holder.uid:
            edit = await self._store(who, partial(part_places.put, uid=holder.uid, slot=None, words=words))
        self._move({holder.client_key: None}, said("{who} released slot {target}", who=who, target=target))
        return outcome_of(edit, words)

    async def forget_part(self, part: str, who: str) -> Outcome:
        """Forget a part that is gone: when it comes again, it is a new one."""
        known = known_part(part, await self._running.read(_stored_parts))
        now = self._running.now()
        shown = [info for info in self._inventory.view(now) if _is_same(info, known)]
        if here := next((info for info in shown if not info.state.is_over), None):
            raise ConfigError(
                said("{part} is there ({state}): unplug it first", part=describe(here), state=said(here.state.value))
            )
        edit = await self._store(who, partial(known_parts.forget, part=known))
        for info in shown:
            self._inventory.forget(info, now)
        self._inventory.reload(now)
        return outcome_of(edit)

    @property
    def window_s(self) -> float:
        """How long the adoption window stays open, seconds."""
        return self._window.remaining_s(self._running.now())

    @property
    def window_slot(self) -> str | None:
        """The slot that the next newcomer gets automatically."""
        return self._window.slot if self.window_s else None

    def window(self, seconds: float, slot: str | None, who: str) -> Outcome:
        """For some time, let parts be adopted that the library would turn away."""
        target = None if slot is None else slot_of(self._running, slot)
        if target is not None and (holder := self._running.holder(target)) is not None:
            raise ConfigError(
                said(
                    "slot {target} is held by {holder}: release it first, `msbot release {target}`",
                    target=target,
                    holder=describe(holder),
                )
            )
        self._window.open(seconds, target, who, self._running.now())
        where = "" if target is None else said(" for slot {target}", target=target)
        self._running.note(
            EditKind.WINDOW,
            said("{who} opened the adoption window for {seconds:g} s{where}", who=who, seconds=seconds, where=where),
            who,
        )
        if target is None:
            return Outcome(
                said(
                    "for {seconds:g} s parts of any kind can be adopted: `msbot adopt PART --slot SLOT`",
                    seconds=seconds,
                )
            )
        return Outcome(
            said(
                "the next newcomer within {seconds:g} s gets slot {target}: plug it in now",
                seconds=seconds,
                target=target,
            )
        )

    def close_window(self, who: str) -> Outcome:
        """Close the adoption window; does nothing when it is closed."""
        self._window.close()
        _log.info("the adoption window is closed by %s", who)
        return Outcome(said("the adoption window is closed"))

    # Undoing

    def check_undo(self, edit: EditRecord) -> None:
        """Check that a part that would get a slot back is present, or the robot would lose the one it has there.

        Raises:
            ConfigError: it is not present.
        """
        for uid, slot in edit.placed_before:
            holder = None if slot is None else self._running.holder(slot)
            if holder is not None and holder.uid != uid and self._running.present_part(uid) is None:
                raise ConfigError(
                    said(
                        "the part that had slot {slot} before (UID {uid}) is not plugged in: plug it in, then undo",
                        slot=slot,
                        uid=uid.hex(),
                    )
                )

    def follow(self, edit: EditRecord, who: str) -> None:
        """Move the parts to where an undo has put them."""
        moves = {
            info.client_key: slot
            for uid, slot in edit.placed
            if (info := self._running.present_part(uid)) is not None and info.state not in _NOT_YET
        }
        if moves:
            self._move(moves, said("{who} undid a change", who=who))

    # What happens by itself

    def _adopt_newcomer(
        self,
        claim: Claim,
        match: Match,  # noqa: ARG002 - the adopter's signature
        may_have: Callable[[str], bool],
    ) -> str | None:
        slot = self.window_slot
        if slot is None or not claim.uid or not may_have(slot):
            return None
        self._newcomers[claim.uid] = (slot, self._window.who)
        self._window.close()
        return slot

    def _part_changed(self, event: PartEvent) -> None:
        if event.uid not in self._newcomers or event.to_state is PartState.CHECKING:
            return
        slot, who = self._newcomers.pop(event.uid)
        if event.to_state is PartState.ACTIVE:
            words = said(
                "{event} ({part_number}) is adopted into slot {slot}, as the next newcomer",
                event=event.part,
                part_number=event.part_number,
                slot=slot,
            )
            self._soon(event.uid, slot, who, words, by_hand=True)

    def _taken_over(self, taken: TakeOver) -> None:
        if taken.claim.uid:
            words = said(
                "the spare {taken} has taken over slot {slot} from {lost_part}",
                taken=taken.part,
                slot=taken.slot,
                lost_part=taken.lost_part,
            )
            self._soon(taken.claim.uid, taken.slot, ITSELF, words, by_hand=False)

    def _soon(self, uid: bytes, slot: str, who: str, words: str, *, by_hand: bool) -> None:
        """Store what has already happened, after the part was told: the robot does not wait for its database."""
        self._running.run_later(self._keep(uid, slot, who, words, by_hand=by_hand))

    async def _keep(self, uid: bytes, slot: str, who: str, words: str, *, by_hand: bool) -> None:
        if not self._running.master.is_serving:
            return  # the end of the master itself is not a change
        making = partial(part_places.put, uid=uid, slot=slot, words=words, by_hand=by_hand, before={uid: None})
        try:
            await self._store(who, making)
        except (ConfigError, RegistryError) as error:
            _log.warning("%s; this cannot be undone, because it was not stored: %s", words, error)

    async def _store(self, who: str, making: Making) -> EditRecord | None:
        """Make a change in the database; None in a robot that has none."""
        if self._running.registry is None:
            return None
        registry, robot = self._running.database()
        return await registry.edits.make_soon(robot, who, making)

    def _move(self, moves: Mapping[int, str | None], reason: str) -> None:
        """Put parts into slots; a part that left while the change was being stored gets its slot when it comes back."""
        now = self._running.now()
        here = {info.client_key for info in self._inventory.view(now) if not info.state.is_over}
        if still := {key: slot for key, slot in moves.items() if key in here}:
            self._inventory.rearrange(still, now, reason)

    # Checks

    def _check_movable(self, info: PartInfo) -> None:
        if reason := _NOT_YET.get(info.state):
            raise ConfigError(f"{info.part} {reason}")
        if info.state is PartState.REFUSED and info.refusal not in _ADOPTABLE:
            mend = said(": `msbot unblock {info}`", info=info.uid.hex()) if info.refusal is Refusal.BLOCKED else ""
            raise ConfigError(
                said("{part} cannot be let in: {reason}{mend}", part=info.part, reason=info.reason, mend=mend)
            )
        if info.uid and not info.state.is_registered:
            everybody = self._inventory.view(self._running.now())
            twin = next((one for one in everybody if one.uid == info.uid and one.state.is_registered), None)
            if twin is not None:
                raise ConfigError(
                    said(
                        "{part} shows the UID of {holder}: one of the two is a copy, pull it out",
                        part=info.part,
                        holder=describe(twin),
                    )
                )

    def _check_fits(self, info: PartInfo, slot: str) -> None:
        if self._inventory.slots.fits(info.part_number, slot) or self.window_s > 0:
            return
        raise ConfigError(
            said(
                "{part} is a part {part_number}, and slot {slot} takes {expected}: to let it in all the same, open the "
                "adoption window first, under Arrivals or with `msbot adopt --window 60`",
                part=info.part,
                part_number=info.part_number,
                slot=slot,
                expected=self._inventory.slots.number_of(slot),
            )
        )

    def _empty_slot_for(self, info: PartInfo) -> str:
        if info.refusal is Refusal.UNKNOWN_PART and self.window_s <= 0:
            raise ConfigError(
                said(
                    "the library has no part number {number}: `msbot library add {number}` begins a file for it; to "
                    "let it in without one, `msbot adopt --window 60`, then `msbot adopt {part} --slot SLOT`",
                    number=info.part_number,
                    part=info.part,
                )
            )
        if self.window_s <= 0 and not self._inventory.slots.slots_for(info.part_number):
            raise ConfigError(
                said(
                    "the robot has no slot for {number}: `msbot slot add NAME {number}` makes one; to let it into one "
                    "of another kind, `msbot adopt --window 60`, then `msbot adopt {part} --slot SLOT`",
                    number=info.part_number,
                    part=info.part,
                )
            )
        fitting = self._inventory.slots.free_slots(info.part_number) or self._inventory.slots.free_slots()
        if len(fitting) == 1:
            return fitting[0]
        if not fitting:
            raise ConfigError(
                said("every slot is taken: `msbot swap SLOT --to {part}` puts it in another's place", part=info.part)
            )
        raise ConfigError(
            said(
                "{part} could go into {fitting}: say which one with --slot", part=info.part, fitting=", ".join(fitting)
            )
        )
