"""Slots given without a claim: to spares that take over, and to parts that people move (R61, R62). Pure.

A slot that becomes free is given at once to a standby part that fits, by the same rules as for a claim. The inventory's
service tells the part; one that missed the message learns of it with its next claim.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msbot.part.join.refusal import Refusal
from msbot.pnp.inventory_index import InventoryIndex
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import Claim, PartStore
from msbot.pnp.part_events import Evidence, PartState
from msbot.pnp.slot_matching import Matcher
from msbot.pnp.state_changes import StateChanges
from msbot_agent.text.sentence import said
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import dataclass

FRESH_S = 3.0
"""A standby part that has claimed within this time is surely there."""

PLACEABLE = frozenset({PartState.ACTIVE, PartState.LATE, PartState.STANDBY, PartState.REFUSED})
"""States in which a person can put a part into a slot."""


@dataclass(frozen=True, slots=True)
class TakeOver:
    """A standby part has taken over the slot of another one."""

    at: float
    slot: str
    claim: Claim
    """The claim of the part that now has the slot."""
    part: str
    """Its name for people."""
    lost_uid: bytes
    """The UID of the part that had the slot; empty if it has no UID."""
    lost_part: str
    """The name for people of the part that had the slot."""


class SlotReassignment:
    """Assigns slots without a claim: when one becomes free, and when a person says so.

    Args:
        store: configurations and the memory of slots.
        index: sessions, parts, holders.
        matcher: the rules by which slots are found.
        changes: where changes are made.
    """

    def __init__(self, store: PartStore, index: InventoryIndex, matcher: Matcher, changes: StateChanges) -> None:
        self._store = store
        self._index = index
        self._matcher = matcher
        self._changes = changes

    def fill(self, now: float) -> list[TakeOver]:
        """Give the slots that have become free to standby parts; returns the takeovers."""
        if not self._changes.freed:
            return []
        freed = dict(self._changes.freed)
        self._changes.freed.clear()
        taken = []
        for record in self._standing_by(freed, now):
            claim = record.claim
            if claim is None:
                continue
            barred, pupil = self._index.barred.get(record, ""), self._index.pupil_of(record)
            match = self._matcher.match(claim, barred=barred, pupil=pupil)
            if match.slot is None:
                continue
            slot = match.slot.name
            old = freed.get(slot)
            reason = match.reason if old is None else said("takes over slot {slot}: {fate}", slot=slot, fate=_fate(old))
            if not self._seat(record, slot, now, reason, match.evidence):
                continue
            if old is not None:
                old_uid = b"" if old.claim is None else old.claim.uid
                taken.append(TakeOver(now, slot, claim, record.name, old_uid, old.name))
        return taken

    def twin(self, moves: Mapping[InventoryRecord, str | None]) -> InventoryRecord | None:
        """A part that would be in a slot while another session with the same UID is in one, too."""
        wanted = {slot for slot in moves.values() if slot is not None}
        staying = [record for slot, record in self._index.holders.items() if record not in moves and slot not in wanted]
        seen: dict[bytes, InventoryRecord] = {record.identity: record for record in staying}
        for record, slot in moves.items():
            if slot is not None and seen.setdefault(record.identity, record) is not record:
                return record
        return None

    def rearrange(self, moves: Mapping[InventoryRecord, str | None], now: float, reason: str) -> None:
        """Put parts into slots, or take them out of theirs (None), all at once; parts that are in the way stand by.

        Args:
            moves: parts whose state is in `PLACEABLE`; each slot at most once.
            now: the present time.
            reason: why, in words.

        Raises:
            RegistryError: a configuration cannot be read; nothing has changed.
        """
        wanted = {slot: record for record, slot in moves.items() if slot is not None}
        configurations = {slot: self._store.configuration(slot) for slot in wanted}
        for record in dict.fromkeys(
            [*moves, *(self._index.holders[name] for name in wanted if name in self._index.holders)]
        ):
            if record.holds_slot and record.slot != moves.get(record):
                self._unseat(record, now, reason)
        for slot, record in wanted.items():
            if record.slot == slot and record.holds_slot:
                continue
            self._remember(record, slot)
            if record.state is PartState.REFUSED:
                self._changes.move(record, PartState.CHECKING, now, said("a person lets it in"))
            self._changes.seat(record, configurations[slot], now, reason, ((said("a person decided"), reason),))

    def block(self, record: InventoryRecord, why: str, now: float) -> None:
        """Delist a part that a person has blocked."""
        reason = said("blocked: {why}", why=why)
        self._changes.vacate(record)
        self._changes.turn_away(record, Refusal.BLOCKED, now, reason, ((said("blocked"), reason),))

    def _standing_by(self, freed: Mapping[str, InventoryRecord], now: float) -> Iterator[InventoryRecord]:
        """Parts that could take over, best first: one that was there before, one named for it, the longest waiting."""

        def rank(record: InventoryRecord) -> tuple[bool, bool, float]:
            claim = record.claim
            remembered = None if claim is None or not claim.uid else self._store.remembered_slot(claim.uid)
            return remembered not in freed, now - record.heard_at > FRESH_S, record.since

        waiting = [
            record
            for record in self._index.records
            if record.state is PartState.STANDBY and record not in freed.values() and self._index.is_newest(record)
        ]
        yield from sorted(waiting, key=rank)

    def _seat(self, record: InventoryRecord, slot: str, now: float, reason: str, evidence: Evidence) -> bool:
        try:
            configuration = self._store.configuration(slot)
            self._remember(record, slot)
        except RegistryError:
            return False  # it remains standby; the answer to its next claim will say why
        self._changes.seat(record, configuration, now, reason, evidence)
        return True

    def _remember(self, record: InventoryRecord, slot: str) -> None:
        if record.claim is not None:
            self._store.remember(record.claim.uid, slot, record.claim)

    def _unseat(self, record: InventoryRecord, now: float, reason: str) -> None:
        slot = str(record.slot)
        self._changes.vacate(record)
        self._index.barred[record] = slot
        words = said("was in slot {slot}: {reason}", slot=slot, reason=reason)
        self._changes.turn_away(record, Refusal.NO_SLOT, now, words, ((said("a person decided"), reason),))


def _fate(old: InventoryRecord) -> str:
    """What became of a part that had a slot, in words."""
    state = old.state or PartState.LOST
    return said("{old} is {state} ({reason})", old=old.name, state=said(state.value), reason=old.reason)
