"""Every change of a part's state is made, journalled and announced here."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from msbot.part.join.refusal import Refusal
from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import Configuration, PartStore, SlotBinding
from msbot.pnp.part_events import Evidence, PartEvent, PartState
from msbot.pnp.slot_matching import Matcher
from msbot_agent.text.sentence import said
from msbot_xrce.lazy import dataclass

# Who hears whom: which parts to tell when nobody publishes any more what they read, or somebody does again. Pure.
#
# A topic has a partner as long as one registered part publishes it. Everything within one turn of the inventory
# counts as a single change: when a spare takes over a slot in the moment it becomes free, nobody is left without a
# partner.


PartnerChange = tuple[int, str, bool]
"""Client key of the part that reads, topic, and whether somebody publishes it now."""


class TopicIndex:
    """An index of the registered parts by the topics that they publish and read."""

    def __init__(self) -> None:
        self._touched: deque[InventoryRecord] = deque()
        self._bound: dict[InventoryRecord, tuple[frozenset[str], frozenset[str]]] = {}
        """What each part publishes and reads, as in the two indexes."""
        self._publishers: dict[str, set[InventoryRecord]] = {}
        self._readers: dict[str, dict[InventoryRecord, None]] = {}

    def touch(self, record: InventoryRecord) -> None:
        """Note that a part was registered, delisted, or configured again."""
        self._touched.append(record)

    def has_publisher(self, topic: str) -> bool:
        """Whether a registered part publishes a topic, as of the last `refresh`."""
        return bool(self._publishers.get(topic))

    def refresh(self) -> list[PartnerChange]:
        """Bring the indexes up to date; returns what changed for parts that were there before and still are."""
        there: dict[str, bool] = {}
        """Topics whose publishers changed -> whether they had one before."""
        newcomers: set[InventoryRecord] = set()
        while self._touched:
            record = self._touched.popleft()
            publishes, reads = _topics_of(record)
            published, read = self._bound.pop(record, (frozenset(), frozenset()))
            for topic in publishes | published:
                there.setdefault(topic, bool(self._publishers.get(topic)))
            for topic in published:
                self._publishers[topic].discard(record)
            for topic in publishes:
                self._publishers.setdefault(topic, set()).add(record)
            for topic in read:
                self._readers[topic].pop(record, None)
            for topic in reads:
                self._readers.setdefault(topic, {})[record] = None
            if not published and not read:
                newcomers.add(record)
            if publishes or reads:
                self._bound[record] = (publishes, reads)
        return [
            (reader.client_key, topic, now_there)
            for topic, was_there in there.items()
            if (now_there := bool(self._publishers.get(topic))) is not was_there
            for reader in self._readers.get(topic, ())
            if reader not in newcomers
        ]


def _topics_of(record: InventoryRecord) -> tuple[frozenset[str], frozenset[str]]:
    if not record.is_registered or record.configuration is None:
        return frozenset(), frozenset()
    bindings = record.configuration.bindings
    return (
        frozenset(binding.topic for binding in bindings if binding.publishes and not record.is_held),
        frozenset(binding.topic for binding in bindings if not binding.publishes),
    )


# Ports that people drive by hand: while somebody holds one, its wire is cut and it listens to the master. Pure.
#
# A held port is bound to a topic of its own, which only the master publishes. The part gets this like any other
# change of its configuration; when nobody holds the port any more it is bound to its wire again.


TOPIC_PREFIX = "msbot_hand_"
"""Prefix of the topics of held ports; a blueprint cannot use such a name."""
GENERATION_BIT = 16
"""The bits of a configuration's version from this one up count how often ports of the slot were taken or released."""


@dataclass(frozen=True, slots=True)
class HeldPort:
    """A port that somebody drives by hand."""

    slot: str
    port: str
    type_name: str

    @property
    def topic(self) -> str:
        """The topic that the port reads while it is held."""
        return f"{TOPIC_PREFIX}{self.slot}_{self.port}"


class HandControl:
    """Which ports are held, and the configurations of their slots while they are."""

    def __init__(self) -> None:
        self._held: dict[str, dict[str, HeldPort]] = {}
        self._generation: dict[str, int] = {}

    def take(self, slot: str, port: str, type_name: str) -> HeldPort:
        """Hold a port; its slot's configuration has changed unless it was held before."""
        held = HeldPort(slot, port, type_name)
        before = self._held.setdefault(slot, {}).get(port)
        if before != held:
            self._held[slot][port] = held
            self._turn(slot)
        return held

    def let_go(self, slot: str, port: str) -> None:
        """Let go of a port; its slot's configuration has changed if it was held."""
        if self._held.get(slot, {}).pop(port, None) is not None:
            self._turn(slot)

    def apply_to(self, configuration: Configuration) -> Configuration:
        """A slot's configuration with its held ports bound to their own topics."""
        generation = self._generation.get(configuration.slot, 0)
        if generation == 0:
            return configuration
        held = self._held.get(configuration.slot, {})
        bindings = [binding for binding in configuration.bindings if binding.publishes or binding.port not in held]
        bindings += [
            SlotBinding(port=one.port, topic=one.topic, type_name=one.type_name, publishes=False)
            for one in held.values()
        ]
        low = (1 << GENERATION_BIT) - 1
        version = (generation << GENERATION_BIT | configuration.version & low) & 0xFFFFFFFF
        return replace(configuration, version=version, bindings=tuple(bindings))

    def _turn(self, slot: str) -> None:
        # Never back to 0: a version that was used before must not be reused while the part remembers it.
        self._generation[slot] = self._generation.get(slot, 0) % 0xFFFF + 1


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
        self._partners = TopicIndex()
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
        record.configuration, record.refusal, record.contest = self._hand.apply_to(configuration), None, None
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
        record.configuration = self._hand.apply_to(configuration)
        self.rights_changed(record)

    def rights_changed(self, record: InventoryRecord) -> None:
        """Note that the topics a part may use have changed."""
        self._changed.append(record.client_key)
        self._partners.touch(record)

    def after_events(self, tell: Callable[[], object]) -> None:
        """Call `tell` after all rights and events have been announced."""
        self._later.append(tell)

    def publish(self) -> None:
        """Announce everything that has happened: rights first, events in order.

        Handlers may call the inventory again; the consequences are announced after what they are being told now.
        """
        for key, topic, is_there in self._partners.refresh():
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
        self.after_events(partial(self._tell_partner, key, topic, is_there))

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
