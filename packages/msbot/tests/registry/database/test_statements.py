"""The statements of a running robot, as the registry's callers see them."""

from collections.abc import Callable

import pytest
from sqlalchemy import Connection

from msbot.config import Blueprint, Library
from msbot.pnp import Claim, PartState, SlotBinding
from msbot.registry import Registry, RobotRecord, RobotStore
from msbot.registry.database import statements
from tests.registry.events import CLAIM, UID, changed
from tests.registry.hand import Hand


@pytest.fixture
def robot(registry: Registry, blueprint: Blueprint, library: Library) -> RobotRecord:
    return registry.robots.apply_blueprint(blueprint, library)


@pytest.fixture
def store(registry: Registry, robot: RobotRecord) -> RobotStore:
    return registry.runs.begin(robot)


def _do(registry: Registry, write: Callable[[Connection], None]) -> None:
    registry.storage.write(write)


def test_the_sample_robot_comes_back_as_the_inventory_wants_it(store: RobotStore) -> None:
    assert [(slot.name, slot.part_number, slot.wanted_name) for slot in store.slots()] == [
        ("AA", "ABCD", "ABCD-local"),
        ("BB", "EFGH", "EFGH-local"),
        ("CC", "WXYZ", "WXYZ-local"),
    ]
    assert store.configuration("BB").bindings == (
        SlotBinding("in", "HelloWorldTopic_1_to_2", "HelloWorld", publishes=False, reliable=True),
        SlotBinding("out", "HelloWorldTopic_2_to_3", "HelloWorld", publishes=True, reliable=True),
    )
    motor = store.part_type("WXYZ")
    assert motor is not None
    assert (motor.name, motor.specification) == ("Motor driver", "5V")
    assert store.part_type("wxyz") is None


def test_the_journal_tells_the_newest_lines_in_order(registry: Registry, store: RobotStore) -> None:
    for number in range(5):
        store.journal(changed(PartState.ACTIVE, reason=f"reason {number}"))
    registry.storage.flush()
    entries = registry.robots.journal(3)
    assert [entry.event.reason for entry in entries] == ["reason 2", "reason 3", "reason 4"]
    assert [entry.number for entry in entries] == [3, 4, 5]
    assert {entry.robot for entry in entries} == {"MSBOT_MASTER"}


def test_a_line_of_the_journal_is_the_whole_event(registry: Registry, store: RobotStore) -> None:
    event = changed(PartState.LOST, before=PartState.LATE)
    store.journal(event)
    registry.storage.flush()
    (entry,) = registry.robots.journal()
    assert entry.event.sentences() == event.sentences()
    assert entry.event.evidence == event.evidence
    assert (entry.event.uid, entry.event.address, entry.event.slot) == (UID, "udp 127.0.0.1:5", "AA")
    assert entry.event.at == entry.at_ns / 1e9


def test_a_note_is_no_reason_of_the_state_of_a_part(registry: Registry, store: RobotStore) -> None:
    store.journal(changed(PartState.ACTIVE, reason="both steps done"))
    registry.storage.flush()
    (before,) = registry.robots.parts()
    store.journal(changed(PartState.ACTIVE, before=PartState.ACTIVE, reason="its program says: the fan is stuck"))
    registry.storage.flush()
    (part,) = registry.robots.parts()
    assert (part.state, part.reason, part.changed_ns) == ("active", "both steps done", before.changed_ns)


@pytest.mark.parametrize("name", ["ABCD-local", "abcd-LOCAL", "aa", "ABCD", "0011223344556677", "Ägir"])
def test_a_part_is_found_by_any_of_its_names(registry: Registry, store: RobotStore, name: str) -> None:
    store.journal(changed(PartState.ACTIVE, number="EFGH", local_name="other", slot="BB", uid=b"12345678"))
    store.journal(changed(PartState.ACTIVE))
    store.journal(changed(PartState.ACTIVE, number="NOPE", local_name="Ägir", slot=None, uid=b""))
    registry.storage.flush()
    assert [entry.number for entry in registry.robots.journal(part=name)] == [3 if name == "Ägir" else 2]


def test_the_journal_of_one_robot(registry: Registry, store: RobotStore, robot: RobotRecord) -> None:
    store.journal(changed(PartState.ACTIVE))
    registry.storage.flush()
    assert len(registry.robots.journal(robot=robot)) == 1
    other = RobotRecord(99, "other", "1", "1", "", "", 0)
    assert registry.robots.journal(robot=other) == []


def test_parts_in_slots_come_first(registry: Registry, store: RobotStore, robot: RobotRecord) -> None:
    store.journal(changed(PartState.REFUSED, number="NOPE", local_name="", slot=None, uid=b"strange!"))
    store.journal(changed(PartState.ACTIVE, number="EFGH", local_name="EFGH-local", slot="BB", uid=b"part BB."))
    store.journal(changed(PartState.ACTIVE))
    registry.storage.flush()
    assert [(part.name, part.slot, part.state) for part in registry.robots.parts(robot)] == [
        ("ABCD-local", "AA", "active"),
        ("EFGH-local", "BB", "active"),
        ("NOPE", None, "refused"),
    ]
    assert registry.robots.parts() == registry.robots.parts(robot)
    assert registry.robots.parts(RobotRecord(99, "other", "1", "1", "", "", 0)) == []


def test_a_row_has_the_first_and_the_last_time(registry: Registry, store: RobotStore) -> None:
    store.remember(UID, "AA", CLAIM)
    store.journal(changed(PartState.ACTIVE))
    store.journal(changed(PartState.LOST, reason="silent"))
    registry.storage.flush()
    (part,) = registry.robots.parts()
    assert (part.state, part.reason, part.slot, part.uid) == ("lost", "silent", "AA", UID)
    assert part.changed_ns - part.first_seen_ns == 2_000_000_000


def test_a_lost_part_keeps_its_slot_in_memory(registry: Registry, store: RobotStore) -> None:
    store.journal(changed(PartState.ACTIVE))
    store.journal(changed(PartState.REFUSED, slot=None, key=1))
    registry.storage.flush()
    assert [part.slot for part in registry.robots.parts()] == ["AA"]


def test_blocking_a_uid_or_a_number(registry: Registry, store: RobotStore, robot: RobotRecord) -> None:
    assert store.blocked(UID, "ABCD") is None
    Hand(registry).block(robot, "number", "ABCD", "broken series", "Ann")
    assert store.blocked(UID, "ABCD") == "broken series"
    Hand(registry).block(robot, "uid", UID.hex(), "smells burnt", "Ann")
    assert store.blocked(UID, "ABCD") == "smells burnt"
    assert store.blocked(b"", "ABCD") == "broken series"
    Hand(registry).unblock(robot, "number", "ABCD", "Ann")
    Hand(registry).unblock(robot, "uid", UID.hex(), "Ann")
    assert store.blocked(UID, "ABCD") is None


def test_old_lines_and_strangers_are_forgotten(registry: Registry, store: RobotStore, robot: RobotRecord) -> None:
    store.journal(changed(PartState.ACTIVE))
    for number in range(5):
        stranger = changed(PartState.REFUSED, number=f"NOPE{number}", local_name="", slot=None, uid=b"")
        store.journal(stranger)
    registry.storage.flush()
    _do(registry, lambda connection: statements.prune(connection, robot.id, 3, 2, 3))
    assert [entry.number for entry in registry.robots.journal()] == [1, 4, 5, 6]
    assert [part.part_number for part in registry.robots.parts()] == ["ABCD", "NOPE3", "NOPE4"]
    _do(registry, lambda connection: statements.prune(connection, robot.id, 3, 2, 3))
    assert len(registry.robots.parts()) == 3


def test_an_address_belongs_to_one_part_and_a_part_has_one_address(registry: Registry, robot: RobotRecord) -> None:
    def keep(node_id: int, uid: str, at: int) -> None:
        def write(connection: Connection) -> None:
            statements.keep_node_id(connection, robot.id, "can:0", node_id=node_id, uid=uid, kept_ns=at)

        _do(registry, write)

    keep(1, "aa", 1)
    keep(2, "bb", 2)
    keep(2, "aa", 3)
    keep(7, "cc", 4)
    rows = registry.storage.read(lambda connection: statements.read_node_ids(connection, robot.id, "can:0"))
    assert rows == [(2, "aa", 3), (7, "cc", 4)]


def test_a_claim_without_uid_is_known_by_its_names(registry: Registry, store: RobotStore) -> None:
    store.remember(b"", "AA", Claim("ABCD", "ABCD-local"))
    store.journal(changed(PartState.ACTIVE, uid=b""))
    store.journal(changed(PartState.LOST, uid=bytes(8)))
    registry.storage.flush()
    assert [(part.uid, part.state, part.slot) for part in registry.robots.parts()] == [(b"", "lost", "AA")]
