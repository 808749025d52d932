"""Two robots with the same parts live in one database, by chance, beside a plain model of what is kept of them.

Notes are stored late and in groups, as the writer's thread does it; what the registry reads is compared with the model,
and what a quick look reads with both.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from sqlalchemy import Connection

from msbot.pnp import Claim, PartEvent, PartState, StopRecord
from msbot.registry.blueprint import blueprint_reader, blueprint_store
from msbot.registry.database import statements
from msbot.registry.database.database_writer import Note
from msbot.registry.database.engine import make_engine, parse_address
from msbot.registry.read_only_database import NO_MASTER, ReadOnlyDatabase
from msbot.registry.records import JournalEntry, PartRecord, RobotRecord
from msbot.registry.robots import look_at_class
from msbot.registry.running import robot_memory, robot_store
from msbot.registry.running.robot_memory import read_memory
from msbot.registry.running.robot_store import RobotStore, StoredNodeIds
from tests.effort import tries
from tests.registry.blueprint.test_blueprint_store import LIBRARY, ROBOT

UIDS = (b"", bytes(8), b"part one", b"part two", b"stranger", b"spare...")
SLOTS = ("left", "right", "leg", "nose")
WORDS = ("left", "LEFT", "local", "eye", "EYE", b"part one".hex(), "nobody", "Ärm", "ärm")
IN = ("checking", "accepted", "configuring", "active", "late")
LINES, STRANGER_LINES, STRANGERS, EVERY = 4, 2, 1, 3


class Queue:
    """In place of the writer."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.notes: deque[Note] = deque()

    def put(self, note: Note) -> None:
        self.notes.append(note)

    def store(self, count: int) -> None:
        for _ in range(min(count, len(self.notes))):
            self.notes.popleft()(self.connection)

    def flush(self, timeout_s: float) -> bool:
        self.store(len(self.notes))
        return timeout_s > 0


@dataclass
class Plain:
    """One robot, without a database."""

    name: str
    parts: dict[str, PartRecord] = field(default_factory=dict)
    lines: list[JournalEntry] = field(default_factory=list)
    sessions: dict[str, int] = field(default_factory=dict)
    remembered: dict[bytes, str] = field(default_factory=dict)
    """Where parts were, as the running robot has it."""
    written: int = 0
    strangers: int = 0
    nodes: dict[int, tuple[bytes, int]] = field(default_factory=dict)
    stop: StopRecord | None = None
    waiting: list[tuple[Callable[[int], None], bytes, str]] = field(default_factory=list)
    """What the database does not have yet; and the part and slot, if it is a memory."""

    def remember(self, uid: bytes, slot: str, claim: Claim, now: int) -> None:
        if any(uid):
            self.remembered[uid] = slot
            self.waiting.append((lambda _: self._remember(uid, slot, claim, now), uid, slot))

    def use(self) -> None:
        """The running robot takes over what the database has, besides what waits."""
        self.remembered = {one.uid: one.slot for one in self.parts.values() if one.uid and one.slot}
        self.remembered |= {uid: slot for _, uid, slot in self.waiting if uid}

    def _remember(self, uid: bytes, slot: str, claim: Claim, now: int) -> None:
        there = slot if slot in SLOTS[:3] else None
        old = self.parts.get(uid.hex())
        seen = PartRecord(self.name, uid, claim.part_number, claim.local_name, there, "checking", "", "", now, now)
        if old is not None:
            seen = replace(
                seen, state=old.state, reason=old.reason, address=old.address, first_seen_ns=old.first_seen_ns
            )
        self.parts[uid.hex()] = seen

    def journal(self, event: PartEvent, now: int, registered: frozenset[str]) -> None:
        if not event.part_number and event.to_state is not PartState.REFUSED:
            self.strangers += 1
            return
        identity = event.uid.hex() if any(event.uid) else f"{event.part_number}/{event.local_name}"
        about = bool(event.part_number)
        if about and event.to_state.value in registered:
            self.sessions[identity] = event.client_key
        elif about:
            about = self.sessions.get(identity, event.client_key) == event.client_key
            if about:
                self.sessions.pop(identity, None)
        self.written += 1
        prune = self.written % EVERY == 0

        def write(number: int) -> None:
            self.line(number, event, now)
            if about:
                self._note(identity, event, now)
            if prune:
                self.prune(registered)

        self.waiting.append((write, b"", ""))

    def line(self, number: int, event: PartEvent, now: int) -> None:
        uid = event.uid if any(event.uid) else b""
        kept = replace(event, at=now / 1e9, uid=uid, client_key=0, slot=event.slot or None)
        self.lines.append(JournalEntry(number, self.name, now, kept))

    def _note(self, identity: str, event: PartEvent, now: int) -> None:
        old = self.parts.get(identity)
        there = event.slot if event.slot in SLOTS[:3] else None
        self.parts[identity] = PartRecord(
            self.name,
            event.uid if any(event.uid) else b"",
            event.part_number,
            event.local_name,
            there if event.slot is not None else old.slot if old else None,
            event.to_state.value,
            event.reason,
            event.address,
            old.first_seen_ns if old else now,
            now,
        )

    def prune(self, registered: frozenset[str]) -> None:
        kept = [line for line in self.lines if line.event.slot][-LINES:]
        kept += [line for line in self.lines if not line.event.slot][-STRANGER_LINES:]
        self.lines = [line for line in self.lines if line in kept]
        never_in = [(key, one) for key, one in self.parts.items() if one.slot is None and one.state not in registered]
        never_in.sort(key=lambda pair: -pair[1].changed_ns)
        if len(never_in) > STRANGERS:
            until = never_in[STRANGERS][1].changed_ns
            for key, one in never_in:
                if one.changed_ns <= until:
                    del self.parts[key]

    def keep_node(self, node_id: int, uid: bytes, now: int) -> int:
        newest = max((kept for _, kept in self.nodes.values()), default=0)
        self.nodes = {one: held for one, held in self.nodes.items() if one != node_id and held[0] != uid}
        self.nodes[node_id] = uid, max(now, newest + 1)
        return node_id


class Lives:
    def __init__(self, connection: Connection, path: Path, random: Random) -> None:
        self.connection, self.random, self.now = connection, random, 1_000
        self.registered = frozenset(state.value for state in PartState if state.is_registered)
        self.over = frozenset(("lost", "left"))
        self.plain = [Plain("R2"), Plain("R3")]
        self.robots: list[RobotRecord] = []
        for one in self.plain:
            slots = tuple(replace(slot, local_name=f"of {one.name}") for slot in ROBOT.slots)
            blueprint = replace(ROBOT, robot=replace(ROBOT.robot, name=one.name), slots=slots)
            self.now += 1
            made = blueprint_store.apply(connection, blueprint, LIBRARY, self.now)
            self.robots.append(made)
        self.look = ReadOnlyDatabase(connection.connection.driver_connection, path)  # type: ignore[arg-type]  # SQLite's own
        self.queues = [Queue(connection) for _ in self.plain]
        self.stores = [self.begin(index) for index in (0, 1)]
        self.nodes = [self.node_ids(index) for index in (0, 1)]

    def begin(self, index: int) -> RobotStore:
        queue: Any = self.queues[index]
        robot = self.robots[index]
        return RobotStore(queue, "robot.db", robot, read_memory(self.connection, robot.id), lambda: self.now)

    def node_ids(self, index: int) -> StoredNodeIds:
        rows = statements.read_node_ids(self.connection, self.robots[index].id, "can:0")
        queue: Any = self.queues[index]
        return StoredNodeIds(queue, self.robots[index].id, "can:0", rows=rows, epoch_ns=lambda: self.now)

    def step(self) -> None:
        random = self.random
        self.now += random.choice((-1, 1, 2))
        index = random.randrange(2)
        plain, store = self.plain[index], self.stores[index]
        uid = random.choice(UIDS)
        kinds = ("journal", "journal", "journal", "remember", "store", "store", "use", "node", "stop", "end", "again")
        match random.choice(kinds):
            case "remember":
                claim = Claim(random.choice(("EYE", "LEG")), random.choice(("", "local")), uid)
                slot = random.choice(SLOTS)
                store.remember(uid, slot, claim)
                plain.remember(uid, slot, claim, self.now)
            case "journal":
                event = self.event(uid)
                store.journal(event)
                plain.journal(event, self.now, self.registered)
            case "store":
                self.store(index, random.choice((1, 2, 9)))
            case "use":
                memory, stored = read_memory(self.connection, self.robots[index].id), store.stored
                store.load(memory, stored)
                plain.use()
                assert store.kept_stop() == plain.stop
            case "again":
                assert store.is_kept(1.0)
                self.store(index, 99)
                self.stores[index] = self.begin(index)
                plain.use()
                plain.sessions.clear()
                plain.written = plain.strangers = 0
            case "node":
                node_id = self.nodes[index].find(uid) if uid and random.random() < 0.3 else None
                if any(uid):
                    self.store(index, 99)
                    node_id = node_id or random.randrange(1, 4)
                    self.nodes[index].assign(node_id, uid)
                    self.queues[index].store(1)
                    plain.keep_node(node_id, uid, self.now)
                    if random.random() < 0.2:
                        self.nodes[index] = self.node_ids(index)
            case "stop":
                record = StopRecord(self.now, random.random() < 0.5, "Ann", "why", self.now)
                self.store(index, 99)
                store.keep_stop(record)
                self.queues[index].store(1)
                plain.stop = record
            case "end":
                self.store(index, 99)
                self.end(index)

    def event(self, uid: bytes) -> PartEvent:
        random = self.random
        number, local = random.choice(("EYE", "LEG", "")), random.choice(("", "local", "Ärm"))
        return PartEvent(
            at=12.5,
            part=local or number or "udp",
            slot=random.choice((None, None, None, None, "", *SLOTS)),
            from_state=random.choice((None, PartState.CHECKING, PartState.LATE)),
            to_state=random.choice([*PartState]),
            reason=random.choice(("because", "it fits")),
            evidence=random.choice(((), (("rule", "outcome"), ("slot", "free")))),
            part_number=number,
            local_name=local,
            uid=uid,
            client_key=random.randrange(1, 3),
            address=random.choice(("", "udp 127.0.0.1:5")),
        )

    @property
    def newest(self) -> int:
        return max((line.number for plain in self.plain for line in plain.lines), default=0)

    def store(self, index: int, count: int) -> None:
        plain = self.plain[index]
        for _ in range(min(count, len(plain.waiting))):
            write, *_rest = plain.waiting.pop(0)
            write(self.newest + 1)
            self.queues[index].store(1)

    def end(self, index: int) -> None:
        plain, robot = self.plain[index], self.robots[index]
        statements.end_run(self.connection, robot.id, "the master was restarted", self.now)
        there = statements.read_journal(self.connection, robot.id, None, 99)
        newest = self.newest
        for line in [line for line in there if line.number > newest]:
            identity = line.event.uid.hex() or f"{line.event.part_number}/{line.event.local_name}"
            old = plain.parts[identity]
            assert old.state not in self.over
            event = PartEvent(
                at=0.0,
                part=old.local_name or old.slot or old.part_number,
                slot=old.slot,
                from_state=PartState(old.state),
                to_state=PartState.LOST,
                reason="the master was restarted",
                part_number=old.part_number,
                local_name=old.local_name,
                uid=old.uid,
                address=old.address,
            )
            plain.line(line.number, event, self.now)
            plain.parts[identity] = replace(old, state="lost", reason=event.reason, changed_ns=self.now)
        assert [one for one in plain.parts.values() if one.state not in self.over] == []

    def compare(self) -> None:
        connection, all_lines = self.connection, []
        for index, plain in enumerate(self.plain):
            robot = self.robots[index]
            parts = statements.list_parts(connection, robot.id)
            order = {"left": 0, "right": 1, "leg": 2, None: 9}
            assert [(order[one.slot], one.first_seen_ns) for one in parts] == sorted(
                (order[one.slot], one.first_seen_ns) for one in parts
            )
            assert {*map(repr, parts)} == {*map(repr, plain.parts.values())}
            lost = [one if one.state in self.over else replace(one, state="lost", reason=NO_MASTER) for one in parts]
            assert {*map(repr, self.look.parts(robot))} == {*map(repr, lost)}
            assert statements.read_journal(connection, robot.id, None, 99) == plain.lines
            all_lines += plain.lines
            slots = [
                (slot.name, slot.part_number, slot.local_name) for slot in statements.list_slots(connection, robot.id)
            ]
            assert slots == [(slot.name, slot.part_number, f"of {plain.name}") for slot in ROBOT.slots]
            assert self.look.slot_names(robot) == ["left", "right", "leg"]
            self.compare_memory(index)
        all_lines.sort(key=lambda line: line.number)
        word, limit = self.random.choice(WORDS), self.random.choice((1, 3, 99))
        for named, robot_id in ((None, None), *((robot, robot.id) for robot in self.robots)):
            found = [line for line in all_lines if _is_about(line, word) and named in (None, *self.by_name(line.robot))]
            assert statements.read_journal(connection, robot_id, word, limit) == found[-limit:]
            if word.isascii():
                assert self.look.journal(limit, word, named) == found[-limit:]
        self.compare_class()

    def by_name(self, name: str) -> list[RobotRecord]:
        return [robot for robot in self.robots if robot.name == name]

    def compare_memory(self, index: int) -> None:
        plain, store, robot = self.plain[index], self.stores[index], self.robots[index]
        for uid in UIDS:
            assert store.remembered_slot(uid) == plain.remembered.get(uid)
        assert store.strangers == plain.strangers
        assert (store.newest_edit, store.users, store.groups) == (0, (), ())
        assert store.blueprint == blueprint_reader.read(self.connection, robot.id, by_hand=True)
        news: list[str] = []
        store.on_news(lambda: news.append("news"))
        store.tell_news()
        assert news == ["news"]
        kept = sorted(((one, uid.hex(), at) for one, (uid, at) in plain.nodes.items()), key=lambda row: row[2])
        assert statements.read_node_ids(self.connection, robot.id, "can:0") == kept
        assert list(self.nodes[index].oldest_first()) == [row[0] for row in kept]
        assert robot_memory.read(self.connection, robot.id) == plain.stop

    def compare_class(self) -> None:
        look = look_at_class(self.connection)
        assert [one.robot.name for one in look] == ["R3", "R2"]
        for one in look:
            plain = next(plain for plain in self.plain if plain.name == one.robot.name)
            filled = {part.slot for part in plain.parts.values() if part.slot and part.state in self.registered}
            newest = plain.lines[-1] if plain.lines else None
            assert (one.slots, one.filled, one.newest, one.newest_edit) == (3, len(filled), newest, 0)


def _is_about(line: JournalEntry, word: str) -> bool:
    event = line.event
    names = (event.part, event.slot or "", event.local_name, event.part_number, event.uid.hex())
    # SQLite knows small letters of ASCII only.
    return any(word == name or word.lower() == _ascii_lower(name) for name in names)


def _ascii_lower(name: str) -> str:
    return "".join(letter.lower() if letter.isascii() else letter for letter in name)


@pytest.fixture
def connection(path: Path, empty_database: bytes) -> Iterator[Connection]:
    path.write_bytes(empty_database)
    engine = make_engine(parse_address(path), busy_timeout_s=1.0, read_only=False)
    with engine.connect() as connection:
        yield connection
    engine.dispose()


def test_what_is_kept_of_two_robots_is_what_the_plain_model_has(
    connection: Connection, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (
        ("PRUNE_EVERY", EVERY),
        ("JOURNAL_ROWS", LINES),
        ("STRANGERS", STRANGERS),
        ("STRANGERS_ROWS", STRANGER_LINES),
    ):
        monkeypatch.setattr(robot_store, name, value)
    lives = Lives(connection, path, Random(3))
    for _ in range(tries(75, 5_000)):
        lives.step()
        lives.compare()
