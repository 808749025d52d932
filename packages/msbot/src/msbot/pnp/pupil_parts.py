"""The parts that pupils run in browsers: held while their pupil is, and in no slot of another group. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.pupils import Pupils
from msbot.pnp.slot_assignment import SlotReassignment
from msbot.pnp.state_changes import StateChanges
from msbot_agent.text.sentence import said


class PupilParts:
    """See the module's docstring.

    Args:
        pupils: whose programs are held, and which slots are a group's; call `follow` or `regroup` after a change.
        index: sessions, parts, holders.
        changes: where changes are made.
        assignment: takes parts out of slots.
        publish: announces what has changed.
    """

    def __init__(
        self,
        pupils: Pupils,
        index: InventoryIndex,
        changes: StateChanges,
        assignment: SlotReassignment,
        publish: Callable[[float], None],
    ) -> None:
        self.pupils = pupils
        self._index = index
        self._changes = changes
        self._assignment = assignment
        self._publish = publish

    def follow(self, now: float) -> None:
        """Follow what has changed about who is held."""
        for session in list(self._index.sessions.values()):
            self.mind(session)
        self._publish(now)

    def regroup(self, now: float) -> None:
        """Take pupils' parts out of slots that belong to other groups now."""
        for slot, record in list(self._index.holders.items()):
            if not self.pupils.may_use(self._index.pupil_of(record), slot):
                group = self.pupils.group_of_slot(slot)
                words = said("slot {slot} belongs to group {group}", slot=slot, group=group)
                self._assignment.rearrange({record: None}, now, words)
        self._publish(now)

    def is_held(self, client_key: int) -> bool:
        """Whether the part behind a session belongs to a pupil whose programs are held."""
        return bool(self.why_held(client_key))

    def why_held(self, client_key: int) -> str:
        """Why the part behind a session is held, in a sentence; empty: it is not."""
        session = self._index.sessions.get(client_key)
        return "" if session is None else self.pupils.held(session.pupil)

    def pupil_of(self, client_key: int) -> str:
        """The pupil whose rights a session has; empty: it is no pupil's, or there is none."""
        session = self._index.sessions.get(client_key)
        return "" if session is None else session.pupil

    def here(self) -> Mapping[str, tuple[str, ...]]:
        """The pupils who run parts in browsers now, and the slots that these hold."""
        here: dict[str, list[str]] = {}
        for session in self._index.sessions.values():
            if session.pupil:
                held = here.setdefault(session.pupil, [])
                if session.record is not None and session.record.holds_slot and session.record.slot is not None:
                    held.append(session.record.slot)
        return {pupil: tuple(slots) for pupil, slots in here.items()}

    def mind(self, session: PartSession) -> None:
        """Bring a part in line with whether its pupil is held: its partners hear it, and so does the part."""
        record = session.record
        is_held = bool(self.pupils.held(session.pupil))
        if record is None or record.is_held is is_held:
            return
        record.is_held = is_held
        if record.is_registered and record.configuration is not None:
            self._changes.rights_changed(record)
            for topic in dict.fromkeys(one.topic for one in record.configuration.bindings if not one.publishes):
                if is_held or self._changes.has_publisher(topic):
                    self._changes.tell_partner(record.client_key, topic, is_there=not is_held)
