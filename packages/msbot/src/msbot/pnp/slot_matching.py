"""Auto-matching: which slot a claim gets, by index and never by scan (thesis 5.4.2, R80, R83).

The rules, in this order; every rule that is tried leaves a line of evidence, so that `msbot why` can show the chain:

1. The claim can be read at all.
2. Neither the part nor its number is blocked.
3. A person has put this particular part into a slot: it gets that one, whatever the library says.
4. The part number is in the library: exactly this one, or the one before its @ if the version is in its range.
5. The robot has slots for this number: exactly this one, then those its type is compatible with.
6. The same UID as before gets its old slot.
7. Exactly one free slot fits: it gets that one.
8. Several fit: the local name decides.
9. Otherwise the part stands by.
"""

from __future__ import annotations

from msbot.config import PartType, Slot
from msbot.part.join.refusal import Refusal
from msbot.pnp.model import MAX_TEXT, Claim, PartStore
from msbot.pnp.part_events import Evidence, PartState
from msbot.pnp.pupils import Pupils
from msbot_agent.text.sentence import said
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import dataclass

UID_BYTES = 8
NO_UID = bytes(UID_BYTES)


@dataclass(frozen=True, slots=True)
class Match:
    """What the rules say about one claim."""

    outcome: PartState
    """ACTIVE (a slot is found), STANDBY or REFUSED."""
    reason: str
    evidence: Evidence
    slot: Slot | None = None
    refusal: Refusal | None = None


class Matcher:
    """Finds slots for claims; keeps the index of the free ones.

    Args:
        store: the library and the slots.

    Raises:
        RegistryError: the slots cannot be read.
    """

    def __init__(self, store: PartStore) -> None:
        self._store = store
        self.pupils = Pupils()
        """Which slots are a group's."""
        self._by_name: dict[str, Slot] = {}
        self._by_number: dict[str, dict[str, Slot]] = {}
        self._free: dict[str, dict[str, Slot]] = {}
        """Part number -> slot name -> slot, free ones only."""
        self._wanted: dict[tuple[str, str], Slot] = {}
        """(part number, local name) -> the slot that the pair asks for."""
        self.reload(frozenset())

    def reload(self, taken: frozenset[str]) -> None:
        """Read the slots again; `taken` are the names of those that are held."""
        slots = self._store.slots()
        self._by_name = {slot.name: slot for slot in slots}
        self._by_number, self._free = {}, {}
        for slot in slots:
            self._by_number.setdefault(slot.part_number, {})[slot.name] = slot
            if slot.name not in taken:
                self.release(slot.name)
        self._wanted = {(slot.part_number, slot.wanted_name): slot for slot in slots}

    def has(self, slot: str) -> bool:
        """Whether the robot has a slot of that name."""
        return slot in self._by_name

    def names(self) -> tuple[str, ...]:
        """The slots of the robot, in its order."""
        return tuple(self._by_name)

    def free_slot(self, name: str) -> Slot | None:
        """The slot of that name, if nobody holds it."""
        slot = self._by_name.get(name)
        return slot if slot is not None and name in self._free.get(slot.part_number, {}) else None

    def free_slots(self, number: str | None = None) -> list[str]:
        """The slots that nobody holds: those that fit parts of this number, or all.

        Raises:
            RegistryError: the library cannot be read.
        """
        if number is None:
            return [name for name, slot in self._by_name.items() if name in self._free.get(slot.part_number, {})]
        part_type = self._store.part_type(number)
        tiers = [] if part_type is None else self._tiers(part_type)
        return [name for tier in tiers for name in self._free.get(tier, {})]

    def slots_for(self, number: str) -> list[str]:
        """The slots that fit parts of this number, free or held.

        Raises:
            RegistryError: the library cannot be read.
        """
        part_type = self._store.part_type(number)
        return [] if part_type is None else [name for one in self._tiers(part_type) for name in self._by_number[one]]

    def number_of(self, slot: str) -> str:
        """The part number that a slot expects; empty when there is no such slot."""
        found = self._by_name.get(slot)
        return "" if found is None else found.part_number

    def fits(self, number: str, slot: str) -> bool:
        """Whether the library says that parts of this number can fill the slot.

        Raises:
            RegistryError: the library cannot be read.
        """
        part_type = self._store.part_type(number)
        return part_type is not None and self.number_of(slot) in (part_type.number, *part_type.compatible_with)

    def take(self, slot: str) -> None:
        """Note that a slot is held from now on."""
        self._free.get(self._by_name[slot].part_number, {}).pop(slot, None)

    def release(self, slot: str) -> None:
        """Note that a slot is free again; a slot that no longer exists is forgotten."""
        known = self._by_name.get(slot)
        if known is not None:
            self._free.setdefault(known.part_number, {})[slot] = known

    def match(self, claim: Claim, *, barred: str = "", pupil: str = "") -> Match:
        """Try the rules on a claim; never raises.

        Args:
            claim: what the part says about itself.
            barred: a slot that the part does not get by itself, because a person took it out of there.
            pupil: in whose browser it runs; empty: it is no pupil's, and may have any slot.
        """
        fault = _fault_of(claim)
        if fault is not None:
            return _refused(Refusal.BAD_CLAIM, fault, ((said("readable"), fault),))
        try:
            return self._match(claim, barred, pupil)
        except RegistryError as error:
            return _refused(
                Refusal.NOT_READY,
                said("{refusal}: {error}", refusal=said(Refusal.NOT_READY.describe), error=str(error)),
                ((said("registry"), str(error)),),
            )

    def _match(self, claim: Claim, barred: str, pupil: str) -> Match:
        number, uid = claim.part_number, claim.uid
        evidence: list[tuple[str, str]] = [(said("claim"), _describe(claim))]
        blocked = self._store.blocked(uid, number)
        if blocked is not None:
            return _refuse(evidence, Refusal.BLOCKED, said("blocked: {blocked}", blocked=blocked))
        placed = self._placed(uid, barred, pupil, evidence)
        if placed is not None:
            return _found(evidence, placed, said("a person has put this part into slot {placed}", placed=placed.name))
        part_type = self._store.part_type(number)
        if part_type is None:
            return _refuse(
                evidence, Refusal.UNKNOWN_PART, said("part number {number} is not in the library", number=number)
            )
        evidence.append((said("library"), said("{number}: {type}", number=number, type=said(part_type.name))))
        if part_type.number != number and (blocked := self._store.blocked(uid, part_type.number)) is not None:
            return _refuse(evidence, Refusal.BLOCKED, said("blocked: {blocked}", blocked=blocked))
        evidence.append((said("blocked"), said("no")))
        tiers = self._tiers(part_type)
        if not tiers:
            return _refuse(
                evidence,
                Refusal.WRONG_ROBOT,
                said(
                    "{number} ({part_type}) is known, but this robot has no slot for it",
                    number=number,
                    part_type=said(part_type.name),
                ),
            )
        evidence.append((said("slots"), _list_slots(self._by_number, tiers)))
        old = self._old_slot(uid, tiers, barred, evidence)
        if old is not None and not self.pupils.may_use(pupil, old.name):
            evidence.append((said("same UID as before"), self.pupils.why_not(pupil, old.name)))
            old = None
        if old is not None:
            return _found(evidence, old, said("same UID as before: back in its slot {old}", old=old.name))
        return self._among_free(claim, tiers, barred, pupil, evidence)

    def _tiers(self, part_type: PartType) -> list[str]:
        """Part numbers whose slots fit, the best first."""
        numbers = dict.fromkeys((part_type.number, *part_type.compatible_with))
        return [number for number in numbers if number in self._by_number]

    def _placed(self, uid: bytes, barred: str, pupil: str, evidence: list[tuple[str, str]]) -> Slot | None:
        """The slot that a person put the part into, if it is available: a UID is nobody's right to another group's."""
        name = self._store.placed_slot(uid) if uid else None
        if name is None or name == barred:
            return None
        slot = self.free_slot(name)
        if slot is None:
            state = (
                said("is held by another part") if name in self._by_name else said("the robot does not have any more")
            )
            evidence.append(
                (said("put there by a person"), said("into slot {name}, which {state}", name=name, state=state))
            )
        elif not self.pupils.may_use(pupil, name):
            evidence.append((said("put there by a person"), self.pupils.why_not(pupil, name)))
            return None
        return slot

    def _old_slot(self, uid: bytes, tiers: list[str], barred: str, evidence: list[tuple[str, str]]) -> Slot | None:
        name = self._store.remembered_slot(uid) if uid else None
        if name is None:
            evidence.append(
                (said("same UID as before"), said("never seen here") if uid else said("the part has no UID"))
            )
            return None
        slot = self._by_name.get(name)
        if slot is None or slot.part_number not in tiers:
            evidence.append(
                (said("same UID as before"), said("was in slot {name}, which does not take this number now", name=name))
            )
            return None
        if name == barred:
            evidence.append(
                (said("same UID as before"), said("was in slot {name}, and a person took it out of there", name=name))
            )
            return None
        if name not in self._free.get(slot.part_number, {}):
            evidence.append(
                (said("same UID as before"), said("was in slot {name}, which is held by another part", name=name))
            )
            return None
        return slot

    def _free_for(self, pupil: str, number: str, evidence: list[tuple[str, str]]) -> dict[str, Slot]:
        """The free slots of a number that a pupil may use: those of the pupil's group, if there is one."""
        free = self._free.get(number, {})
        if not pupil or not free:
            return free
        allowed = {name: slot for name, slot in free.items() if self.pupils.may_use(pupil, name)}
        if len(allowed) < len(free):
            evidence.append((said("group"), said("free slots of other groups are not for {pupil}", pupil=pupil)))
        return {name: slot for name, slot in allowed.items() if self.pupils.is_own(pupil, name)} or allowed

    def _among_free(
        self, claim: Claim, tiers: list[str], barred: str, pupil: str, evidence: list[tuple[str, str]]
    ) -> Match:
        free = next((found for number in tiers if (found := self._free_for(pupil, number, evidence))), None)
        if free is not None and barred in free:
            free = {name: slot for name, slot in free.items() if name != barred}
            evidence.append((said("slot {barred}", barred=barred), said("a person took this part out of it")))
        if not free:
            wait = said(
                "a person took it out of slot {barred}, and no other is free: adopt it, or plug it in again",
                barred=barred,
            )
            return _stand_by(evidence, wait if barred else said("every fitting slot is taken"))
        if len(free) == 1:
            slot = next(iter(free.values()))
            return _found(evidence, slot, said("slot {slot} is the one free slot that fits", slot=slot.name))
        number = next(iter(free.values())).part_number
        wanted = self._wanted.get((number, claim.local_name))
        if wanted is not None and wanted.name in free:
            return _found(
                evidence,
                wanted,
                said(
                    "{count} free slots fit; local name {local_name!r} decides",
                    count=len(free),
                    local_name=claim.local_name,
                ),
            )
        return _stand_by(
            evidence,
            said(
                "{count} free slots fit and local name {local_name!r} names none of them: a person must say",
                count=len(free),
                local_name=claim.local_name,
            ),
        )


def _fault_of(claim: Claim) -> str | None:
    """What is wrong with a claim in itself, or None."""
    if not claim.part_number:
        return said("the claim has no part number")
    if len(claim.part_number) > MAX_TEXT or len(claim.local_name) > MAX_TEXT:
        return said("a text of the claim is longer than {max_text} characters", max_text=MAX_TEXT)
    if not (claim.part_number + claim.local_name).isprintable():
        return said("a text of the claim holds control characters")
    if len(claim.uid) not in (0, UID_BYTES):
        return said("the UID has {count} bytes instead of {uid_bytes}", count=len(claim.uid), uid_bytes=UID_BYTES)
    return None


def _describe(claim: Claim) -> str:
    uid = said("UID {claim}", claim=claim.uid.hex()) if claim.uid else said("no UID")
    return said(
        "part number {part_number}, local name {local_name!r}, {uid}",
        part_number=claim.part_number,
        local_name=claim.local_name,
        uid=uid,
    )


def _list_slots(by_number: dict[str, dict[str, Slot]], tiers: list[str], limit: int = 8) -> str:
    names = [name for number in tiers for name, _ in zip(by_number[number], range(limit), strict=False)]
    count = sum(len(by_number[number]) for number in tiers)
    some = ", ".join(names[:limit])
    return said("{some} and {count} more", some=some, count=count - limit) if count > limit else some


def _refused(refusal: Refusal, reason: str, evidence: Evidence) -> Match:
    return Match(PartState.REFUSED, reason, evidence, refusal=refusal)


def _refuse(evidence: list[tuple[str, str]], refusal: Refusal, reason: str) -> Match:
    return _refused(refusal, reason, (*evidence, (said(refusal.name.lower().replace("_", " ")), reason)))


def _found(evidence: list[tuple[str, str]], slot: Slot, reason: str) -> Match:
    return Match(PartState.ACTIVE, reason, (*evidence, (said("slot"), reason)), slot=slot)


def _stand_by(evidence: list[tuple[str, str]], reason: str) -> Match:
    return Match(PartState.STANDBY, reason, (*evidence, (said("slot"), reason)), refusal=Refusal.NO_SLOT)
