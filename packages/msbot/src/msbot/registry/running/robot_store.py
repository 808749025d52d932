"""The registry as the inventory of one robot uses it: `msbot.pnp.PartStore` in memory, backed by SQL.

Reads are answered from memory; writes go to the writer thread. So a robot keeps running whatever happens to its
database.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from threading import Lock

from sqlalchemy import Connection

from msbot.config import Blueprint, PartType, Slot, parse_versions, split_number
from msbot.pnp import Claim, Configuration, Group, PartEvent, PartState, StopRecord
from msbot.registry.database import statements
from msbot.registry.database.database_writer import DatabaseWriter
from msbot.registry.records import RobotRecord, UserRecord, uid_text
from msbot.registry.running import robot_memory
from msbot.registry.running.robot_memory import StoredRobotSnapshot
from msbot_agent.link.can.protocol import MemoryNodeIds
from msbot_xrce.errors import RegistryError

JOURNAL_ROWS = 100_000
"""How many lines of the journal are kept."""
STRANGERS_ROWS = 10_000
"""How many of them may be about parts in no slot: parts turned away again and again displace only such lines."""
STRANGERS = 1_000
"""How many parts that were never in a slot are kept."""
PRUNE_EVERY = 1_000
"""How many lines are written before old ones are deleted."""


class RobotStore:
    """The `PartStore` of one robot.

    Its methods belong to the event loop's thread; `use` may be called from any thread.

    Args:
        writer: the thread that writes.
        database: the database in words.
        robot: the robot that the parts belong to.
        memory: the robot as it is in the database.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self,
        writer: DatabaseWriter,
        database: str,
        robot: RobotRecord,
        memory: StoredRobotSnapshot,
        epoch_ns: Callable[[], int],
    ) -> None:
        self.robot = robot
        self._news_listeners: list[Callable[[], object]] = []
        self._writer = writer
        self._database = database
        self._epoch_ns = epoch_ns
        self._lock = Lock()
        self._memory = memory
        self._sessions: dict[str, int] = {}
        """Identity of each registered part -> its session; another session with that identity is a duplicate."""
        self._written = 0
        self.strangers = 0
        """Events of sessions that never said what they are: counted, not journalled."""
        self._told = 0
        """How many memories of parts have been handed to the writer."""
        self._stored = 0
        """How many of them it has stored."""
        self._unstored: deque[tuple[int, str, str]] = deque()
        """(number, UID, slot) of those that it has not stored."""
        self._remembered: dict[str, str] = {}
        self._placed: dict[str, str] = {}
        self.load(memory, 0)

    def on_news(self, listener: Callable[[], object]) -> None:
        """See `Runs.on_news`."""
        self._news_listeners.append(listener)

    def tell_news(self) -> None:
        """Announce that the database has something new that nobody in this process is waiting for."""
        for listener in self._news_listeners:
            listener()

    @property
    def newest_edit(self) -> int:
        """Number of the newest change known here."""
        return self._memory.newest_edit

    @property
    def blueprint(self) -> Blueprint:
        """The robot's blueprint in force, including what people set by hand."""
        return self._memory.blueprint

    @property
    def users(self) -> tuple[UserRecord, ...]:
        """The users who may log in."""
        return self._memory.users

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups of a class, by name."""
        return self._memory.groups

    @property
    def stored(self) -> int:
        """How many memories of parts the database has stored; for `use`."""
        return self._stored

    def skip_to(self, newest_edit: int) -> None:
        """Note that the lines up to this one changed nothing."""
        with self._lock:
            self._memory = replace(self._memory, newest_edit=newest_edit)

    def load(self, memory: StoredRobotSnapshot, stored: int) -> None:
        """Take over the present content of the database.

        Args:
            memory: that content.
            stored: the value of `stored` when the content was read: whatever was remembered later still counts.
        """
        with self._lock:
            self._memory = memory
            self._remembered = {uid: last for uid, (last, _) in memory.places.items() if last is not None}
            self._placed = {uid: placed for uid, (_, placed) in memory.places.items() if placed is not None}
            while self._unstored and self._unstored[0][0] <= stored:
                self._unstored.popleft()
            for _, uid, slot in self._unstored:
                self._remembered[uid] = slot

    def part_type(self, number: str) -> PartType | None:
        """See `PartStore.part_type`: exactly this number; else that of the number before its @ if the version fits."""
        types = self._memory.types
        if number in types:
            return types[number][0]
        base, version = split_number(number)
        if not version or base not in types:
            return None
        part_type, versions = types[base]
        known = parse_versions(versions)
        return part_type if known is not None and version in known else None

    def slots(self) -> tuple[Slot, ...]:
        """See `PartStore.slots`."""
        return self._memory.slots

    def remembered_slot(self, uid: bytes) -> str | None:
        """See `PartStore.remembered_slot`."""
        return self._remembered.get(uid_text(uid))

    def placed_slot(self, uid: bytes) -> str | None:
        """See `PartStore.placed_slot`."""
        return self._placed.get(uid_text(uid))

    def remember(self, uid: bytes, slot: str, claim: Claim) -> None:
        """See `PartStore.remember`."""
        identity = uid_text(uid)
        if not identity:
            return
        now_ns = self._epoch_ns()
        with self._lock:
            self._told += 1
            number = self._told
            self._unstored.append((number, identity, slot))
            self._remembered[identity] = slot

        def write(connection: Connection) -> None:
            statements.remember(connection, self.robot.id, claim, slot, now_ns)
            self._stored = number

        self._writer.put(write)

    def key_of(self, uid: bytes) -> bytes | None:
        """See `PartStore.key_of`."""
        return self._memory.keys.get(uid_text(uid))

    def configuration(self, slot: str) -> Configuration:
        """See `PartStore.configuration`.

        Raises:
            RegistryError: there is no such slot.
        """
        found = self._memory.configurations.get(slot)
        if found is None:
            raise RegistryError(f"the database {self._database} has no slot {slot!r} of robot {self.robot.name}")
        return found

    def blocked(self, uid: bytes, number: str) -> str | None:
        """See `PartStore.blocked`."""
        blocks = self._memory.blocks
        return blocks.get(("uid", uid_text(uid))) or blocks.get(("number", number))

    def journal(self, event: PartEvent) -> None:
        """See `PartStore.journal`."""
        if not event.part_number and event.to_state is not PartState.REFUSED:
            self.strangers += 1  # a client that opens sessions and never says what it is must not displace what matters
            return
        now_ns = self._epoch_ns()
        is_about_the_part = self._is_about_the_part(event)
        self._written += 1
        prune = self._written % PRUNE_EVERY == 0

        def write(connection: Connection) -> None:
            statements.write_journal(connection, self.robot.id, event, now_ns)
            if is_about_the_part:
                statements.note_state(connection, self.robot.id, event, now_ns)
            if prune:
                statements.prune(connection, self.robot.id, JOURNAL_ROWS, STRANGERS, STRANGERS_ROWS)

        self._writer.put(write)

    def _is_about_the_part(self, event: PartEvent) -> bool:
        """Whether the event changes the part's row: not before its claim, nor for a duplicate of a registered part."""
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

    def kept_stop(self) -> StopRecord | None:
        """See `PartStore.kept_stop`."""
        return self._memory.stop

    def keep_stop(self, record: StopRecord) -> None:
        """See `PartStore.keep_stop`."""
        self._writer.put(partial(robot_memory.write, robot_id=self.robot.id, record=record))

    def is_kept(self, timeout_s: float) -> bool:
        """See `PartStore.is_kept`."""
        return self._writer.flush(timeout_s)


# The CAN addresses of one bus, kept in the database: `msbot_agent.link.NodeIds` on top of the writer.


class StoredNodeIds:
    """Addresses are looked up in memory and stored by the writer thread.

    Args:
        writer: the thread that writes.
        robot_id: the robot of the bus.
        link: the bus, as in the link's address.
        rows: (node id, UID as text, kept_ns) from the database, oldest first.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self,
        writer: DatabaseWriter,
        robot_id: int,
        link: str,
        *,
        rows: Sequence[tuple[int, str, int]],
        epoch_ns: Callable[[], int],
    ) -> None:
        self._writer = writer
        self._robot_id = robot_id
        self._link = link
        self._epoch_ns = epoch_ns
        self._memory = MemoryNodeIds()
        self._kept_ns = 0
        for node_id, uid, kept_ns in rows:
            self._memory.assign(node_id, bytes.fromhex(uid))
            self._kept_ns = kept_ns

    def find(self, uid: bytes) -> int | None:
        """See `NodeIds.find`."""
        return self._memory.find(uid)

    def oldest_first(self) -> Sequence[int]:
        """See `NodeIds.oldest_first`."""
        return self._memory.oldest_first()

    def assign(self, node_id: int, uid: bytes) -> None:
        """See `NodeIds.assign`."""
        self._memory.assign(node_id, uid)
        # A wall clock may jump back; the order of the addresses must not.
        kept_ns = self._kept_ns = max(self._epoch_ns(), self._kept_ns + 1)
        self._writer.put(
            lambda connection: statements.keep_node_id(
                connection, self._robot_id, self._link, node_id=node_id, uid=uid.hex(), kept_ns=kept_ns
            )
        )
