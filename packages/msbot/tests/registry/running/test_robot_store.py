"""The inventory's view of the registry: quick answers, and a robot that goes on without its database."""

from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread, current_thread
from time import sleep

import pytest
from sqlalchemy import event

from msbot.config import Blueprint, Library
from msbot.pnp import PartState, PartStore
from msbot.registry import Registry, RobotStore, open_registry
from msbot.registry.records import NOTED, EditKind
from msbot.registry.running import robot_store
from msbot.registry.running.robot_memory import read_memory
from msbot_xrce.errors import RegistryError
from tests.registry.events import CLAIM, UID, changed
from tests.registry.hand import Hand


@pytest.fixture
def store(registry: Registry, blueprint: Blueprint, library: Library) -> RobotStore:
    return registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))


def test_it_is_what_the_inventory_asks_for(store: RobotStore) -> None:
    def takes(part_store: PartStore) -> None:
        assert part_store is store

    takes(store)


def test_a_part_is_remembered_at_once_and_after_a_restart(
    registry: Registry, store: RobotStore, path: Path, blueprint: Blueprint, library: Library
) -> None:
    assert store.remembered_slot(UID) is None
    store.remember(UID, "BB", CLAIM)
    assert store.remembered_slot(UID) == "BB"
    registry.close()
    with open_registry(path) as again:
        new_store = again.runs.begin(again.robots.apply_blueprint(blueprint, library))
        assert new_store.remembered_slot(UID) == "BB"


@pytest.mark.parametrize("uid", [b"", bytes(8)])
def test_a_part_without_uid_is_not_remembered(registry: Registry, store: RobotStore, uid: bytes) -> None:
    store.remember(uid, "AA", CLAIM)
    registry.storage.flush()
    assert store.remembered_slot(uid) is None
    assert registry.robots.parts() == []


def test_an_unknown_slot_is_an_error(store: RobotStore) -> None:
    with pytest.raises(RegistryError, match="has no slot 'ZZ' of robot MSBOT_MASTER"):
        store.configuration("ZZ")


def test_the_robot_never_asks_the_database_again(registry: Registry, store: RobotStore) -> None:
    @event.listens_for(registry.storage.engine, "before_cursor_execute")
    def asked(*_: object) -> None:
        asking.append(current_thread())

    asking: list[Thread] = []
    assert [slot.name for slot in store.slots()] == ["AA", "BB", "CC"]
    assert store.configuration("AA").slot == "AA"
    motor = store.part_type("WXYZ")
    assert motor is not None
    assert (motor.name, store.part_type("NOPE")) == ("Motor driver", None)
    assert (store.blocked(UID, "WXYZ"), store.key_of(UID), store.kept_stop()) == (None, None, None)
    assert current_thread() not in asking


def test_what_is_told_between_a_change_and_its_memory_is_not_forgotten(registry: Registry, store: RobotStore) -> None:
    store.remember(UID, "BB", CLAIM)
    registry.storage.flush()
    stored = store.stored
    memory = registry.storage.read(lambda connection: read_memory(connection, store.robot.id))
    store.remember(UID, "CC", CLAIM)
    store.load(memory, stored)
    assert store.remembered_slot(UID) == "CC"
    registry.storage.flush()
    store.load(registry.storage.read(lambda connection: read_memory(connection, store.robot.id)), store.stored)
    assert store.remembered_slot(UID) == "CC"


def test_what_another_process_changes_is_seen_soon(
    registry: Registry, store: RobotStore, path: Path, blueprint: Blueprint, library: Library
) -> None:
    news = Event()
    registry.runs.on_news(store.robot, news.set)
    with open_registry(path) as other:
        Hand(other).block(other.robots.all()[0], "number", "ABCD", "stolen", "Ann")
        other.keys.store(UID, bytes(16), "Ann")
    while (store.blocked(UID, "ABCD"), store.key_of(UID)) != ("stolen", bytes(16)):
        assert news.wait(20)
        news.clear()


def test_lines_of_what_people_only_did_are_no_news_and_hide_no_change(
    registry: Registry, store: RobotStore, path: Path
) -> None:
    news = Event()
    registry.runs.on_news(store.robot, news.set)
    for kind in NOTED:
        registry.edits.note(store.robot, EditKind(kind), "somebody did it", "Ann")
    newest = registry.edits.latest(store.robot, 1)[0].id
    assert store.newest_edit < newest
    for _ in range(400):
        if store.newest_edit == newest:
            break
        sleep(0.05)
    assert store.newest_edit == newest
    assert not news.is_set()
    with open_registry(path) as other:
        robot = other.robots.all()[0]
        Hand(other).block(robot, "number", "ABCD", "stolen", "Ann")
        other.edits.note(robot, EditKind.STOP, "STOP", "Ann")
        other.storage.flush()
    assert news.wait(20)
    assert store.blocked(UID, "ABCD") == "stolen"


def test_sessions_that_never_say_what_they_are_are_counted_and_not_journalled(
    registry: Registry, store: RobotStore
) -> None:
    store.journal(changed(PartState.ACTIVE))
    for _ in range(2_000):
        store.journal(changed(PartState.NEW, before=None, slot=None, number="", local_name="", uid=b""))
    registry.storage.flush()
    assert [entry.event.to_state for entry in registry.robots.journal()] == [PartState.ACTIVE]
    assert (store.strangers, len(registry.robots.parts())) == (2_000, 1)


def test_however_many_are_turned_away_they_push_out_their_own_lines_only(
    registry: Registry, store: RobotStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the bound: as many lines about parts in slots as are kept stay, whatever comes after them."""
    monkeypatch.setattr(robot_store, "PRUNE_EVERY", 10)
    monkeypatch.setattr(robot_store, "JOURNAL_ROWS", 5)
    monkeypatch.setattr(robot_store, "STRANGERS_ROWS", 3)
    for _ in range(5):
        store.journal(changed(PartState.ACTIVE))
    for _ in range(65):
        store.journal(changed(PartState.REFUSED, slot=None))
    registry.storage.flush()
    assert [entry.number for entry in registry.robots.journal()] == [1, 2, 3, 4, 5, 68, 69, 70]


def test_a_refused_duplicate_does_not_touch_the_part_that_holds_the_slot(registry: Registry, store: RobotStore) -> None:
    store.journal(changed(PartState.ACTIVE, key=1))
    store.journal(changed(PartState.CHECKING, before=None, slot=None, key=2))
    store.journal(changed(PartState.REFUSED, slot=None, key=2, reason="duplicate"))
    registry.storage.flush()
    assert [(part.state, part.slot) for part in registry.robots.parts()] == [("active", "AA")]
    assert [entry.event.to_state.value for entry in registry.robots.journal()] == ["active", "checking", "refused"]


def test_a_restarted_part_takes_over_from_its_old_session(registry: Registry, store: RobotStore) -> None:
    store.journal(changed(PartState.ACTIVE, key=1))
    store.journal(changed(PartState.ACTIVE, key=2, reason="restarted"))
    store.journal(changed(PartState.LOST, key=1, reason="the old session"))
    registry.storage.flush()
    assert [(part.state, part.reason) for part in registry.robots.parts()] == [("active", "restarted")]
    store.journal(changed(PartState.LOST, key=2, reason="silent"))
    store.journal(changed(PartState.CHECKING, before=PartState.NEW, key=3, reason="again"))
    registry.storage.flush()
    assert [(part.state, part.reason) for part in registry.robots.parts()] == [("checking", "again")]


def test_parts_of_the_last_run_are_lost_until_they_claim_again(
    registry: Registry, store: RobotStore, epoch_ns: Callable[[], int]
) -> None:
    store.journal(changed(PartState.ACTIVE))
    store.journal(changed(PartState.LATE, slot="BB", number="EFGH", local_name="EFGH-local", uid=b"part BB."))
    store.journal(changed(PartState.LEFT, slot="CC", number="WXYZ", local_name="WXYZ-local", uid=b"part CC."))
    store.journal(changed(PartState.STANDBY, slot=None, number="EFGH", local_name="spare", uid=b"a spare."))
    store.journal(changed(PartState.REFUSED, slot=None, number="NOPE", local_name="mole", uid=b"the mole"))
    registry.storage.flush()
    registry.runs.begin(store.robot)
    assert [(part.state, part.reason) for part in registry.robots.parts()] == [
        ("lost", "the master was restarted"),
        ("lost", "the master was restarted"),
        ("left", "because"),
        ("lost", "the master was restarted"),
        ("lost", "the master was restarted"),
    ]
    lines = [entry.event.sentences()[0] for entry in registry.robots.journal(4)]
    assert sorted(lines) == [
        "ABCD-local: active -> lost in slot AA: the master was restarted",
        "EFGH-local: late -> lost in slot BB: the master was restarted",
        "mole: refused -> lost: the master was restarted",
        "spare: standby -> lost: the master was restarted",
    ]


def test_old_lines_are_looked_for_now_and_then(
    registry: Registry, store: RobotStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_store, "PRUNE_EVERY", 10)
    monkeypatch.setattr(robot_store, "JOURNAL_ROWS", 4)
    for _ in range(10):
        store.journal(changed(PartState.ACTIVE))
    registry.storage.flush()
    assert [entry.number for entry in registry.robots.journal()] == [7, 8, 9, 10]
