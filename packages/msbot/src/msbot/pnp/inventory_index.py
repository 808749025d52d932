"""The inventory's index: sessions, parts, leases and holders of slots, each found by index."""

from __future__ import annotations

from random import Random

from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import LifeTiming


class PartSession:
    """One client's session with the agent."""

    __slots__ = ("address", "client_key", "key", "opened_at", "patience_s", "plugged_in_at", "pupil", "record")

    def __init__(
        self, key: int, address: str, plugged_in_at: float, *, client_key: int = 0, patience_s: float = 0.0
    ) -> None:
        self.key = key
        """The key by which the agent knows the session."""
        self.client_key = client_key or key
        """The client key that it shows; another session may show the same one."""
        self.opened_at = plugged_in_at
        """When its client logged in."""
        self.patience_s = patience_s
        """How long a living client on its link may take to answer a probe; 0 = nobody probes it."""
        self.address = address
        self.plugged_in_at = plugged_in_at
        self.record: InventoryRecord | None = None
        """The part that speaks through it, if any is known."""
        self.pupil = ""
        """The pupil who runs it in a browser; empty: somebody or something else does."""


class InventoryIndex:
    """Who is there; keeps its indexes consistent and decides nothing.

    Args:
        random: source of the leases; must be unguessable in a real robot.
        timing: the robot's periods.
        keep_ended: how many parts that are gone are still shown; the oldest is forgotten first.
    """

    def __init__(self, random: Random, timing: LifeTiming, *, keep_ended: int) -> None:
        self._random = random
        self._timing = timing
        self._keep_ended = keep_ended
        self.sessions: dict[int, PartSession] = {}
        """By client key."""
        self.records: dict[InventoryRecord, None] = {}
        """All parts that are shown, in order of appearance."""
        self.holders: dict[str, InventoryRecord] = {}
        """By slot name: who holds it."""
        self.barred: dict[InventoryRecord, str] = {}
        """Parts that a person took out of a slot -> that slot, which they do not get back by themselves until another
        part has held it."""
        self._by_lease: dict[int, InventoryRecord] = {}
        self._by_identity: dict[bytes, InventoryRecord] = {}
        self._ended: dict[InventoryRecord, None] = {}

    def record_of(self, key: int) -> InventoryRecord | None:
        """The part that speaks through a session, if there is such a session and its part is known."""
        session = self.sessions.get(key)
        return None if session is None else session.record

    def pupil_of(self, record: InventoryRecord) -> str:
        """The pupil who runs a part in a browser; empty: somebody or something else does."""
        session = self.sessions.get(record.client_key)
        return "" if session is None or session.record is not record else session.pupil

    def open_record(self, session: PartSession) -> InventoryRecord:
        """Begin a record for the part behind a session."""
        record = InventoryRecord(session.key, session.address, self._timing, session.plugged_in_at)
        session.record = record
        self.records[record] = None
        return record

    def identify(self, record: InventoryRecord, identity: bytes) -> None:
        """Note who a part says it is; it continues an ended record of the same identity."""
        old = self._by_identity.get(identity)
        if record.identity and record.identity != identity and self._by_identity.get(record.identity) is record:
            del self._by_identity[record.identity]
        record.identity = identity
        if old is record:
            return
        if old is not None and old.state is not None and old.state.is_over:
            record.succeed(old)
            self.forget(old)
        self._by_identity[identity] = record

    def is_newest(self, record: InventoryRecord) -> bool:
        """Whether no later session has shown the record's identity."""
        return self._by_identity.get(record.identity) is record

    def has_identity(self, identity: bytes) -> bool:
        """Whether any part, present or gone, has shown this identity."""
        return identity in self._by_identity

    def rival(self, record: InventoryRecord, identity: bytes) -> InventoryRecord | None:
        """Another record with the same identity that holds a slot, or None."""
        other = self._by_identity.get(identity)
        return other if other is not None and other is not record and other.holds_slot else None

    def grant(self, record: InventoryRecord, slot: str) -> None:
        """Give a part a slot and a new lease."""
        self.holders[slot] = record
        self.barred = {other: name for other, name in self.barred.items() if name != slot and other is not record}
        record.slot, record.holds_slot = slot, True
        self.void_lease(record)
        while record.lease == 0 or record.lease in self._by_lease:
            record.lease = self._random.getrandbits(32)
        self._by_lease[record.lease] = record

    def void_lease(self, record: InventoryRecord) -> None:
        """End a part's lease."""
        self._by_lease.pop(record.lease, None)
        record.lease = 0

    def vacate(self, record: InventoryRecord) -> str | None:
        """End a part's lease and its hold on its slot; returns the slot that is now free."""
        self.void_lease(record)
        record.configuration = None
        if not record.holds_slot or record.slot is None:
            return None
        record.holds_slot = False
        del self.holders[record.slot]
        return record.slot

    def by_lease(self, lease: int, client_key: int) -> InventoryRecord | None:
        """The part with that lease, if it uses that session."""
        record = self._by_lease.get(lease)
        return record if record is not None and record.client_key == client_key else None

    def slot_of(self, record: InventoryRecord) -> str | None:
        """The slot that a part holds; for one that is gone, the slot that it held, unless another part holds it now."""
        if record.holds_slot:
            return record.slot
        is_over = record.state is not None and record.state.is_over
        return record.slot if is_over and record.slot not in self.holders else None

    def detach(self, record: InventoryRecord) -> None:
        """Separate a record from its session; a part that never said who it is is forgotten, others are still shown."""
        session = self.sessions.get(record.client_key)
        if session is not None and session.record is record:
            session.record = None
        if not record.identity:
            self.forget(record)
            return
        self._ended[record] = None
        if len(self._ended) > self._keep_ended:
            self.forget(next(iter(self._ended)))

    def forget(self, record: InventoryRecord) -> None:
        """Forget a part, so that it is no longer shown."""
        session = self.sessions.get(record.client_key)
        if session is not None and session.record is record:
            session.record = None
        self._ended.pop(record, None)
        self.barred.pop(record, None)
        self.records.pop(record, None)
        if self._by_identity.get(record.identity) is record:
            del self._by_identity[record.identity]

    def find(self, word: str, *, by_name: bool = False) -> list[InventoryRecord]:
        """Parts that a person may mean by a word: name, slot, number, UID, address or client key.

        The one that holds the slot of that name comes first, then those that are in the robot, then the others.

        With `by_name`, the last three do not count: who may not see them does not find a part by them.
        """
        wanted = word.casefold()
        found = [record for record in self.records if self._is_called(record, wanted, by_name=by_name)]
        return sorted(found, key=lambda record: (not self._holds(record, wanted), not record.is_registered))

    @staticmethod
    def _holds(record: InventoryRecord, wanted: str) -> bool:
        return record.holds_slot and (record.slot or "").casefold() == wanted

    @staticmethod
    def _is_called(record: InventoryRecord, wanted: str, *, by_name: bool) -> bool:
        claim = record.claim
        names = [record.slot or ""]
        if claim is not None:
            names += [record.name, claim.part_number, claim.local_name]
        if not by_name:
            uid = "" if claim is None else claim.uid.hex()
            names += [record.name, record.address, f"{record.client_key:08x}", uid]
        return wanted in (name.casefold() for name in names)
