"""The inventory's view of the registry: quick answers, and a robot that goes on without its database."""

from collections.abc import Callable
from pathlib import Path

import pytest

from msbot.config import Blueprint, Library
from msbot.errors import RegistryError
from msbot.pnp import PartState, PartStore
from msbot.registry import Registry, RobotStore, open_registry, robot_store
from tests.registry.events import CLAIM, UID, changed


@pytest.fixture
def store(registry: Registry, blueprint: Blueprint, library: Library) -> RobotStore:
    return registry.store_for(registry.apply_blueprint(blueprint, library))


def _break(monkeypatch: pytest.MonkeyPatch, store: RobotStore) -> None:
    def refuse(_: object) -> None:
        raise RegistryError("the database robot.db is damaged")

    monkeypatch.setattr(store, "_read", refuse)


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
        new_store = again.store_for(again.apply_blueprint(blueprint, library))
        assert new_store.remembered_slot(UID) == "BB"


@pytest.mark.parametrize("uid", [b"", bytes(8)])
def test_a_part_without_uid_is_not_remembered(registry: Registry, store: RobotStore, uid: bytes) -> None:
    store.remember(uid, "AA", CLAIM)
    registry.flush()
    assert store.remembered_slot(uid) is None
    assert registry.parts() == []


def test_an_unknown_slot_is_an_error(store: RobotStore) -> None:
    with pytest.raises(RegistryError, match="has no slot 'ZZ' of robot MSBOT_MASTER"):
        store.configuration("ZZ")


def test_the_robot_goes_on_with_what_it_knows(store: RobotStore, monkeypatch: pytest.MonkeyPatch) -> None:
    assert store.blocked(UID, "WXYZ") is None
    slots, configuration, motor = store.slots(), store.configuration("AA"), store.part_type("WXYZ")
    _break(monkeypatch, store)
    assert store.slots() == slots
    assert store.configuration("AA") == configuration
    assert store.part_type("WXYZ") == motor
    assert store.blocked(UID, "WXYZ") is None
    with pytest.raises(RegistryError, match="is damaged"):
        store.part_type("ABCD")
    with pytest.raises(RegistryError, match="is damaged"):
        store.configuration("ZZ")
    with pytest.raises(RegistryError, match="is damaged"):
        store.blocked(UID, "ABCD")


def test_what_is_kept_in_memory_are_bounded(store: RobotStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_store, "MOST_IN_MEMORY", 1)
    assert store.part_type("ABCD") is not None
    assert store.part_type("EFGH") is not None
    assert store.blocked(UID, "ABCD") is None
    assert store.blocked(UID, "EFGH") is None
    _break(monkeypatch, store)
    assert store.part_type("ABCD") is not None
    with pytest.raises(RegistryError):
        store.part_type("EFGH")
    assert store.blocked(UID, "ABCD") is None
    with pytest.raises(RegistryError):
        store.blocked(UID, "EFGH")


def test_what_another_process_changes_is_seen(
    store: RobotStore, path: Path, blueprint: Blueprint, library: Library
) -> None:
    with open_registry(path) as other:
        other.block(other.robots()[0], "number", "ABCD", "stolen", "Ann")
    assert store.blocked(UID, "ABCD") == "stolen"


def test_a_session_without_a_claim_is_in_the_journal_only(registry: Registry, store: RobotStore) -> None:
    store.journal(changed(PartState.NEW, before=None, slot=None, number="", local_name="", uid=b""))
    registry.flush()
    (entry,) = registry.journal()
    assert (entry.event.part, entry.event.from_state) == ("udp 127.0.0.1:5", None)
    assert registry.parts() == []


def test_a_refused_duplicate_does_not_touch_the_part_that_holds_the_slot(registry: Registry, store: RobotStore) -> None:
    store.journal(changed(PartState.ACTIVE, key=1))
    store.journal(changed(PartState.CHECKING, before=None, slot=None, key=2))
    store.journal(changed(PartState.REFUSED, slot=None, key=2, reason="duplicate"))
    registry.flush()
    assert [(part.state, part.slot) for part in registry.parts()] == [("active", "AA")]
    assert [entry.event.to_state.value for entry in registry.journal()] == ["active", "checking", "refused"]


def test_a_restarted_part_takes_over_from_its_old_session(registry: Registry, store: RobotStore) -> None:
    store.journal(changed(PartState.ACTIVE, key=1))
    store.journal(changed(PartState.ACTIVE, key=2, reason="restarted"))
    store.journal(changed(PartState.LOST, key=1, reason="the old session"))
    registry.flush()
    assert [(part.state, part.reason) for part in registry.parts()] == [("active", "restarted")]
    store.journal(changed(PartState.LOST, key=2, reason="silent"))
    store.journal(changed(PartState.CHECKING, key=3, reason="again"))
    registry.flush()
    assert [(part.state, part.reason) for part in registry.parts()] == [("checking", "again")]


def test_parts_of_the_last_run_are_lost_until_they_claim_again(
    registry: Registry, store: RobotStore, epoch_ns: Callable[[], int]
) -> None:
    store.journal(changed(PartState.ACTIVE))
    store.journal(changed(PartState.LATE, slot="BB", number="EFGH", local_name="EFGH-local", uid=b"part BB."))
    store.journal(changed(PartState.LEFT, slot="CC", number="WXYZ", local_name="WXYZ-local", uid=b"part CC."))
    registry.flush()
    registry.store_for(store.robot)
    assert [(part.state, part.reason) for part in registry.parts()] == [
        ("lost", "the master was started anew"),
        ("lost", "the master was started anew"),
        ("left", "because"),
    ]
    lines = [entry.event.sentences()[0] for entry in registry.journal(2)]
    assert lines == [
        "ABCD-local: active -> lost in slot AA: the master was started anew",
        "EFGH-local: late -> lost in slot BB: the master was started anew",
    ]


def test_old_lines_are_looked_for_now_and_then(
    registry: Registry, store: RobotStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_store, "PRUNE_EVERY", 10)
    monkeypatch.setattr(robot_store, "JOURNAL_ROWS", 4)
    for _ in range(10):
        store.journal(changed(PartState.ACTIVE))
    registry.flush()
    assert [entry.number for entry in registry.journal()] == [7, 8, 9, 10]
