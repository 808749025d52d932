"""The health inventory: which part is in which slot and how it is doing (thesis 3.10.3, 3.12.1.1, 3.12.1.2). Pure.

Theory of operation. The agent's gate reports which sessions exist; a session is `new` until it asks for the
profile or claims, which makes it `checking`. A claim is matched against the library and the slots (`admission`,
`matching`); if a slot is found, the part gets a lease and is `active` as soon as the verdict exists. Beats carry the
lease and keep the life status up; silence first makes the part `late`, then `lost`. A session that is opened again
voids the lease at once, but the slot stays held until the life status has run out, so that nobody slips in while a part
reconnects. A slot that becomes free is given to a standby part within the same call (`slot_assignment`); people's moves
work the same way.

All results are values: verdicts go to the claimant, events to the subscribers and the journal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from random import Random

from msbot.part.join.pnp_messages import Nature
from msbot.pnp.claim_handler import PENDING, Adopter, ClaimHandler
from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.life_watch import LifeWatch
from msbot.pnp.model import (
    THESIS_TIMING,
    Claim,
    Configuration,
    LifeTiming,
    PartInfo,
    PartStore,
    ProgramLogLine,
    SessionStatus,
    TypeDifference,
    Verdict,
)
from msbot.pnp.part_events import PartEvent, PartState
from msbot.pnp.part_log import PartLog
from msbot.pnp.pupil_parts import PupilParts
from msbot.pnp.refusal_help import refusal_help
from msbot.pnp.self_descriptions import SelfDescriptions
from msbot.pnp.session_seals import SessionSeals
from msbot.pnp.slot_assignment import PLACEABLE, SlotReassignment, TakeOver
from msbot.pnp.slot_matching import Match, Matcher
from msbot.pnp.state_changes import HandControl, StateChanges
from msbot.pnp.type_agreement import TypeAgreement
from msbot.service_types import request_topic
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LocalProtocolError


class Inventory:
    """The parts of one robot (see the module's docstring).

    Args:
        store: library, slots, configurations and journal.
        random: source of the leases; `random.SystemRandom()` in a real robot.
        now: the present time; ticks count from here.
        timing: the robot's periods.
        keep_ended: how many parts that are gone are still shown.

    Raises:
        RegistryError: the slots cannot be read.
    """

    def __init__(
        self, store: PartStore, *, random: Random, now: float, timing: LifeTiming = THESIS_TIMING, keep_ended: int = 256
    ) -> None:
        self.timing = timing
        self.dropped = Tally()
        """Messages without effect, by reason in words."""
        self.seals = SessionSeals(self._seal_changed)
        """The seals of the parts' samples, where they have any."""
        self._store = store
        self._matcher = Matcher(store)
        self._index = InventoryIndex(random, timing, keep_ended=keep_ended)
        self.hand = HandControl()
        self._changes = StateChanges(store, self._index, self._matcher, self.hand)
        self.descriptions = SelfDescriptions(self._index, self._changes, self.dropped)
        self.log = PartLog(self._changes, self.dropped)
        """What the programs of active parts log."""
        self.served_outside: set[str] = set()
        """Services that are no part's: programs outside of the robot serve them, as nodes of ROS 2 do."""
        self.types = TypeAgreement(self._changes, self.dropped)
        """Whether parts and library mean the same by a message type."""
        self._assignment = SlotReassignment(store, self._index, self._matcher, self._changes)
        self._take_over_handlers: list[Callable[[TakeOver], None]] = []
        self.watch = LifeWatch(self._index, self._changes, timing, now)
        """Who is late, who is lost."""
        self._admission = ClaimHandler(store, self._index, self._matcher, self._changes, self.watch)
        self.pupil_parts = PupilParts(self._matcher.pupils, self._index, self._changes, self._assignment, self._publish)

    # What is reported

    def on_event(self, handler: Callable[[PartEvent], None]) -> None:
        """Call the handler with every change of a part, after it is complete."""
        self._changes.event_handlers.append(handler)

    def on_rights(self, handler: Callable[[int], None]) -> None:
        """Call the handler with the key of every client whose topics may have changed."""
        self._changes.rights_handlers.append(handler)

    def on_partner(self, handler: Callable[[int, str, bool], None]) -> None:
        """Call the handler with (client key, topic, is there) when what a registered part reads has no publisher any
        more, and when it has one again."""
        self._changes.partner_handlers.append(handler)

    def on_take_over(self, handler: Callable[[TakeOver], None]) -> None:
        """Call the handler when a standby part has taken over the slot of another one."""
        self._take_over_handlers.append(handler)

    def on_superseded(self, handler: Callable[[int], object]) -> None:
        """Call the handler with the key of every session whose part has come back through another session."""
        self._admission.superseded_handlers.append(handler)

    def set_adopter(self, adopter: Adopter | None) -> None:
        """Set whom to ask about every part that would be turned away but that a person could let in; None = nobody."""
        self._admission.adopter = adopter

    def find(self, word: str, now: float, *, by_name: bool = False) -> list[PartInfo]:
        """Parts that a person may mean by a word: name, slot, number; unless `by_name`, UID, address, client key."""
        found = self._index.find(word, by_name=by_name)
        return [record.info(now, self._index.slot_of(record)) for record in found]

    def holder(self, slot: str, now: float) -> PartInfo | None:
        """The part that holds a slot."""
        return None if (record := self._index.holders.get(slot)) is None else record.info(now, slot)

    def view(self, now: float) -> list[PartInfo]:
        """All parts that are present or were recently, in order of appearance."""
        return [record.info(now, self._index.slot_of(record)) for record in self._index.records]

    def why(self, part: str, now: float, *, by_name: bool = False) -> list[str]:
        """The state of a part and how it came about, in sentences; `part` and `by_name` as for `find`."""
        lines = [line for record in self._index.find(part, by_name=by_name) for line in record.sentences(now)]
        if lines:
            return lines
        known = ", ".join(dict.fromkeys(record.name for record in self._index.records if record.claim is not None))
        silent = ", ".join(record.address for record in self._index.records if record.claim is None)
        both = said("{names}, {addresses}", names=known, addresses=silent)
        names = both if known and silent else said("{addresses}", addresses=silent) if silent else known
        names = names or said("none yet")
        return [said("No part is known as {part!r}. Parts seen: {names}.", part=part, names=names)]

    def configuration_of(self, client_key: int) -> Configuration | None:
        """The configuration of the registered part behind a session, which says what it may use; or None."""
        record = self._index.record_of(client_key)
        return None if record is None or not record.is_registered else record.configuration

    def why_not_passed(self, client_key: int | None, topic: str, readers: int | None = None) -> str:
        """Why a request that a registered part sends on a topic reaches nobody now, in words; empty: it may.

        Args:
            client_key: of the part; None: an agent sends it for one of its parts.
            topic: where it goes in the data space.
            readers: how many would read it there; None: it is not known.
        """
        service = topic.removesuffix(request_topic(""))
        if client_key is not None:
            configuration = self.configuration_of(client_key)
            bindings = () if configuration is None else configuration.bindings
            if not any(one.calls_on(topic) for one in bindings):
                return ""
            if why := self.pupil_parts.why_held(client_key):
                return why
        if service in self.served_outside or (readers != 0 and self._changes.has_publisher(service)):
            return ""
        slot = next((name for name in self._matcher.names() if self._serves(name, service)), None)
        if slot is None:
            return said("no slot serves {topic} any more", topic=service)
        if why := self.why_unserved(slot):
            return why
        return said("the part in slot {slot} does not serve it yet: call again", slot=slot) if readers == 0 else ""

    def why_unserved(self, slot: str) -> str:
        """Why nobody serves in that slot now, in words; empty: its part may."""
        record = self._index.holders.get(slot)
        if record is None or not record.is_registered:
            return said("slot {slot} is empty", slot=slot)
        why = self.pupil_parts.why_held(record.client_key)
        return said("slot {slot} is held: {why}", slot=slot, why=why) if why else ""

    def _serves(self, slot: str, topic: str) -> bool:
        bindings = self._store.configuration(slot).bindings
        return any(one.is_service and one.publishes and one.topic == topic for one in bindings)

    def member(self, client_key: int) -> tuple[bytes, str] | None:
        """Identity and name of the registered part behind a session, or None."""
        record = self._index.record_of(client_key)
        return None if record is None or not record.is_registered else (record.identity, record.name)

    def members(self) -> list[tuple[bytes, str]]:
        """Identity and name of every registered part."""
        return [(record.identity, record.name) for record in self._index.holders.values() if record.is_registered]

    def is_simulated(self, client_key: int) -> bool:
        """Whether the part behind a session says that it is simulated."""
        record = self._index.record_of(client_key)
        return record is not None and record.nature is Nature.SIMULATED

    def shown_key(self, key: int) -> int | None:
        """The client key shown by the session that the agent knows as `key`; None: there is no such session."""
        return None if (session := self._index.sessions.get(key)) is None else session.client_key

    def standing_of(self, client_key: int) -> SessionStatus | None:
        """The status of the part behind a session; None: there is no such session, or no part behind it."""
        record = self._index.record_of(client_key)
        if record is None or record.state is None:
            return None
        version = 0 if record.configuration is None else record.configuration.version
        return SessionStatus(record.state, record.lease, version)

    # Sessions

    def client_joined(
        self,
        key: int,
        address: str,
        now: float,
        *,
        quiet: bool = False,
        plugged_in_at: float | None = None,
        client_key: int = 0,
        patience_s: float = 0.0,
        pupil: str = "",
    ) -> None:
        """A session was opened, or opened again: earlier rights are void, and both steps start over.

        Args:
            key: the key by which the agent knows the session.
            address: the peer in words.
            now: the present time.
            quiet: do not show it as a part until it claims (the robot's own services).
            plugged_in_at: when the link saw the peer arrive; None = the session is the first sign of it.
            client_key: the client key that the session shows, if it is not `key`.
            patience_s: how long a living client may take to answer a probe; 0 = nobody probes it.
            pupil: in whose browser it runs; empty: it is no pupil's.
        """
        start = now if plugged_in_at is None else plugged_in_at
        self.seals.drop(key)
        session = self._index.sessions.get(key)
        if session is None:
            session = PartSession(key, address, start, client_key=client_key, patience_s=patience_s)
            self._index.sessions[key] = session
        else:
            session.address, session.plugged_in_at = address, start
        session.opened_at, session.pupil = now, pupil
        if session.record is not None:
            self._reopen(session, session.record, now)
        elif not quiet:
            self._changes.appear(session, now)
        self._publish(now)

    def client_left(self, key: int, reason: str, now: float, *, politely: bool) -> None:
        """A session has ended: its client said goodbye (`politely`) or vanished; `reason` in words."""
        self.seals.drop(key)
        session = self._index.sessions.pop(key, None)
        if session is None or session.record is None:
            return
        record = session.record
        reason = record.with_what_was_said(reason)
        if record.state is not None and not record.state.is_over:
            lost = not politely and (record.holds_slot or record.state is PartState.STANDBY)
            state = PartState.LOST if lost else PartState.LEFT
            self._changes.retire(record, state, now, reason, ((said("session ended"), reason),))
        self._index.detach(record)
        self._publish(now)

    def profile_asked(self, key: int, now: float) -> None:
        """A client has asked to read the profile: step 1 has begun."""
        session = self._index.sessions.get(key)
        if session is not None and session.record is not None and session.record.state is PartState.NEW:
            self._changes.move(session.record, PartState.CHECKING, now, said("reads the robot's profile (step 1)"))
            self._publish(now)

    def is_no_part(self, key: int) -> None:
        """The client of that session is an agent that brings parts: it is not shown as one."""
        record = self._index.record_of(key)
        if record is not None and not record.identity:
            self._index.forget(record)

    def sample_refused(self, key: int, reason: str, now: float) -> None:
        """A sample of that session has no valid seal: it is counted, and noted once for each part."""
        self.dropped.count("sample without a good seal")
        record = self._index.record_of(key)
        if record is not None:
            record.refused_samples += 1
            if record.refused_samples == 1:
                words = f"a sample that says it is from this part was refused: {reason}"
                self._changes.note(record, now, words, (("seal", reason),))
                self._publish(now)

    def piece_told(self, lease: int, key: int, place: int, piece: bytes, now: float) -> bool:
        """A part tells a piece of what is wrong with its hardware, or of a line of its log; False: it has no lease."""
        record = self.with_lease(lease, key)
        if record is not None and self.log.receive_piece(record, place, piece, now):
            self._publish(now)
        return record is not None

    def lines_of(self, slot: str) -> list[ProgramLogLine]:
        """What the program of the part in a slot logged last, oldest first."""
        record = self._index.holders.get(slot)
        return [] if record is None else list(record.log)

    def note(self, key: int, words: str, now: float) -> None:
        """Note something about the part behind a session in its history and the journal, without changing its state."""
        if (record := self._index.record_of(key)) is not None:
            self._changes.note(record, now, words)
            self._publish(now)

    # Parts

    def forget(self, part: PartInfo, now: float) -> None:
        """Show a part that is gone no longer; one that is there stays."""
        for record in list(self._index.records):
            if record.state is not None and record.state.is_over and record.client_key == part.client_key:
                self._index.forget(record)
        self._publish(now)

    def claim(self, claim: Claim, client_key: int, now: float) -> Verdict:
        """Decide on a claim (step 2); the part is active when this returns a lease."""
        session = self._index.sessions.get(client_key)
        if session is None:
            self.dropped.count("claim of a client without a session")
            return PENDING
        verdict = self._admission.claim(session, claim, now)
        self.pupil_parts.mind(session)
        self._publish(now)
        return verdict

    def refuse(self, claim: Claim | None, client_key: int, match: Match, now: float) -> Verdict:
        """Turn away a claim that was not proved (key mode); a registered part stays in, and the claim is only noted.

        Args:
            claim: what was claimed; None: unknown, there was only a proof.
            client_key: the session that it came through.
            match: why.
            now: the present time.
        """
        session = self._index.sessions.get(client_key)
        if session is None:
            self.dropped.count("claim of a client without a session")
            return PENDING
        verdict = self._admission.refuse(session, claim, match, now)
        self._publish(now)
        return verdict

    def beat(self, lease: int, client_key: int, now: float) -> int:
        """Count a beat; returns the version of the configuration, or 0: the lease is unknown, claim again."""
        record = self._index.by_lease(lease, client_key)
        if record is None or record.configuration is None:
            self.dropped.count("beat with an unknown lease")
            self._note_return(client_key, now)
            return 0
        version = record.configuration.version
        self._admission.sign_of_life(record, now, is_beat=True)
        self._publish(now)
        return version

    def with_lease(self, lease: int, client_key: int) -> InventoryRecord | None:
        """The part that says something with that lease; None: the lease is unknown."""
        return self._index.by_lease(lease, client_key)

    def waits_for_fields(self, client_key: int) -> InventoryRecord | None:
        """The part behind a session, if it is to tell the fields of its messages; else None."""
        record = self._index.record_of(client_key)
        if record is None or all(one.detail for one in self.types.differences(record)):
            return None
        return record

    def type_differences(self, client_key: int) -> list[TypeDifference]:
        """Where the program of the part behind a session and the library mean different messages."""
        record = self._index.record_of(client_key)
        return [] if record is None else self.types.differences(record)

    def all_type_differences(self) -> list[tuple[str, TypeDifference]]:
        """The same of all parts, each with the slot or the name of its part."""
        index = self._index
        return [
            (index.slot_of(record) or record.name, difference)
            for record in index.records
            if index.record_of(record.client_key) is record
            for difference in self.types.differences(record)
        ]

    def configuration_request(self, lease: int, client_key: int) -> Configuration | None:
        """The configuration of the part with that lease, or None: the lease is unknown, so no answer is sent."""
        record = self._index.by_lease(lease, client_key)
        if record is None:
            self.dropped.count("request for a configuration with an unknown lease")
            return None
        return record.configuration

    # What people change

    def configuration_changed(self, slot: str) -> None:
        """Reload a slot's configuration; its part is told at once.

        Raises:
            RegistryError: it cannot be read.
        """
        record = self._index.holders.get(slot)
        if record is not None and record.is_registered:
            before = record.configuration
            self._changes.configure(record, self._store.configuration(slot))
            self.log.forget_ports(record, before)
            self._changes.publish()

    def rearrange(self, moves: Mapping[int, str | None], now: float, reason: str) -> None:
        """Put parts into slots, all at once, as a person decided; parts that held these slots stand by.

        Args:
            moves: client key of the part -> its slot from now on; None: take it out of its slot.
            now: the present time.
            reason: what a person did, in words.

        Raises:
            LocalProtocolError: no such part or slot, it cannot be moved now, or the same UID would hold two slots.
            RegistryError: a configuration cannot be read; nothing has changed.
        """
        records: dict[InventoryRecord, str | None] = {}
        for key, slot in moves.items():
            record = self._index.record_of(key)
            if record is None or record.state not in PLACEABLE:
                state = said("not there") if record is None or record.state is None else record.state.value
                words = said("the part of client {key:08X} is {state} and cannot be moved", key=key, state=state)
                raise LocalProtocolError(words)
            if slot is not None and not self._matcher.has(slot):
                raise LocalProtocolError(said("there is no slot {slot}", slot=slot))
            records[record] = slot
        twin = self._assignment.twin(records)
        if twin is not None:
            raise LocalProtocolError(said("the UID of {twin} would be in two slots", twin=twin.name))
        self._assignment.rearrange(records, now, reason)
        self._publish(now)

    def blocks_changed(self, now: float) -> None:
        """Delist every part that is now blocked.

        Raises:
            RegistryError: the blocks cannot be read.
        """
        for record in list(self._index.records):
            is_in = record.is_registered or record.state is PartState.STANDBY
            if is_in and record.claim is not None:
                why = self._store.blocked(record.claim.uid, record.claim.part_number)
                if why is not None:
                    self._assignment.block(record, why, now)
        self._publish(now)

    def refusal_help(self, client_key: int) -> Sentence | None:
        """What helps the part behind a session, which is not let in; None: nothing that is known here."""
        record = self._index.record_of(client_key)
        return None if record is None else refusal_help(record, self._matcher, self._index.holders)

    @property
    def slots(self) -> Matcher:
        """The robot's slots: their names, which ones fit a part number, and which are free."""
        return self._matcher

    def blocked(self, uid: bytes, number: str) -> str | None:
        """Why this part, or its number, is blocked.

        Raises:
            RegistryError: the blocks cannot be read.
        """
        return self._store.blocked(uid, number)

    def reload(self, now: float) -> None:
        """Reload the slots; a part whose slot is gone is delisted.

        Raises:
            RegistryError: they cannot be read.
        """
        self._matcher.reload(frozenset(self._index.holders))
        for slot, record in list(self._index.holders.items()):
            if not self._matcher.has(slot):
                words = said("the robot has no slot {slot} any more", slot=slot)
                self._changes.retire(record, PartState.LOST, now, words)
        self._publish(now)

    # Time

    def timer(self) -> float:
        """When `handle_timer` wants to be called next."""
        return min(self.watch.timer(), self._admission.timer())

    def handle_timer(self, now: float, late_s: float = 0.0) -> None:
        """Do what is due: decide contests, mark late parts, count down life status; the arguments are `LifeWatch`'s."""
        self._admission.handle_timer(now)
        self.watch.handle_timer(now, late_s)
        self._publish(now)

    # Helpers

    def _reopen(self, session: PartSession, record: InventoryRecord, now: float) -> None:
        self._index.void_lease(record)
        record.address, record.plugged_in_at, record.contest = session.address, session.plugged_in_at, None
        record.forget_description()  # it may be another program
        if record.state not in (PartState.NEW, PartState.CHECKING):
            self._changes.move(
                record, PartState.CHECKING, now, said("opened its session again: both steps from the start")
            )

    def _seal_changed(self, key: int) -> None:
        for tell in self._changes.rights_handlers:
            tell(key)

    def _publish(self, now: float) -> None:
        for taken in self._assignment.fill(now):
            for handler in self._take_over_handlers:
                self._changes.after_events(partial(handler, taken))
        self._changes.publish()

    def _note_return(self, client_key: int, now: float) -> None:
        """A delisted part is back on its open session: the time until it is `active` counts from here."""
        session = self._index.sessions.get(client_key)
        if session is not None and session.record is not None and session.record.plugged_in_at is None:
            session.record.plugged_in_at = now
