"""What the inventory asks and tells the registry about one robot: `msbot.pnp.PartStore` on top of SQL.

Reads are short, indexed and answered at once; writes go to the writer thread. What was read or told before is kept
in memory, so that a robot goes on when its database cannot be used for a while.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from sqlalchemy import Connection, Engine

from msbot.errors import RegistryError
from msbot.pnp import Claim, Configuration, PartEvent, PartType, Slot
from msbot.registry import configurations, people, places, store
from msbot.registry.reader import Reader
from msbot.registry.records import RobotRecord, uid_text
from msbot.registry.writer import Writer

JOURNAL_ROWS = 100_000
"""Lines of the journal that are kept."""
STRANGERS = 1_000
"""Parts that never were in a slot and are kept nevertheless."""
PRUNE_EVERY = 1_000
"""So many lines are written before old ones are looked for."""
MOST_IN_MEMORY = 10_000
"""Part types, and answers about blocks, that are kept in case the database cannot be read."""

_T = TypeVar("_T")


class RobotStore:
    """The `PartStore` of one robot; all methods belong to the event loop's thread.

    Args:
        engine: where to read.
        writer: who writes.
        database: the database in words.
        robot: whose parts these are.
        epoch_ns: wall clock, nanoseconds since 1970.

    Raises:
        RegistryError: the database cannot be read.
    """

    def __init__(
        self, engine: Engine, writer: Writer, database: str, robot: RobotRecord, epoch_ns: Callable[[], int]
    ) -> None:
        self.robot = robot
        self._reader = Reader(engine, database)
        self._writer = writer
        self._database = database
        self._epoch_ns = epoch_ns
        self._types: dict[str, PartType] = {}
        self._blocks: dict[tuple[str, str], str | None] = {}
        """What `blocked` said last."""
        self._keys: dict[bytes, bytes | None] = {}
        """What `key_of` said last."""
        self._configurations: dict[str, Configuration] = {}
        self._sessions: dict[str, int] = {}
        """Identity of each registered part -> its session; another session with that identity is a duplicate."""
        self._written = 0
        self._remembered: dict[str, str] = {}
        self._placed: dict[str, str] = {}
        for uid, place in self._read(partial(places.read, robot_id=robot.id)).items():
            self._put_place(uid, place)
        self._slots = self._read(partial(store.list_slots, robot_id=robot.id))
        self._configurations.update(self._read(partial(configurations.read_configurations, robot_id=robot.id)))

    def part_type(self, number: str) -> PartType | None:
        """See `PartStore.part_type`."""
        try:
            found = self._read(partial(store.find_part_type, number=number))
        except RegistryError:
            if number in self._types:
                return self._types[number]
            raise
        if found is not None and len(self._types) < MOST_IN_MEMORY:
            self._types[number] = found
        return found

    def slots(self) -> tuple[Slot, ...]:
        """See `PartStore.slots`."""
        self._slots = self._or_known(partial(store.list_slots, robot_id=self.robot.id), self._slots)
        return self._slots

    def remembered_slot(self, uid: bytes) -> str | None:
        """See `PartStore.remembered_slot`."""
        return self._remembered.get(uid_text(uid))

    def placed_slot(self, uid: bytes) -> str | None:
        """See `PartStore.placed_slot`."""
        return self._placed.get(uid_text(uid))

    def remember(self, uid: bytes, slot: str, claim: Claim) -> None:
        """See `PartStore.remember`."""
        if identity := uid_text(uid):
            self._remembered[identity] = slot
            now_ns = self._epoch_ns()
            self._writer.put(lambda connection: store.remember(connection, self.robot.id, claim, slot, now_ns))

    def reread_places(self, uids: Sequence[bytes]) -> None:
        """A person has said where these parts belong; the registry has stored it.

        Raises:
            RegistryError: the database cannot be read.
        """
        names = [uid_text(uid) for uid in uids]
        for uid, place in self._read(partial(places.read, robot_id=self.robot.id, uids=names)).items():
            self._put_place(uid, place)

    def _put_place(self, uid: str, place: places.Place) -> None:
        for memory, slot in zip((self._remembered, self._placed), place, strict=True):
            if slot is None:
                memory.pop(uid, None)
            else:
                memory[uid] = slot

    def key_of(self, uid: bytes) -> bytes | None:
        """See `PartStore.key_of`."""
        try:
            key = self._read(partial(people.find_key, uid=uid))
        except RegistryError:
            if uid in self._keys:
                return self._keys[uid]
            raise
        if len(self._keys) < MOST_IN_MEMORY:
            self._keys[uid] = key
        return key

    def configuration(self, slot: str) -> Configuration:
        """See `PartStore.configuration`.

        Raises:
            RegistryError: there is no such slot, or the database cannot be read and never could.
        """
        read = partial(configurations.find_configuration, robot_id=self.robot.id, slot=slot)
        found = self._or_known(read, self._configurations.get(slot))
        if found is None:
            raise RegistryError(f"the database {self._database} has no slot {slot!r} of robot {self.robot.name}")
        self._configurations[slot] = found
        return found

    def blocked(self, uid: bytes, number: str) -> str | None:
        """See `PartStore.blocked`."""
        key = (uid_text(uid), number)
        try:
            reason = self._read(partial(store.find_block, uid=key[0], number=number))
        except RegistryError:
            if key in self._blocks:
                return self._blocks[key]
            raise
        if len(self._blocks) < MOST_IN_MEMORY:
            self._blocks[key] = reason
        return reason

    def journal(self, event: PartEvent) -> None:
        """See `PartStore.journal`."""
        now_ns = self._epoch_ns()
        is_about_the_part = self._is_about_the_part(event)
        self._written += 1
        prune = self._written % PRUNE_EVERY == 0

        def write(connection: Connection) -> None:
            store.write_journal(connection, self.robot.id, event, now_ns)
            if is_about_the_part:
                store.note_state(connection, self.robot.id, event, now_ns)
            if prune:
                store.prune(connection, self.robot.id, JOURNAL_ROWS, STRANGERS)

        self._writer.put(write)

    def _is_about_the_part(self, event: PartEvent) -> bool:
        """Whether the part's row changes: not before its claim, and not by a duplicate of a registered part."""
        if not event.part_number:
            return False
        identity = uid_text(event.uid) or f"{event.part_number}/{event.local_name}"
        if event.to_state.is_registered:
            self._sessions[identity] = event.client_key
            return True
        if self._sessions.get(identity, event.client_key) != event.client_key:
            return False
        self._sessions.pop(identity, None)
        return True

    def _or_known(self, read: Callable[[Connection], _T], known: _T) -> _T:
        """The answer of the database; while it cannot be read, what is known from before."""
        try:
            return self._read(read)
        except RegistryError:
            if not known:
                raise
            return known

    def close(self) -> None:
        """Let go of the database."""
        self._reader.close()

    def _read(self, read: Callable[[Connection], _T]) -> _T:
        return self._reader.read(read)
