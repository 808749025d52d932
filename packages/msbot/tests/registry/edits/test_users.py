"""Users and keys: kept, changed, removed; who did it is recorded."""

import pytest

from msbot.config import Blueprint, Library
from msbot.registry import ROLES, KeyRecord, Registry
from msbot.registry.edits import edit_log
from msbot.registry.hand_ins import HandIn
from msbot_xrce.errors import ConfigError
from tests.registry.events import UID
from tests.registry.hand import Hand

SECRET = bytes(range(16))


def test_a_user_is_added_changed_and_removed(registry: Registry) -> None:
    assert registry.users.all() == []
    Hand(registry).keep_user("ann", "administrator", "setup", password_hash="salt")
    edit = Hand(registry).keep_user("bob", "student", "ann", password_hash="", tokens=(("tablet", "abc"),))
    assert (edit.kind, edit.who, edit.words) == ("user", "ann", "user bob added as student")
    bob = registry.users.find("bob")
    assert bob is not None
    assert (bob.name, bob.role, bob.password_hash, bob.tokens) == ("bob", "student", "", (("tablet", "abc"),))
    words = [
        Hand(registry).keep_user("bob", "teacher", "ann", password_hash="").words,
        Hand(registry).keep_user("bob", "teacher", "ann", password_hash="pepper").words,
        Hand(registry).keep_user("bob", "teacher", "ann", password_hash="pepper", tokens=(("desk", "def"),)).words,
        Hand(registry).remove_user("bob", "ann").words,
    ]
    assert words == [
        "user bob is teacher now; was student",
        "user bob changed: password",
        "user bob changed: tokens",
        "user bob (teacher) removed",
    ]
    assert [user.name for user in registry.users.all()] == ["ann"]
    assert registry.users.find("bob") is None
    assert [edit.words for edit in registry.edits.latest(None, 3)] == words[:0:-1]


def test_the_ticks_of_lessons_go_with_who_is_removed(registry: Registry) -> None:
    Hand(registry).keep_user("bob", "student", "setup", password_hash="")
    registry.lesson_ticks.note(["bob", "cid"], "ring", "1.1", 5)
    for name in ("bob", "cid"):
        registry.hand_ins.store(HandIn(name, "ring", 6, 5))
    Hand(registry).remove_user("bob", "ann")
    assert [tick.person for tick in registry.lesson_ticks.all()] == ["cid"]
    assert [work.person for work in registry.hand_ins.of()] == ["cid"]


def test_who_changes_something_without_end_displaces_the_own_changes_only(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(edit_log, "EDITS_KEPT", 5)
    Hand(registry).keep_user("ann", "administrator", "setup", password_hash="salt")
    Hand(registry).keep_user("eve", "student", "ann", password_hash="")
    for number in range(20):
        Hand(registry).keep_user("eve", "student", "eve", password_hash="", tokens=((f"tablet {number}", "abc"),))
    found = registry.edits.latest(None, 100)
    assert [edit.who for edit in found] == ["eve", "eve", "eve", "ann", "setup"]
    assert registry.users.find("eve") is not None


def test_somebody_stays_administrator(registry: Registry) -> None:
    Hand(registry).keep_user("ann", "administrator", "setup", password_hash="salt")
    words = "ann is the only administrator: make somebody else administrator first"
    with pytest.raises(ConfigError, match=words):
        Hand(registry).remove_user("ann", "ann")
    with pytest.raises(ConfigError, match=words):
        Hand(registry).keep_user("ann", "viewer", "ann", password_hash="salt")
    Hand(registry).keep_user("bob", "administrator", "ann", password_hash="")
    Hand(registry).remove_user("ann", "bob")


@pytest.mark.parametrize(
    ("name", "role", "sentence"),
    [
        ("ann", "king", f"there is no role 'king'; there are {', '.join(ROLES)}"),
        (" ", "viewer", "' ' is no name: 1 to 64 printable characters"),
        ("a\nb", "viewer", "'a\\\\nb' is no name: 1 to 64 printable characters"),
    ],
)
def test_a_user_that_cannot_be(registry: Registry, name: str, role: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        Hand(registry).keep_user(name, role, "x", password_hash="")
    with pytest.raises(ConfigError, match="there is no user"):
        Hand(registry).remove_user(name, "x")
    assert registry.edits.latest(None) == []


def test_a_part_has_one_key(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
    assert (registry.keys.find(UID), store.key_of(UID)) == (None, None)
    assert registry.keys.store(UID, b"old", "ann").words == f"part {UID.hex()} has a key"
    edit = registry.keys.store(UID, SECRET, "ann")
    assert (edit.kind, edit.words) == ("key", f"part {UID.hex()} has another key")
    assert (registry.keys.find(UID), store.key_of(UID)) == (SECRET, SECRET)
    (key,) = registry.keys.all()
    assert key == KeyRecord(UID, key.created_ns, "ann")
    assert registry.keys.remove(UID, "ann").words == f"the key of part {UID.hex()} is removed"
    assert registry.keys.find(UID) is None
    with pytest.raises(ConfigError, match="has no key"):
        registry.keys.remove(UID, "ann")
    with pytest.raises(ConfigError, match="a part without a UID cannot have a key"):
        registry.keys.store(bytes(8), SECRET, "ann")


def test_the_secret_stands_in_no_edit(registry: Registry) -> None:
    registry.keys.store(UID, SECRET, "ann")
    Hand(registry).keep_user("ann", "administrator", "setup", password_hash="salted hash")
    assert [name for name in ("salted hash", SECRET.hex()) if name in str(registry.edits.latest(None))] == []
