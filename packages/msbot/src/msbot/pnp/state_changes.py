"""Every change of a part's state is made, journalled and announced here."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial

from msbot.part.join.plug import Refusal
from msbot.pnp.hand_control import HandControl
from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import Configuration, PartStore
from msbot.pnp.part_events import Evidence, PartEvent, PartState
from msbot.pnp.partners import Partners
from msbot.pnp.slot_matching import Matcher
from msbot_agent.text.sentence import said


class StateChanges:
    """Moves parts from state to state, and announces it once everything is consistent.

    Args:
        store: gets every event at once.
        index: sessions, parts, holders.
        matcher: told which slots become free.
    """

    def __init__(self, store: PartStore, index: InventoryIndex, matcher: Matcher, hand: HandControl) -> None:
        self._hand = hand
        self._store = store
        self._index = index
        self._matcher = matcher
        self._events: deque[PartEvent] = deque()
        self._changed: deque[int] = deque()
        self._later: deque[Callable[[], object]] = deque()
        self._partners = Partners()
        self._is_publishing = False
        self.freed: dict[str, InventoryRecord] = {}
        """Slots that became free and are not yet reassigned -> who held them."""
        self.event_handlers: list[Callable[[PartEvent], None]] = []
        self.rights_handlers: list[Callable[[int], None]] = []
        self.partner_handlers: list[Callable[[int, str, bool], None]] = []

    def appear(self, session: PartSession, now: float) -> InventoryRecord:
        """A part has appeared: nothing is known but its session."""
        record = self._index.open_record(session)
        self.move(record, PartState.NEW, now, said("a session was opened from {address}", address=session.address))
        return record

    def move(self, record: InventoryRecord, to: PartState, now: float, reason: str, evidence: Evidence = ()) -> None:
        """Change a part's state; everything else about it must already be up to date."""
        was_registered = record.is_registered
        event = record.move(to, now, reason, evidence)
        self._store.journal(event)
        self._events.append(event)
        if was_registered != record.is_registered:
            self.rights_changed(record)

    def note(self, record: InventoryRecord, now: float, reason: str, evidence: Evidence = ()) -> None:
        """Journal something about a part without changing its state."""
        event = record.note(now, reason, evidence)
        self._store.journal(event)
        self._events.append(event)

    def vacate(self, record: InventoryRecord) -> None:
        """End a part's lease and its hold on its slot."""
        slot = self._index.vacate(record)
        if slot is not None:
            self._matcher.release(slot)
            self.freed[slot] = record

    def retire(self, record: InventoryRecord, to: PartState, now: float, reason: str, evidence: Evidence = ()) -> None:
        """Delist a part."""
        self.vacate(record)
        record.life.end()
        record.plugged_in_at = record.contest = None
        self.move(record, to, now, reason, evidence)

    def seat(
        self, record: InventoryRecord, configuration: Configuration, now: float, reason: str, evidence: Evidence = ()
    ) -> None:
        """Register a part: it gets the free slot of that configuration, a new lease and full life status."""
        self._matcher.take(configuration.slot)
        self._index.grant(record, configuration.slot)
        record.configuration, record.refusal, record.contest = self._hand.over(configuration), None, None
        record.life.register(now)
        self.move(record, PartState.ACTIVE, now, reason, evidence)

    def turn_away(
        self, record: InventoryRecord, refusal: Refusal, now: float, reason: str, evidence: Evidence = ()
    ) -> None:
        """Take away the place of a part that is still present; what it held must already be vacated."""
        to = PartState.STANDBY if refusal is Refusal.NO_SLOT else PartState.REFUSED
        record.slot, record.refusal = None, refusal
        record.life.end()
        record.plugged_in_at, record.heard_at = None, now
        self.move(record, to, now, reason, evidence)

    def configure(self, record: InventoryRecord, configuration: Configuration) -> None:
        """Give a registered part another configuration."""
        record.configuration = self._hand.over(configuration)
        self.rights_changed(record)

    def rights_changed(self, record: InventoryRecord) -> None:
        """Note that the topics a part may use have changed."""
        self._changed.append(record.client_key)
        self._partners.touch(record)

    def later(self, tell: Callable[[], object]) -> None:
        """Call `tell` after all rights and events have been announced."""
        self._later.append(tell)

    def publish(self) -> None:
        """Announce everything that has happened: rights first, events in order.

        Handlers may call the inventory again; the consequences are announced after what they are being told now.
        """
        for key, topic, is_there in self._partners.settle():
            self.tell_partner(key, topic, is_there=is_there)
        if self._is_publishing:
            return
        self._is_publishing = True
        try:
            while self._changed or self._events or self._later:
                self._tell_next()
        finally:
            self._is_publishing = False

    def has_publisher(self, topic: str) -> bool:
        """Whether a registered part publishes a topic, as far as it has been announced."""
        return self._partners.has_publisher(topic)

    def tell_partner(self, key: int, topic: str, *, is_there: bool) -> None:
        """Tell a part, with the next `publish`, whether somebody publishes what it reads."""
        self.later(partial(self._tell_partner, key, topic, is_there))

    def _tell_partner(self, key: int, topic: str, is_there: bool) -> None:
        for handler in self.partner_handlers:
            handler(key, topic, is_there)

    def _tell_next(self) -> None:
        if self._changed:
            key = self._changed.popleft()
            for tell in self.rights_handlers:
                tell(key)
        elif self._events:
            event = self._events.popleft()
            for handler in self.event_handlers:
                handler(event)
        else:
            self._later.popleft()()
