"""Step 2: from a claim to a verdict (thesis 3.12.1.1, 3.12.2). Pure.

A claim with the UID of a part that holds a slot in another session is contested: nobody is answered. If the old session
shows a sign of life after the contest began, the newcomer is a duplicate; if it shows none for `LifeTiming.late_s`, it
has died and the newcomer is the same part, restarted.

When both sessions show the same client key, the agent has probed the old one since the new one was opened: then any
packet from it is a sign of life, and silence for `PartSession.patience_s` is enough. The newcomer need not claim again.
(Sessions at agents elsewhere are not probed.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from msbot.part.join.refusal import Refusal
from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.inventory_record import DuplicateClaim, InventoryRecord
from msbot.pnp.life_watch import LifeWatch
from msbot.pnp.model import MAX_TEXT, Claim, Configuration, PartStore, Verdict, identity_of
from msbot.pnp.part_events import Evidence, PartState
from msbot.pnp.slot_matching import NO_UID, Match, Matcher
from msbot.pnp.state_changes import StateChanges
from msbot_agent.text.sentence import printable, said
from msbot_xrce.errors import RegistryError

PENDING = Verdict()
"""Not decided yet: no answer is sent."""

ADOPTABLE = frozenset({Refusal.UNKNOWN_PART, Refusal.WRONG_ROBOT, Refusal.NO_SLOT})
"""Refusals that a person can overrule by putting the part into a slot."""

Adopter = Callable[[Claim, Match, Callable[[str], bool]], str | None]
"""Called for a part that would be turned away for an `ADOPTABLE` reason, with what says whether it may have a slot at
all; returns the free slot it gets instead."""


class ClaimHandler:
    """Decides on claims: who is let in, and into which slot.

    Args:
        store: configurations and the memory of slots.
        index: sessions, parts, holders.
        matcher: the rules by which slots are found.
        changes: where changes are made.
        watch: knows when clients were heard, and the robot's periods.
    """

    def __init__(
        self, store: PartStore, index: InventoryIndex, matcher: Matcher, changes: StateChanges, watch: LifeWatch
    ) -> None:
        self._store = store
        self._index = index
        self._matcher = matcher
        self._changes = changes
        self._watch = watch
        self.adopter: Adopter | None = None
        self.superseded_handlers: list[Callable[[int], object]] = []
        self._due: dict[InventoryRecord, tuple[float, Claim]] = {}
        """Contests that end by themselves: when, and the claim."""

    def timer(self) -> float:
        """When `handle_timer` wants to be called next."""
        return min((at for at, _ in self._due.values()), default=math.inf)

    def handle_timer(self, now: float) -> None:
        """Decide the contests whose time is over."""
        for record, (at, claim) in list(self._due.items()):
            session = self._index.sessions.get(record.client_key)
            if session is None or session.record is not record or record.contest is None:
                del self._due[record]
            elif at <= now:
                del self._due[record]
                self.claim(session, claim, now)

    def claim(self, session: PartSession, claim: Claim, now: float) -> Verdict:
        """Decide on a claim that came through a session."""
        if claim.uid == NO_UID:
            claim = replace(claim, uid=b"")
        identity = identity_of(claim.uid, session.client_key)
        record = session.record or self._changes.appear(session, now)
        if record.is_registered and record.claim is not None:
            if (record.identity, record.claim.part_number) == (identity, claim.part_number):
                return self._again(record, claim, now)
            record = self._other_part(session, record, now)
        elif record.identity not in (b"", identity):
            record = self._other_part(session, record, now)
        if record.claim is not None and record.claim.part_number != claim.part_number:
            record.forget_description()
        record.claim, record.heard_at = _presentable(claim), now
        if record.plugged_in_at is None:
            record.plugged_in_at = now
        rival = self._index.rival(record, identity)
        if rival is not None:
            verdict = self._contest(session, claim, record, rival, now)
            if verdict is not None:
                return verdict
        record.contest = None
        self._index.identify(record, identity)
        return self._decide(record, claim, now)

    def refuse(self, session: PartSession, claim: Claim | None, match: Match, now: float) -> Verdict:
        """Turn away a claim whose proof is missing or wrong; a part that holds a slot is not affected.

        Before a proof anybody can claim anything, so no slot is vacated, no identity is taken over and no contest
        begins.
        """
        record = session.record or self._changes.appear(session, now)
        if record.holds_slot:
            if record.refusal is not match.refusal:
                record.refusal = match.refusal
                self._changes.note(record, now, match.reason, match.evidence)
            return Verdict(refusal=match.refusal)
        record.heard_at = now
        if claim is not None:
            record.claim = _presentable(claim)
            if claim.uid and not self._index.has_identity(claim.uid):
                self._index.identify(record, claim.uid)
        return self._turn_away(record, match, now)

    def sign_of_life(self, record: InventoryRecord, now: float, *, is_beat: bool) -> None:
        """A registered part was heard: it gets full life status, and a late one is active again."""
        silence = record.life.silence_s(now)
        record.heard_at = now
        if is_beat:
            record.life.beat(now)
        else:
            record.life.refresh(now)
        if record.state is PartState.LATE:
            self._changes.move(
                record, PartState.ACTIVE, now, said("heard again after {silence:.1f} s", silence=silence)
            )

    def _again(self, record: InventoryRecord, claim: Claim, now: float) -> Verdict:
        """A registered part claims again: an answer was lost, it has restarted, or it knows no beats (compat)."""
        if claim.layout == "compact" and record.claim is not None and claim.nonce != record.claim.nonce:
            self._index.grant(record, str(record.slot))
            record.life.register(now)
        record.claim = claim
        self.sign_of_life(record, now, is_beat=claim.layout == "compat")
        return _verdict(record)

    def _other_part(self, session: PartSession, record: InventoryRecord, now: float) -> InventoryRecord:
        """The session now speaks for a different part."""
        if record.state is not None and not record.state.is_over:
            self._changes.retire(record, PartState.LEFT, now, said("its session claims for another part now"))
        self._index.detach(record)
        return self._changes.appear(session, now)

    def _contest(
        self, session: PartSession, claim: Claim, record: InventoryRecord, rival: InventoryRecord, now: float
    ) -> Verdict | None:
        """Decide between two sessions with the same identity; None: the newcomer has won."""
        other = self._index.sessions.get(rival.client_key)
        is_probed = (
            other is not None
            and other.client_key == session.client_key
            and min(other.patience_s, session.patience_s) > 0
        )
        contest = record.contest
        if contest is None or contest.rival is not rival:
            contest = record.contest = DuplicateClaim(rival, session.opened_at if is_probed else now)
            if record.state is not PartState.CHECKING:
                reason = said("shows the UID of {rival}: is that one still alive?", rival=rival.name)
                self._changes.move(record, PartState.CHECKING, now, reason)
        holds = said(
            "{rival} holds slot {slot} from {address}", rival=rival.name, slot=rival.slot, address=rival.address
        )
        facts: Evidence = ((said("same UID"), holds),)
        heard_at = rival.heard_at
        if is_probed:
            heard_at = max(heard_at, self._watch.last_heard(rival.client_key) or heard_at)
        waited, heard = now - contest.began_at, heard_at - contest.began_at
        if heard > 0:
            rival.note_duplicate(record.address)
            reason = said(
                "{duplicate}: {rival} in slot {slot}, from {address}",
                duplicate=said(Refusal.DUPLICATE.describe),
                rival=rival.name,
                slot=rival.slot,
                address=rival.address,
            )
            facts += ((said("old session"), said("gave a sign of life {heard:.2f} s after the claim", heard=heard)),)
            return self._turn_away(record, Match(PartState.REFUSED, reason, facts, refusal=Refusal.DUPLICATE), now)
        if waited < (session.patience_s if is_probed else self._watch.timing.late_s):
            if is_probed:
                self._due[record] = (contest.began_at + session.patience_s, claim)
            return PENDING
        facts += ((said("old session"), said("silent for {waited:.2f} s since the claim", waited=waited)),)
        reason = said("restarted: the same UID came back from {address}", address=record.address)
        self._changes.retire(rival, PartState.LOST, now, reason, facts)  # `identify` continues its record
        if is_probed:
            for handler in self.superseded_handlers:
                self._changes.after_events(partial(handler, rival.client_key))
        return None

    def _decide(self, record: InventoryRecord, claim: Claim, now: float) -> Verdict:
        self._changes.vacate(record)
        barred, pupil = self._index.barred.get(record, ""), self._index.pupil_of(record)
        match = self._adopted(claim, self._matcher.match(claim, barred=barred, pupil=pupil), pupil)
        if match.slot is None:
            return self._turn_away(record, match, now)
        slot = match.slot.name
        try:
            configuration = self._store.configuration(slot)
            self._store.remember(claim.uid, slot, claim)
        except RegistryError as error:
            reason = said("{refusal}: {error}", refusal=said(Refusal.NOT_READY.describe), error=str(error))
            refused = Match(
                PartState.REFUSED, reason, (*match.evidence, (said("registry"), str(error))), None, Refusal.NOT_READY
            )
            return self._turn_away(record, refused, now)
        return self._register(record, configuration, match, now)

    def _adopted(self, claim: Claim, match: Match, pupil: str) -> Match:
        """Ask a person, if an adopter is set, about a part that the rules turn away."""
        may_have = partial(self._matcher.pupils.may_use, pupil)
        if self.adopter is None or match.refusal not in ADOPTABLE:
            return match
        slot = self.adopter(claim, match, may_have)
        found = None if slot is None or not may_have(slot) else self._matcher.free_slot(slot)
        if found is None:
            return match
        reason = said("adopted: a person has said that the next newcomer belongs into slot {slot}", slot=slot)
        return Match(PartState.ACTIVE, reason, (*match.evidence, (said("a person decided"), reason)), found)

    def _register(self, record: InventoryRecord, configuration: Configuration, match: Match, now: float) -> Verdict:
        self._check(record, now)
        record.plug_in_to_active_s = now - (now if record.plugged_in_at is None else record.plugged_in_at)
        self._changes.seat(record, configuration, now, match.reason, match.evidence)
        return _verdict(record)

    def _turn_away(self, record: InventoryRecord, match: Match, now: float) -> Verdict:
        """Refuse the part or keep it waiting; emit an event only when that is news."""
        record.refused_claims += 1
        record.slot = None
        record.life.end()
        if (record.state, record.refusal) == (match.outcome, match.refusal):
            record.reason = match.reason
        else:
            self._check(record, now)
            record.refusal = match.refusal
            self._changes.move(record, match.outcome, now, match.reason, match.evidence)
        return Verdict(refusal=match.refusal)

    def _check(self, record: InventoryRecord, now: float) -> None:
        if record.state is not PartState.CHECKING:
            self._changes.move(record, PartState.CHECKING, now, said("claims its place (step 2)"))


def _verdict(record: InventoryRecord) -> Verdict:
    version = 0 if record.configuration is None else record.configuration.version
    return Verdict(lease=record.lease, configuration_version=version)


def _presentable(claim: Claim) -> Claim:
    """The claim in a form that is safe to show: nothing in it can overflow a table or control a terminal."""
    number, name = (printable(text[: MAX_TEXT + 1]) for text in (claim.part_number, claim.local_name))
    return replace(claim, part_number=number, local_name=name)
